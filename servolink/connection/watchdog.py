"""ResponseWatchdog: slots whose response does not come in time, and a board that has fallen silent."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from servolink.connection.call import Slot
from servolink.connection.core import ConnectionCore
from servolink.connection.deadlines import DeadlineTimer, Silence
from servolink.connection.slots import FENCES_ONLY
from servolink.connection.state import State
from servolink.connection.times import ARRIVAL_PAUSE, GONE_PATIENCES, LONGEST_ARRIVAL
from servolink.protocol import Frame, FrameParser

_MOST_PAUSES = 20  # a board without pauses must not put deadlines off for ever
_MOST_OVERDUE = 2 * FENCES_ONLY
"""Overdue slots with which a board is given up: one that sends, but answers nothing, would fill the memory."""


class Arrival(Struct):
    """Partial frame at the deadline of the oldest slot."""

    received: int = 0
    """Bytes received at the last look."""
    pauses: int = 0
    paused_until: float = 0.0


class ResponseWatchdog:
    """Opens slots, and marks the oldest one overdue after its deadline: the board answers in order."""

    def __init__(
        self,
        core: ConnectionCore,
        parser: FrameParser,
        take: Callable[[Frame], None],
        lost: Callable[[Exception], None],
    ) -> None:
        """Watch the slots of `core`, and call `lost` when the board has been silent for too long.

        `take` gets the frames inside a frame that does not end.
        """
        self.heard_at = 0.0
        """When the latest bytes came."""
        self.free_at = 0.0
        """From when the time of the oldest slot counts: no older slot delays the response."""
        self.arrival: Arrival | None = None
        """Partial frame since then."""
        self.silence = Silence()
        """Time since the first request without any frame from the board."""
        self.has_expired = False
        """Whether a slot has become overdue since the latest response."""
        self.answered_in_a_row = 0
        """Number of slots answered since the latest loss."""
        self._core = core
        self._lifecycle = core.lifecycle
        self._slots = core.slots
        self._scheduler = core.scheduler
        self._stats = core.stats
        self._parser = parser
        self._take = take
        self._lost = lost
        self._timer = DeadlineTimer(self._look, lambda: core.stats.bytes_received, self._earliest_due)

    def open(self, slot: Slot) -> None:
        """Wait for the response of a slot; called before the request is written."""
        now, silence, timer = slot.sent_at, self.silence, self._timer
        if not self._slots.live:
            self.free_at, self.arrival = now, None
        self._slots.open(slot)
        if silence.since is None:
            silence.begin(now)
        silence.sendings += 1
        if (deadline := now + slot.timeout) < timer.deadline:
            timer.arm(deadline)

    def mark_overdue(self, slot: Slot) -> None:
        """Expect the response of a slot no longer, and give back the permit that the slot holds."""
        if not slot.overdue:
            self._slots.expire(slot)
        self._scheduler.release_held(slot)

    def count_from_now(self) -> None:
        """Count all times from now: the board could not answer before."""
        now = self._core.loop.time()
        self._restart(now)
        self.silence.count_from(now)

    def stop(self) -> None:
        """Watch no longer: the connection has ended."""
        self._timer.stop()

    # --- deadlines ----------------------------------------------------------------------------------------------

    def _restart(self, now: float) -> None:
        self.free_at, self.arrival = now, None

    def _earliest_due(self) -> float | None:
        return self._due(self._slots.live[0]) if self._slots.live else None

    def _due(self, slot: Slot) -> float:
        due = max(self.free_at, slot.sent_at) + slot.timeout
        return due if self.arrival is None else max(due, self.arrival.paused_until)

    def _look(self, now: float) -> None:
        """Mark the oldest slot overdue after its deadline; a stalled event loop has read everything by now."""
        live = self._slots.live
        self._scheduler.hold()
        try:
            if self._lifecycle.state is State.SUSPENDED:
                self._restart(now)
            if live and now >= self._due(live[0]) and self._parser.partial_frame:
                self._await_partial_frame(now)
            if live and now >= self._due(live[0]):
                self._expire(live[0], now)
            if live and self._lifecycle.ended is None:
                self._timer.arm(self._due(live[0]))
        finally:
            self._scheduler.go_on()

    def _expire(self, slot: Slot, now: float) -> None:
        self._stats.timeouts += 1
        self.answered_in_a_row = 0
        self.mark_overdue(slot)
        self._restart(now)
        if self._scheduler.learns:
            self.has_expired = True
            self._scheduler.load().climb.lost()
        call = slot.call
        if call is not None and not call.is_over:
            if call.since is None and not slot.is_fence:
                call.since = now - slot.timeout
            call.wake()
        self._end_if_silent(now)

    def _end_if_silent(self, now: float) -> None:
        if self._lifecycle.outlasts_silence:
            return
        if self._slots.overdue >= _MOST_OVERDUE:
            self._lost(TimeoutError(f"the board has left {_MOST_OVERDUE} queries in a row unanswered"))
        if not (seconds := self.silence.seconds(now)):
            return
        calls = [slot.call for lane in self._slots.lanes.values() for slot in lane.slots if slot.call is not None]
        patience = max([self._core.patience, *(call.patience for call in calls if not call.is_over)])
        if seconds >= GONE_PATIENCES * patience:
            self._lost(TimeoutError(f"the board has sent nothing for {seconds:.1f} s"))

    def _await_partial_frame(self, now: float) -> None:
        """Put the deadline off while a response, or anything else, is arriving; else give a false start up."""
        while self._parser.partial_frame:
            arrival = self.arrival = self.arrival or Arrival()
            packet_id, received, total = self._parser.partial_frame
            lane = self._slots.lanes.get(packet_id)
            # By the rate, as tries can be short: at 115200 baud the longest list takes 6 s.
            least = total * (now - self.free_at) / LONGEST_ARRIVAL
            if lane is not None and lane.slots and received - arrival.received >= least:
                self.free_at, arrival.received = now, received
                return
            if now < self.heard_at + ARRIVAL_PAUSE and arrival.pauses < _MOST_PAUSES:
                arrival.pauses += 1
                arrival.paused_until = self.heard_at + ARRIVAL_PAUSE
                return
            for frame in self._parser.abandon_frame():
                self._take(frame)
