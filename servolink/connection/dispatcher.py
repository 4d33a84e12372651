"""One timer for all deadlines of a link, which a stalled event loop cannot deceive."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from servolink.connection.explain import lost, overtaken, same
from servolink.connection.frame_log import FrameLog, frame_logger
from servolink.connection.lanes import Lane, Lanes, PendingRequest
from servolink.connection.scheduler import RequestScheduler
from servolink.connection.stats import Stats
from servolink.errors import ConnectionLost, DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import MAGIC, ByteOrder, Frame, encode_frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.packet import Response
from servolink.protocol.parser import FrameParser
from servolink.protocol.settings import ClearAllDataRequest

_MOST_LOOKS = 100  # a board that never stops sending must not put deadlines off for ever


class DeadlineTimer:
    """Calls `passed(now)` when the earliest deadline has passed and nothing more can be read that came before.

    After a stall the answer may already lie in the operating system's buffer. So the loop is let to read again,
    for as long as that brings bytes, before anything is declared late.
    """

    def __init__(self, passed: Callable[[float], None], received: Callable[[], int]) -> None:
        """`received` tells how many bytes have come so far."""
        self._loop = asyncio.get_running_loop()
        self._passed = passed
        self._received = received
        self._timer: asyncio.TimerHandle | None = None

    def arm(self, deadline: float) -> None:
        """Be sure to look at `deadline` (loop time); an earlier look stands."""
        if self._timer is None or deadline < self._timer.when():
            self.stop()
            self._timer = self._loop.call_at(deadline, self._reached, deadline)

    def stop(self) -> None:
        """Forget all deadlines."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _reached(self, deadline: float) -> None:
        self._timer = None
        self._look_again(deadline, -1, _MOST_LOOKS)

    def _look_again(self, deadline: float, received: int, looks: int) -> None:
        # Two turns of the loop: a turn runs its callbacks in the order found, ours before what it reads.
        self._loop.call_soon(self._loop.call_soon, self._look, deadline, received, looks)

    def _look(self, deadline: float, received: int, looks: int) -> None:
        now_received = self._received()
        if received != now_received and looks:
            self._look_again(deadline, now_received, looks - 1)
            return
        self._passed(max(deadline, self._loop.time()))  # a timer comes early by what the clock does not resolve


class NestedFrameFilter:
    """The latest frame, if others may begin inside it; they come right behind it, in their order."""

    def __init__(self, byte_order: ByteOrder) -> None:
        """Remember nothing yet."""
        self._byte_order: ByteOrder = byte_order
        self.inside = b""
        """What of it has not come out; empty if nothing begins in it."""

    def hides(self, frame: Frame) -> bool:
        """Tell whether `frame` begins inside the one before it; if not, it is the one before the next."""
        data = encode_frame(*frame, self._byte_order)
        begins = self._beginning(data)
        if begins is None:
            self.inside = data[1:] if MAGIC in frame[1] else b""
            return False
        self.inside = self.inside[begins + len(data) :]
        return True

    def _beginning(self, data: bytes) -> int | None:
        """Return where in the carrier `data` begins, whole or up to the carrier's end."""
        at = self.inside.find(MAGIC)
        while at >= 0:
            if data.startswith(self.inside[at : at + len(data)]):
                return at
            at = self.inside.find(MAGIC, at + 1)
        return None


_PAUSE = 0.05
"""Seconds without a byte after which a begun frame is no longer taken to be arriving."""
_MOST_PAUSES = 20  # a board that never stops sending must not put deadlines off for ever


