"""Link: the conversation with one board over one transport.

A byte's way up ends here in one call: transport, parser, lane, future. A request's way down: it is encoded, waits
for its turn, proves with a fence that its lane is clean, and is sent; then its future is the truth. Only the
shared deadline timer and the answers themselves end a sending, never the task that waits for it.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any, TypeVar

from servolink.client.deadlines import Deadlines
from servolink.client.explain import lost, outcome_unknown, overtaken, same, timed_out
from servolink.client.lanes import Lane, Lanes, Pending
from servolink.client.stats import Stats
from servolink.client.turns import Turns
from servolink.errors import ConnectionLost, DecodeError, RequestError
from servolink.protocol.codec import Codec
from servolink.protocol.editing import ExecuteMacroRequest, QueryProjectIDRequest
from servolink.protocol.frame import Frame
from servolink.protocol.joystick import ButtonEventResponse, QueryActiveJoystickTableRequest
from servolink.protocol.packet import Command, Query, Request, Response
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import ExecuteActionExRequest, ExecuteActionRequest, SetServoParameterRequest
from servolink.protocol.settings import ClearAllDataRequest, QueryMemorySizeRequest, QueryRemainPowerRequest
from servolink.transports.base import Transport

R = TypeVar("R", bound=Response)

FENCES = (
    QueryProjectIDRequest(),
    QueryMemorySizeRequest(),
    QueryRemainPowerRequest(),
    QueryActiveJoystickTableRequest(),
)
"""Queries with short answers, used in turn: a late answer to one must not pass for an answer to the next."""


class Link:
    """Matches answers to requests that carry no number, and never wrongly (docs/design/matching.md)."""

    def __init__(
        self, transport: Transport, codec: Codec, *, timeout: float = 1.0, retries: int = 2, window: int = 1
    ) -> None:
        """Wait `timeout` seconds for each answer, repeat queries `retries` times, keep `window` requests on the line."""
        self.transport = transport
        self.codec = codec
        self.timeout = timeout
        self.retries = retries
        self.stats = Stats()
        self.stops = 0
        """How many times everything was stopped; a movement asked for before a stop is not sent after it."""
        self.ended: ConnectionLost | None = None
        """What ended the link; None while it is up."""
        self.on_event: Callable[[ButtonEventResponse], None] = lambda event: None
        self.on_lost: Callable[[ConnectionLost | None], None] = lambda error: None
        self._parser = FrameParser(codec.byte_order)
        self.stats.skipped = self._parser.skipped
        self._lanes = Lanes()
        self._turns = Turns(window)
        self._fences = deque(FENCES)
        self._deadlines = Deadlines(self._expire, lambda: self.stats.bytes_received)
        self._loop = asyncio.get_running_loop()

    async def open(self) -> None:
        """Open the transport; OpenError says what to do."""
        await self.transport.open(self)

    async def close(self) -> None:
        """Fail whoever still waits and free the port; may be called again."""
        self._end(lost(self.transport.url, None))
        await self.transport.close()

    # --- down ---------------------------------------------------------------------------------------------------

    async def request(
        self, packet: Request[R], *, timeout: float | None = None, retries: int | None = None, first: bool = False
    ) -> R:
        """Send `packet` and return its answer.

        Queries are repeated `retries` times within `timeout * (retries + 1)` seconds and raise RequestTimeout;
        what changes the board is sent once and raises OutcomeUnknown. `first` goes before all who wait.
        """
        frame = self.codec.encode(packet)
        lane = self._lanes.of(packet)
        stops = self.stops
        await self._take_turn(lane, alone=isinstance(packet, ClearAllDataRequest), first=first)
        try:
            return await self._exchange(packet, frame, lane, timeout or self.timeout, retries, stops)
        finally:
            if lane.pending is None:
                self._turns.give_back(lane)
            else:
                lane.pending.abandoned = True  # its turn lasts until it is answered or too late

    async def send(self, packet: Command, *, unless_stopped_since: int | None = None) -> None:
        """Send a packet that is never answered; returns when it is sent."""
        frame = self.codec.encode(packet)
        stops = self.stops if unless_stopped_since is None else unless_stopped_since
        await self._take_turn(None)
        try:
            if self._lanes.fence_first:
                await self._fence(None, self._loop.time() + self.timeout * (self.retries + 1))
            self._refuse_if_stopped(packet, stops)
            await self._write(frame)
        finally:
            self._turns.give_back(None)

    async def send_stop(self, packet: SetServoParameterRequest) -> None:
        """Send `packet` before everything else, without waiting for anything, not even its answer."""
        self._raise_if_ended()
        self.stops += 1
        lane = self._lanes.of(packet)
        pending = lane.pending
        if pending is not None:
            self._over(lane, pending)
            _fail(pending, overtaken(pending.request))
        lane.dirty = self._lanes.next_number()
        await self._write(self.codec.encode(packet))

    async def _take_turn(self, lane: Lane | None, *, alone: bool = False, first: bool = False) -> None:
        self._raise_if_ended()
        await self._turns.take(lane, alone=alone, first=first)
        if self.ended is not None:
            self._turns.give_back(lane)
            self._raise_if_ended()

    async def _exchange(
        self, packet: Request[R], frame: bytes, lane: Lane, timeout: float, retries: int | None, stops: int
    ) -> R:
        begun = self._loop.time()
        repeats = 0 if not isinstance(packet, Query) else self.retries if retries is None else retries
        until = begun + timeout * (max(repeats, self.retries) + 1)
        fault: DecodeError | None = None
        tries = 0
        while tries <= repeats and (tries == 0 or self._loop.time() < until):
            if lane.dirty or self._lanes.fence_first:
                rescued = await self._fence(lane, until, packet if tries else None)
                if rescued is not None:
                    return rescued  # type: ignore[return-value]  # accepts() and the lane's id vouch for it
                if lane.dirty or self._lanes.fence_first:
                    break
            self._refuse_if_stopped(packet, stops)
            tries += 1
            self.stats.retries += tries > 1
            pending = await self._send_pending(packet, frame, lane, timeout)
            answer = await pending.answer
            if answer is not None:
                return answer  # type: ignore[return-value]  # likewise
            fault = pending.fault
        waited = self._loop.time() - begun
        if tries and not isinstance(packet, Query):
            raise outcome_unknown(packet, self.transport.url, waited, fault)
        raise fault or timed_out(packet, self.transport.url, tries, waited, self.stats)

    async def _send_pending(
        self, packet: Request[Any], frame: bytes, lane: Lane, timeout: float, *, fence: bool = False
    ) -> Pending:
        now = self._loop.time()
        answer: asyncio.Future[Response | None] = self._loop.create_future()
        pending = Pending(packet, self._lanes.next_number(), now, now + timeout, timeout, answer, fence=fence)
        lane.pending = pending
        self._deadlines.arm(pending.deadline)
        await self._write(frame)
        return pending

    async def _write(self, frame: bytes) -> None:
        self._raise_if_ended()
        self.stats.frames_sent += 1
        self.stats.bytes_sent += len(frame)
        try:
            await self.transport.send(frame)
        except ConnectionLost as error:
            self._end(error)
            raise

    def _refuse_if_stopped(self, packet: Request[Any] | Command, stops: int) -> None:
        moves = isinstance(packet, (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest)) or (
            isinstance(packet, SetServoParameterRequest) and packet.is_start == 1
        )
        if moves and stops != self.stops:
            raise RequestError(f"{type(packet).__name__} was not sent: a stop came first", packet)

    # --- fences -------------------------------------------------------------------------------------------------

    async def _fence(self, own: Lane | None, until: float, packet: Request[Any] | None = None) -> Response | None:
        """Prove that every late answer has come or never will; return one that came for `packet` meanwhile.

        The board answers in order, so the answer to a query sent now comes after everything it still owes.
        Each fence that is not answered waits twice as long as the one before it. Returns without proof when
        `until` has passed; raises ConnectionLost when no fence is left that could prove anything.
        """
        late: asyncio.Future[Response | None] = self._loop.create_future()
        if own is not None and packet is not None:
            own.rescue, own.asked = late, packet
        try:
            timeout = self.timeout
            while (left := until - self._loop.time()) > 0:
                pending = await self._send_fence(own, timeout, late, left)
                if late.done():
                    return late.result()
                if not pending.answer.done() or pending.answer.result() is not None:
                    return None
                timeout *= 2
            return None
        finally:
            if own is not None:
                own.rescue = own.asked = None

    async def _send_fence(
        self, own: Lane | None, timeout: float, late: asyncio.Future[Response | None], patience: float
    ) -> Pending:
        """Send the next fence and wait until it is over, or `late` has come, or `patience` is at its end."""
        lane, query = await self._next_fence(own)
        self.stats.fences += 1
        try:
            pending = await self._send_pending(query, self.codec.encode(query), lane, timeout, fence=True)
            await asyncio.wait((pending.answer, late), timeout=patience, return_when=asyncio.FIRST_COMPLETED)
            return pending
        finally:
            if lane.pending is None:
                self._turns.give_back_borrowed(lane)
            else:
                lane.pending.abandoned = True

    async def _next_fence(self, own: Lane | None) -> tuple[Lane, Query[Any]]:
        """Return the next fence whose lane is clean; the link is broken if there is none."""
        while True:
            self._raise_if_ended()
            self._fences.rotate(-1)
            clean = {lane: query for query in self._fences if not (lane := self._lanes.of(query)).dirty and lane is not own}
            if not clean:
                silent = TimeoutError("the board answered none of the queries that would show that it still listens")
                self._end(lost(self.transport.url, silent))
                self._raise_if_ended()
            lane = await self._turns.borrow(list(clean))
            if not lane.dirty:
                return lane, clean[lane]
            self._turns.give_back_borrowed(lane)

    # --- up -----------------------------------------------------------------------------------------------------

    def data(self, chunk: bytes, /) -> None:
        """Take bytes from the transport."""
        self.stats.bytes_received += len(chunk)
        for frame in self._parser.feed(chunk):
            self._take(frame)

    def lost(self, error: Exception | None, /) -> None:
        """Take note that the transport has ended."""
        self._end(lost(self.transport.url, error))

    def _take(self, frame: Frame) -> None:
        self.stats.frames_received += 1
        packet_id, content = frame
        lane = self._lanes.by_response_id.get(packet_id)
        wanted = lane is not None and (lane.pending is not None or lane.rescue is not None)
        if not wanted and packet_id != ButtonEventResponse.packet_id:
            if lane is not None and lane.dirty:
                self.stats.late_replies += 1
            else:
                self.stats.unsolicited += 1
            return
        try:
            packet = self.codec.decode(packet_id, content)
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
        request = pending.request if pending else lane.asked
        if request is None or not request.accepts(packet):
            self.stats.mismatched += 1
        elif pending is None:
            self.stats.late_replies += 1
            if lane.rescue is not None and not lane.rescue.done():
                self.stats.rescued += 1
                lane.rescue.set_result(packet)
        else:
            self.stats.round_trips.append(self._loop.time() - pending.sent_at)
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
        if due and not any(self._is_arriving(lane, pending, now) for lane, pending in due):
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

    def _end(self, error: ConnectionLost) -> None:
        if self.ended is not None:
            return
        self.ended = error
        self._deadlines.stop()
        for lane, pending in list(self._lanes.pending()):
            lane.pending = None
            _fail(pending, same(error))
        self._turns.refuse_all(lambda: same(error))
        self.on_lost(error)

    def _raise_if_ended(self) -> None:
        if self.ended is not None:
            raise same(self.ended)


def _fail(pending: Pending, error: Exception) -> None:
    if not pending.answer.done():
        pending.answer.set_exception(error)
        pending.answer.exception()  # seen, so that nobody is warned if nobody waits for it any more
