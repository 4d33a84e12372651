"""Answers: a link's receiving half, from bytes to the future that waits for them.

Everything happens in the call that brings the bytes: parser, lane, future. Only an answer, a deadline or the end
of the link ends a sending, never the task that waits for it: a cancelled request keeps its lane until then.
"""

from __future__ import annotations

from collections.abc import Callable

from servolink.client.deadlines import Deadlines
from servolink.client.explain import lost, overtaken, same
from servolink.client.lanes import Lane, Lanes, Pending
from servolink.client.stats import Stats
from servolink.client.turns import Turns
from servolink.errors import ConnectionLost, DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import Frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.packet import Response
from servolink.protocol.parser import FrameParser
from servolink.protocol.settings import ClearAllDataRequest


class Answers:
    """The receiver of a link's transport."""

    def __init__(self, url: str, codec: Codec, lanes: Lanes, turns: Turns, now: Callable[[], float]) -> None:
        """Give what comes from `url` to `lanes`, and their turns back to `turns`."""
        self.stats = Stats()
        self.ended: ConnectionLost | None = None
        """What ended the link; None while it is up."""
        self.on_event: Callable[[ButtonEventResponse], None] = lambda event: None
        self.on_end: Callable[[ConnectionLost], None] = lambda error: None
        self._url = url
        self._codec = codec
        self._lanes = lanes
        self._turns = turns
        self._now = now
        self._parser = FrameParser(codec.byte_order)
        self.stats.skipped = self._parser.skipped
        self._deadlines = Deadlines(self._expire, lambda: self.stats.bytes_received)

    # --- from the transport -------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Take bytes from the transport."""
        self.stats.bytes_received += len(chunk)
        for frame in self._parser.feed(chunk):
            self._take(frame)

    def lost(self, error: Exception | None, /) -> None:
        """Take note that the transport has ended."""
        self.end(lost(self._url, error))

    # --- from the sending half ----------------------------------------------------------------------------------

    def expect(self, lane: Lane, pending: Pending) -> None:
        """Wait for an answer on `lane`, from before its request is written."""
        lane.pending = pending
        self._deadlines.arm(pending.deadline)

    def overtake(self, lane: Lane) -> None:
        """Let a sending on `lane` go before everything: what waits there is over, and its outcome unknown."""
        if (pending := lane.pending) is not None:
            self._over(lane, pending)
            _fail(pending, overtaken(pending.request))
        lane.dirty = self._lanes.next_number()

    def end(self, error: ConnectionLost) -> None:
        """End the link: the first cause reaches everyone who waits."""
        if self.ended is not None:
            return
        self.ended = error
        self._deadlines.stop()
        for lane, pending in list(self._lanes.pending()):
            lane.pending = None
            _fail(pending, same(error))
        self._turns.refuse_all(lambda: same(error))
        self.on_end(error)

    # --- one frame ----------------------------------------------------------------------------------------------

    def _take(self, frame: Frame) -> None:
        self.stats.frames_received += 1
        packet_id, content = frame
        lane = self._lanes.by_response_id.get(packet_id)
        if lane is None and packet_id != ButtonEventResponse.packet_id:
            self.stats.unsolicited += 1
        elif lane is not None and lane.pending is None and lane.rescue is None:
            if lane.dirty:
                self.stats.late_replies += 1
            else:
                self.stats.unsolicited += 1
        else:
            self._decode(lane, packet_id, content)

    def _decode(self, lane: Lane | None, packet_id: int, content: bytes) -> None:
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
        elif lane is not None and isinstance(packet, Response):
            self._answer(lane, packet)

    def _answer(self, lane: Lane, packet: Response) -> None:
        pending = lane.pending
        request = pending.request if pending is not None else lane.asked
        if request is None or not request.accepts(packet):
            self.stats.mismatched += 1
        elif pending is None:
            self.stats.late_replies += 1
            if lane.rescue is not None and not lane.rescue.done():
                self.stats.rescued += 1
                lane.rescue.set_result(packet)
        else:
            self.stats.round_trips.append(self._now() - pending.sent_at)
            self._over(lane, pending)
            if pending.fence:
                self._lanes.settled_before(pending.number)
            if not pending.answer.done():
                pending.answer.set_result(packet)

    # --- the end of a sending -----------------------------------------------------------------------------------

    def _over(self, lane: Lane, pending: Pending) -> None:
        lane.pending = None
        if pending.abandoned:
            if pending.fence:
                self._turns.give_back_borrowed(lane)
            else:
                self._turns.give_back(lane)

    def _unanswered(self, lane: Lane, pending: Pending) -> None:
        lane.dirty = pending.number
        if isinstance(pending.request, ClearAllDataRequest):
            self._lanes.fence_first = pending.number  # done late, it would wipe whatever is sent now
        self._over(lane, pending)
        if not pending.answer.done():
            pending.answer.set_result(None)

    def _expire(self, now: float) -> None:
        due = [(lane, pending) for lane, pending in self._lanes.pending() if pending.deadline <= now]
        arriving = [self._is_arriving(lane, pending, now) for lane, pending in due]
        if due and not any(arriving):
            for frame in self._parser.give_up():
                self._take(frame)
        for lane, pending in due:
            if lane.pending is pending and pending.deadline <= now:
                self.stats.timeouts += 1
                self._unanswered(lane, pending)
        for _, pending in self._lanes.pending():
            self._deadlines.arm(pending.deadline)

    def _is_arriving(self, lane: Lane, pending: Pending, now: float) -> bool:
        """Move the deadline if this very answer is still arriving, at least a hundredth of it per timeout."""
        begun = self._parser.begun
        if begun is None or begun[0] != lane.response_id:
            return False
        _, received, wanted = begun
        if received - pending.received < wanted / 100:
            return False
        pending.received = received
        pending.deadline = now + pending.timeout
        return True


def _fail(pending: Pending, error: Exception) -> None:
    if not pending.answer.done():
        pending.answer.set_exception(error)
        pending.answer.exception()  # seen, so that nobody is warned if nobody waits for it any more
