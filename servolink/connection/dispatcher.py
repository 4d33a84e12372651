"""ResponseDispatcher: the receiving half of a connection, from bytes to waiting calls."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from logging import DEBUG
from typing import Any

from msgspec import Struct

from servolink.connection.call import Call, Content, Settled, Slot
from servolink.connection.deadlines import DeadlineTimer, ResponseTimes, Silence
from servolink.connection.explain import lost, overtaken, same
from servolink.connection.scheduler import Load, RequestScheduler
from servolink.connection.slots import FENCES_ONLY, Slots
from servolink.connection.state import Lifecycle, State
from servolink.connection.stats import Stats
from servolink.connection.taps import FrameLog, Taps, is_logged
from servolink.errors import ConnectionLost, DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import MAGIC, OVERHEAD, ByteOrder, Frame, encode_frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.parser import FrameParser

_READY = State.READY  # a global is faster than a member of an enum
_RARE = MAGIC[-1]
_MOST_EARLY = 4096  # bytes
_PAUSE = 0.05
"""Seconds without a byte after which the rest of a partial frame is no longer expected."""
_LONGEST_ARRIVAL = 20.0
"""Seconds that a response may take to arrive. One that would take longer at its rate is a false start."""
_MOST_PAUSES = 20  # a board without pauses must not put deadlines off for ever
_MOST_OVERDUE = 2 * FENCES_ONLY
"""A board that sends something, but answers nothing of so much, would fill the memory."""
_SILENT_PATIENCES = 2
"""Patiences of complete silence, after several requests, until a board is considered gone."""


class _Arrival(Struct):
    """Partial frame at the deadline of the oldest slot."""

    received: int = 0
    """Bytes received at the last look."""
    pauses: int = 0
    paused_until: float = 0.0


class NestedFrameFilter:
    """Tells frames inside another frame, such as in a caption, from frames of the board.

    The parser returns those right behind the frame around them, in order.
    """

    def __init__(self, byte_order: ByteOrder) -> None:
        """Start without a frame."""
        self._byte_order: ByteOrder = byte_order
        self.inside = b""
        """Rest of the latest frame behind the inner frames returned so far; empty if no frame begins inside."""

    def hides(self, frame: Frame) -> bool:
        """Return whether `frame` begins inside the latest frame. If not, remember `frame` as the latest."""
        data = encode_frame(*frame, self._byte_order)
        begins = self._beginning(data)
        if begins is None:
            self.inside = data[1:] if MAGIC in frame[1] else b""
            return False
        self.inside = self.inside[begins + len(data) :]
        return True

    def _beginning(self, data: bytes) -> int | None:
        """Return the place of `data` in the latest frame, whole or up to the end of the frame."""
        at = self.inside.find(MAGIC)
        while at >= 0:
            if data.startswith(self.inside[at : at + len(data)]):
                return at
            at = self.inside.find(MAGIC, at + 1)
        return None


class ResponseDispatcher:
    """Receives from a transport, settles slots, wakes calls and delivers button events."""

    def __init__(
        self,
        url: str,
        codec: Codec,
        lifecycle: Lifecycle,
        slots: Slots,
        scheduler: RequestScheduler,
        patience: float,
        now: Callable[[], float],
        stats: Stats,
        taps: Taps,
        *,
        ignore_extra: bool = False,
    ) -> None:
        """Settle `slots` with responses from `url`; after `patience` seconds of silence the board is gone."""
        self.stats = stats
        self.taps = taps
        self.on_event: Callable[[ButtonEventResponse], None] = lambda event: None
        self.on_end: Callable[[ConnectionLost], None] = lambda error: None
        self.on_several: Callable[[], None] = lambda: None
        """Called when several frames came at once: the tasks of their calls run in the next turn of the loop."""
        self.on_stranger: Callable[[int], None] = lambda packet_id: None
        """Called with the id of an unrequested packet."""
        self.times = ResponseTimes()
        self.answered_in_a_row = 0
        """Number of slots answered since the latest loss."""
        self.frame_log = FrameLog(url, codec, now)
        self._url = url
        self._codec = codec
        self._lifecycle = lifecycle
        self._slots = slots
        self._scheduler = scheduler
        self._learns = scheduler.window.learns
        self._load: Load | None = None  # when the present chunk came, while the depth is learnt
        self.later: deque[Callable[[], None]] = deque()
        """Functions to call after a chunk is read: sending needs slots in their final state."""
        self.early = bytearray()
        """First bytes received before the handshake begins."""
        self._expired = False  # whether a slot has become overdue since the latest response
        self._patience = patience
        self._now = now
        self._heard_at = 0.0  # when the latest bytes came
        self._restarted_at = 0.0  # from when the time of the oldest slot counts
        self._arrival: _Arrival | None = None  # since then
        self._silence = Silence()
        self.over: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Done when the connection has ended."""
        self._parser = _parser_for(codec.byte_order, ignore_extra=ignore_extra)
        self._parser.skipped = stats.skipped
        self._nested = NestedFrameFilter(codec.byte_order)
        self._timer = DeadlineTimer(self._look, lambda: self.stats.bytes_received, self._earliest_due)

    # --- from the transport -------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Take bytes from the transport."""
        stats = self.stats
        stats.bytes_received += len(chunk)
        if self.taps.members:
            self.taps.received(chunk)
        self._heard_at = self._now()
        self.frame_log.is_on = is_logged(DEBUG)
        if self._lifecycle.state is not _READY:
            self._keep_evidence(chunk)
        frames = self._parser.feed(chunk)
        self._scheduler.hold()
        try:
            for frame in frames:
                content = frame[1]  # a byte is found in a tenth of the time of MAGIC
                if ((_RARE in content and MAGIC in content) or self._nested.inside) and self._nested.hides(frame):
                    stats.hidden += 1
                else:
                    self._take(frame)
            if self._load is not None:
                self._learn(self._load)
        finally:
            self._scheduler.go_on()
        if self.later:
            self._call_later()
        if len(frames) > 1:
            self.on_several()

    def _keep_evidence(self, chunk: bytes) -> None:
        """Keep what comes before a connection is ready: it explains why no board answers."""
        if self._lifecycle.opening is not None:
            self._lifecycle.opening.seen(chunk)
        elif self._lifecycle.state in {State.NEW, State.UNPROVED}:
            self.early += chunk[: _MOST_EARLY - len(self.early)]

    def lost(self, error: Exception | None, /) -> None:
        """End the connection: the transport has ended."""
        self.end(lost(self._url, error))

    # --- from the sending half ----------------------------------------------------------------------------------

    def open(self, slot: Slot) -> None:
        """Wait for the response of a slot; called before the request is written."""
        now, silence, timer = slot.sent_at, self._silence, self._timer
        if not self._slots.live:
            self._restarted_at, self._arrival = now, None
        self._slots.open(slot)
        if silence.since is None:
            silence.begin(now)
        silence.sendings += 1
        if (deadline := now + slot.timeout) < timer.deadline:
            timer.arm(deadline)

    def leave(self, call: Call) -> None:
        """End a call. Without a response, the latest slot keeps the permit as long as a response is expected."""
        call.is_over = True
        slot, call.latest = call.latest, None  # else a cycle for the garbage collector
        if call.is_aside:
            self._scheduler.step_back()
            return
        if slot is not None and slot.open and not slot.overdue:
            if call.response is None:
                slot.holds_permit_of = call.packet
                return
            # An older slot got the response, most likely the response to this slot: no other is expected.
            self._slots.expire(slot)
        self._scheduler.release(call.packet)

    def open_stop(self, slot: Slot) -> None:
        """Open the slot of a stop. Responses to calls on the same lane can no longer be told from its response."""
        for other in slot.lane.slots:
            self._mark_overdue(other)
            if other.call is not None and not other.call.is_over and not other.is_fence:
                other.call.error = overtaken(other.request)
                other.call.wake()
        self._slots.open_stop(slot)
        if self._lifecycle.opening is not None:
            self._lifecycle.opening.begin_again()

    def close_all(self) -> None:
        """Close all slots unanswered: the connection is opened again, or has ended."""
        self._report([(slot, None) for slot in self._slots.clear()])

    def end(self, error: ConnectionLost) -> None:
        """End the connection: all waiting calls get the first cause."""
        opening = self._lifecycle.opening
        if not self._lifecycle.end(error):
            return
        self.over.set_result(None)
        self._timer.stop()
        if opening is not None:
            opening.end(error)
        self._scheduler.refuse_all(lambda: same(error))
        self.close_all()
        self.on_end(error)

    # --- one frame ----------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        self.stats.frames_received += 1
        self._silence.since = None
        if self.frame_log.is_on:
            self.frame_log.received(frame)
        packet_id, content = frame
        slots = self._slots
        lane = slots.lanes.get(packet_id)
        opening = self._lifecycle.opening
        if lane is not None:
            if self._learns and len(content) + OVERHEAD != lane.response_size:
                lane.heard(len(content) + OVERHEAD)
            if lane.slots and opening is None:
                slot = slots.only_origin(lane)
                if slot is None or slot.call is None or not self._answer(slot, slot.call, content):
                    self._settle(packet_id, content)
                return
        if packet_id == ButtonEventResponse.packet_id:
            self.stats.events_received += 1
            if opening is not None:
                opening.heard_event()
            self.on_event(self._codec.decode(packet_id, content))  # type: ignore[arg-type]  # the id says so
        elif opening is None:
            self.stats.unsolicited += 1
            self.on_stranger(packet_id)
        elif lane is not None:
            opening.heard(packet_id, content)

    def _answer(self, slot: Slot, call: Call, content: bytes) -> bool:
        """Pass a response to the call of the oldest slot of all, as `_settle` does for all cases in more steps.

        Return False, with nothing done, unless this is the first response, in time, to a call that waits for it.
        """
        if call.is_over or call.response is not None or slot.is_fence or slot.holds_permit_of is not None:
            return False
        request, sent_at = slot.request, slot.sent_at
        try:
            response: Any = self._codec.decode(request.packet_id + 1, content)
        except DecodeError:
            return False
        if not request.accepts(response):
            return False
        load = self._load
        if load is None and self._learns:
            load = self._load = self._scheduler.load()
        self._slots.close_only_origin(slot)
        heard_at, free_at = self._heard_at, self._restarted_at
        self._restarted_at, self._arrival = heard_at, None
        self.answered_in_a_row += 1
        if load is not None:
            load.responses += 1
            if sent_at < free_at and not self._expired:
                load.due += 1
                load.size += len(content) + OVERHEAD
                load.seconds += heard_at - free_at
            self._expired = False
        seconds = heard_at - (free_at if free_at > sent_at else sent_at)
        if seconds > 0.0:
            self.times.record(request.packet_id, seconds)
        self.stats.round_trips.append(heard_at - sent_at)
        call.open_slots -= 1
        call.response = response
        woken = call.woken
        if call.on_wake is not None:
            call.content = content
            call.on_wake(call)
        elif woken is not None and not woken.done():
            woken.set_result(None)
        return True

    def _settle(self, packet_id: int, content: bytes) -> None:
        decoded: Content
        try:
            decoded = self._codec.decode(packet_id, content)  # type: ignore[assignment]  # lanes are response ids
        except DecodeError as error:
            self.stats.undecodable += 1
            decoded = error
        load = self._load
        if load is None and self._learns:
            load = self._load = self._scheduler.load()
        slots = self._slots
        settled = slots.settle(packet_id, decoded)
        if slots.answer_twice:
            self.stats.repeated = slots.repeated
        if settled is None:
            self.stats.mismatched += 1
            return
        free_at = self._restarted_at
        if settled:
            slot, answer = settled[-1]
            call = slot.call
            if call is not None and call.on_wake is not None and answer is decoded:
                call.content = content
            self._restarted_at, self._arrival = self._heard_at, None
            if load is not None:
                if slot.sent_at < free_at and not self._expired:
                    load.due += 1
                    load.size += len(content) + OVERHEAD
                    load.seconds += self._heard_at - free_at
                self._expired = False
        self._report(settled, free_at, load)

    def _report(self, settled: list[Settled], free_at: float = 0.0, load: Load | None = None) -> None:
        """Notify the calls of slots that are over; then further requests may be sent.

        The board was free to respond to the slot that was answered from `free_at` on. With `load`, the depth is learnt.
        """
        for slot, content in settled:
            call = slot.call
            if content is None:
                self._lost_one(slot, load)
            else:
                self._answered(slot, call, free_at, load)
            if slot.holds_permit_of is not None:
                self._release_permit(slot)
            if call is None:
                continue
            if slot.is_fence:
                call.wake()
                continue
            call.open_slots -= 1
            if call.is_over or call.response is not None:
                self.stats.late_responses += content is not None
            elif content is None or isinstance(content, DecodeError):
                call.fault = content or call.fault
                if not call.open_slots or content is not None:
                    call.unanswered += 1
                    call.wake()
            else:
                self.stats.round_trips.append(self._heard_at - slot.sent_at)
                call.response = content
                call.wake()

    def _lost_one(self, slot: Slot, load: Load | None) -> None:
        """Learn from a slot that is over without a response."""
        self.answered_in_a_row = 0
        if load is not None and not slot.overdue:  # an overdue slot was counted before
            load.climb.lost()

    def _answered(self, slot: Slot, call: Call | None, free_at: float, load: Load | None) -> None:
        """Learn from the response to a slot."""
        self.answered_in_a_row += 1
        if call is not None and call.response is not None:
            self.times.late()  # the call had a response already
        elif not slot.overdue:  # a response to an overdue slot may belong to another sending
            seconds = self._heard_at - (free_at if free_at > slot.sent_at else slot.sent_at)
            if seconds > 0.0:  # else it came in one chunk with another one, and its time is not known
                self.times.record(slot.request.packet_id, seconds)
        elif call is None or call.is_over:
            self.times.late()
        if load is not None and not slot.is_fence:
            load.responses += 1

    def _learn(self, load: Load) -> None:
        """Learn from all responses of a chunk at once."""
        self._load = None
        self._scheduler.learn(load, self._heard_at)

    def _call_later(self) -> None:
        while self.later:
            self.later.popleft()()

    # --- deadlines ----------------------------------------------------------------------------------------------

    def count_from_now(self) -> None:
        """Count all times from now: the board could not answer before."""
        self._restart(self._now())
        self._silence.count_from(self._now())

    def _restart(self, now: float) -> None:
        """Count the time of the oldest slot from now: no older slot delays the response."""
        self._restarted_at = now
        self._arrival = None

    def _look(self, now: float) -> None:
        """Mark the oldest slot overdue after its deadline; a stalled event loop has read everything by now."""
        live = self._slots.live
        self._scheduler.hold()
        try:
            if self._lifecycle.state is State.SUSPENDED:
                self._restart(now)
            if live and now >= self._due(live[0]) and self._parser.partial_frame:
                self._await_partial_frame(live[0], now)
            if live and now >= self._due(live[0]):
                self._expire(live[0], now)
            if live and self._lifecycle.ended is None:
                self._timer.arm(self._due(live[0]))
        finally:
            self._scheduler.go_on()
        if self.later:
            self._call_later()

    def _earliest_due(self) -> float | None:
        return self._due(self._slots.live[0]) if self._slots.live else None

    def _due(self, slot: Slot) -> float:
        due = max(self._restarted_at, slot.sent_at) + slot.timeout
        return due if self._arrival is None else max(due, self._arrival.paused_until)

    def _mark_overdue(self, slot: Slot) -> None:
        if not slot.overdue:
            self._slots.expire(slot)
        self._release_permit(slot)

    def _release_permit(self, slot: Slot) -> None:
        packet, slot.holds_permit_of = slot.holds_permit_of, None
        if packet is not None:
            self._scheduler.release(packet)

    def _expire(self, slot: Slot, now: float) -> None:
        self.stats.timeouts += 1
        self.answered_in_a_row = 0
        self._mark_overdue(slot)
        self._restart(now)
        if self._learns:
            self._expired = True
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
            self.lost(TimeoutError(f"the board has left {_MOST_OVERDUE} queries in a row unanswered"))
        if not (seconds := self._silence.seconds(now)):
            return
        calls = [slot.call for lane in self._slots.lanes.values() for slot in lane.slots if slot.call is not None]
        patience = max([self._patience, *(call.patience for call in calls if not call.is_over)])
        if seconds >= _SILENT_PATIENCES * patience:
            self.lost(TimeoutError(f"the board has sent nothing for {seconds:.1f} s"))

    def _await_partial_frame(self, slot: Slot, now: float) -> None:
        """Put the deadline off while a response, or anything else, is arriving; else give a false start up."""
        while self._parser.partial_frame:
            arrival = self._arrival = self._arrival or _Arrival()
            packet_id, received, total = self._parser.partial_frame
            lane = self._slots.lanes.get(packet_id)
            # By the rate, as tries can be short: at 115200 baud the longest list takes 6 s.
            least = total * (now - self._restarted_at) / _LONGEST_ARRIVAL
            if lane is not None and lane.slots and received - arrival.received >= least:
                self._restarted_at, arrival.received = now, received
                return
            if now < self._heard_at + _PAUSE and arrival.pauses < _MOST_PAUSES:
                arrival.pauses += 1
                arrival.paused_until = self._heard_at + _PAUSE
                return
            for frame in self._parser.abandon_frame():
                self._take(frame)


def _parser_for(byte_order: ByteOrder, *, ignore_extra: bool) -> FrameParser:
    if not ignore_extra:
        return FrameParser(byte_order)
    from servolink.protocol.lenient import LenientParser  # late: most boards send what the document says

    return LenientParser(byte_order)