class ResponseDispatcher:
    """The receiver of a link's transport."""

    def __init__(
        self, url: str, codec: Codec, lanes: Lanes, turns: RequestScheduler, now: Callable[[], float], stats: Stats
    ) -> None:
        """Give what comes from `url` to `lanes`, and their turns back to `turns`; go on counting in `stats`."""
        self.stats = stats
        self.ended: ConnectionLost | None = None
        """What ended the link; None while it is up."""
        self.on_event: Callable[[ButtonEventResponse], None] = lambda event: None
        self.on_end: Callable[[ConnectionLost], None] = lambda error: None
        self.frame_log = FrameLog(url, codec, now)
        self._url = url
        self._codec = codec
        self._lanes = lanes
        self._turns = turns
        self._now = now
        self._heard_at = 0.0
        self._silent_since = now() if lanes.owing else None  # by what it was asked on the connection before
        self._next_answer: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._parser = FrameParser(codec.byte_order)
        self._carrier = NestedFrameFilter(codec.byte_order)
        self._parser.skipped = stats.skipped
        self._deadlines = DeadlineTimer(self._expire, lambda: self.stats.bytes_received)

    # --- from the transport -------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Take bytes from the transport."""
        self.stats.bytes_received += len(chunk)
        self._heard_at = self._now()
        for frame in self._parser.feed(chunk):
            if (MAGIC in frame[1] or self._carrier.inside) and self._carrier.hides(frame):
                self.stats.hidden += 1
            else:
                self._take(frame)

    def lost(self, error: Exception | None, /) -> None:
        """Take note that the transport has ended."""
        self.end(lost(self._url, error))

    # --- from the sending half ----------------------------------------------------------------------------------

    def expect(self, lane: Lane, pending: PendingRequest) -> None:
        """Wait for an answer on `lane`, from before its request is written."""
        lane.pending = pending
        if self._silent_since is None:
            self._silent_since = pending.sent_at
        self._deadlines.arm(pending.deadline)

    def overtake(self, lane: Lane, sending: PendingRequest) -> None:
        """Let `sending` go before everything: what waits on `lane` is over, and its outcome unknown."""
        sending.ambiguous = bool(lane.pending or lane.owed)
        if (pending := lane.pending) is not None:
            self._over(lane, pending)
            _fail(pending, overtaken(pending.request))
        self._lanes.owe(lane, sending)

    def next_answer(self) -> asyncio.Future[None]:
        """Return a future that is done at the next answer to any sending, late or not, and when the link ends."""
        if self._next_answer.done():
            self._next_answer = self._next_answer.get_loop().create_future()
        return self._next_answer

    def silent_for(self) -> float:
        """Return for how long, in seconds, the board has been asked without answering anything."""
        return 0.0 if self._silent_since is None else self._now() - self._silent_since

    def end(self, error: ConnectionLost) -> None:
        """End the link: the first cause reaches everyone who waits."""
        if self.ended is not None:
            return
        self.ended = error
        self._deadlines.stop()
        for lane, pending in list(self._lanes.pending()):
            lane.pending = None
            self._lanes.owe(lane, pending)  # to the next link
            _fail(pending, same(error))
        self._turns.refuse_all(lambda: same(error))
        self._wake()
        self.on_end(error)

    # --- one frame ----------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        self.stats.frames_received += 1
        if frame_logger.isEnabledFor(logging.DEBUG):
            self.frame_log.received(frame)
        packet_id, content = frame
        lane = self._lanes.by_response_id.get(packet_id)
        wanted = lane is not None and (lane.pending or lane.owed)
        if not wanted and packet_id != ButtonEventResponse.packet_id:
            self.stats.unsolicited += 1
            return
        try:
            packet = self._codec.decode(packet_id, content)
        except DecodeError as error:
            self.stats.undecodable += 1
            if lane is not None and lane.pending is not None:
                lane.pending.fault = error
                self._unanswered(lane, lane.pending)
            return
        if isinstance(packet, ButtonEventResponse):
            self.stats.events_received += 1
            self.on_event(packet)
        else:
            self._answer(lane, packet)  # type: ignore[arg-type]  # what else is wanted is a response, on a lane

    def _wake(self) -> None:
        if not self._next_answer.done():
            self._next_answer.set_result(None)

    def _answer(self, lane: Lane, packet: Response) -> None:
        """Give `packet` to the sending it answers; a lane that waits is clean, so it is never one of the owed."""
        sending = lane.pending or lane.owed
        if sending is None or not sending.request.accepts(packet):
            self.stats.mismatched += 1
            return
        self._silent_since = None
        if not sending.ambiguous:
            self._lanes.answered(sending.number)
        self._wake()
        if sending is not lane.pending:
            self.stats.late_responses += 1
            lane.late = packet
            return
        self.stats.round_trips.append(self._heard_at - sending.sent_at)
        self._over(lane, sending)
        if not sending.answer.done():
            sending.answer.set_result(packet)

    # --- the end of a sending -----------------------------------------------------------------------------------

    def _over(self, lane: Lane, pending: PendingRequest) -> None:
        lane.pending = None
        if pending.abandoned:
            if pending.borrowed:
                self._turns.give_back_borrowed(lane)
            else:
                self._turns.give_back(lane)

    def _unanswered(self, lane: Lane, pending: PendingRequest) -> None:
        self._lanes.owe(lane, pending)
        if isinstance(pending.request, ClearAllDataRequest):
            self._lanes.fence_first = pending.number  # done late, it would wipe whatever is sent now
        self._over(lane, pending)
        if not pending.answer.done():
            pending.answer.set_result(None)

    def _expire(self, now: float) -> None:
        due = [(lane, pending) for lane, pending in self._lanes.pending() if pending.deadline <= now]
        while due and self._parser.partial_frame and not self._is_arriving(due, now):
            for frame in self._parser.abandon_frame():
                self._take(frame)
        for lane, pending in due:
            if lane.pending is pending and pending.deadline <= now:
                self.stats.timeouts += 1
                self._unanswered(lane, pending)
        for _, pending in self._lanes.pending():
            self._deadlines.arm(pending.deadline)

    def _is_arriving(self, due: list[tuple[Lane, PendingRequest]], now: float) -> bool:
        """Tell whether the begun frame is no false start; move the deadlines that it may hold back."""
        packet_id, received, wanted = self._parser.partial_frame or (0, 0, 0)
        lane = self._lanes.by_response_id.get(packet_id)
        if lane is not None and lane.pending is not None and _goes_on(lane.pending, now, received, wanted):
            return True
        if now >= self._heard_at + _PAUSE:
            return False
        waiting = [pending for lane, pending in due if lane.pending is pending and pending.pauses < _MOST_PAUSES]
        for pending in waiting:  # an event, or what came late: give it the time to end
            pending.pauses += 1
            pending.deadline = max(pending.deadline, self._heard_at + _PAUSE)
        return bool(waiting)


def _goes_on(pending: PendingRequest, now: float, received: int, wanted: int) -> bool:
    """Move a deadline if this very answer is still arriving, at least a hundredth of it per timeout."""
    if pending.deadline > now:
        return True  # its own deadline decides, not that of another
    if received - pending.received < wanted / 100:
        return False
    pending.received = received
    pending.deadline = now + pending.timeout
    return True


def _fail(pending: PendingRequest, error: Exception) -> None:
    if not pending.answer.done():
        pending.answer.set_exception(error)
        pending.answer.exception()  # seen, so that nobody is warned if nobody waits for it any more
