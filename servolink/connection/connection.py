"""Link: the conversation with one board over one transport; here its sending half.

A request is encoded, waits for its turn, proves with a fence that its lane is clean, and is sent; then its future
is the truth, which `answers.py` settles.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from typing import Any, NoReturn, TypeVar

from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.explain import lost, outcome_unknown, same, timed_out
from servolink.connection.frame_log import frame_logger
from servolink.connection.lanes import Lane, Lanes, PendingRequest
from servolink.connection.scheduler import PendingDrain, RequestScheduler
from servolink.connection.stats import Stats
from servolink.errors import ConnectionLost, DecodeError, RequestError
from servolink.escaping import escape
from servolink.protocol.codec import Codec
from servolink.protocol.editing import ExecuteMacroRequest, QueryActionRequest, QueryMacroRequest, QueryProjectIDRequest
from servolink.protocol.joystick import QueryActiveJoystickTableRequest, QueryJoystickTableRequest
from servolink.protocol.packet import Command, Query, Request, Response
from servolink.protocol.servos import (
    ExecuteActionExRequest,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
)
from servolink.protocol.settings import ClearAllDataRequest, QueryMemorySizeRequest, QueryRemainPowerRequest
from servolink.transports.base import Transport

R = TypeVar("R", bound=Response)

FENCES: tuple[Query[Any], ...] = (
    QueryProjectIDRequest(),
    QueryMemorySizeRequest(),
    QueryRemainPowerRequest(),
    QueryActiveJoystickTableRequest(),
)
"""Queries with short answers, used in turn: a late answer to one must not pass for an answer to the next."""
MORE_FENCES: tuple[Query[Any], ...] = (
    QueryServoListRequest(),
    QueryServoRequest(1),
    QueryActionRequest(0),
    QueryMacroRequest(0),
    QueryJoystickTableRequest(0),
)
"""Used while answers to those may come that were sent before this connection."""


_LEAST = 0.01
"""A query is not repeated when less than this share of its timeout is left: nothing could answer it."""
_SILENCE = 8
"""A board that has answered nothing for so many timeouts, whatever it was asked, is gone."""


class Connection:
    """Asks one board, and never takes one answer for another (docs/design/matching.md)."""

    def __init__(
        self,
        transport: Transport,
        codec: Codec,
        *,
        timeout: float = 1.0,
        retries: int = 2,
        window: int = 1,
        stats: Stats | None = None,
        before: Connection | None = None,
    ) -> None:
        """Wait `timeout` seconds for an answer, repeat queries `retries` times, keep `window` requests on the line.

        What is still owed to `before`, an earlier link to the same board, is not taken for an answer to this one.
        """
        self.transport = transport
        self.stops = 0
        """How many times everything was stopped; a movement asked for before a stop is not sent after it."""
        self.units_sent = 0
        """How many times an angle unit was sent; an angle from before one means something else after it."""
        self.codec = codec
        self._timeout = timeout
        self._retries = retries
        self._loop = asyncio.get_running_loop()
        self.lanes: Lanes = Lanes() if before is None else _lanes_after(before.lanes)
        self._turns = RequestScheduler(window)
        self._leaving = PendingDrain(transport, self._turns)
        self._fences = deque(FENCES)
        self.stats = stats or Stats()
        """What the link has seen."""
        self.answers = ResponseDispatcher(transport.url, codec, self.lanes, self._turns, self._loop.time, self.stats)

    async def open(self) -> None:
        """Open the transport; OpenError says what to do."""
        await self.transport.open(self.answers)

    async def close(self) -> None:
        """Fail whoever still waits and free the port; may be called again."""
        self.answers.end(lost(self.transport.url, None))
        await self.transport.close()
        self._leaving.end()

    async def request(
        self,
        packet: Request[R],
        *,
        timeout: float | None = None,
        retries: int | None = None,
        first: bool = False,
        unchecked: bool = False,
    ) -> R:
        """Send `packet` and return its answer.

        Queries are repeated `retries` times within `timeout * (retries + 1)` seconds and raise RequestTimeout;
        what changes the board is sent once and raises OutcomeUnknown. `first` goes before all who wait; `unchecked`
        gives back what was read from a board (see Codec.encode).
        """
        if asyncio.get_running_loop() is not self._loop:
            self._refuse_loop()
        frame = self.codec.encode(packet, unchecked=unchecked)
        lane = self.lanes.of(packet)
        stops = self.stops
        alone = isinstance(packet, ClearAllDataRequest)
        if self.answers.ended is not None or not self._turns.take_at_once(lane, alone=alone):
            await self._take_turn(lane, alone=alone, first=first)
        try:
            answer = await self._exchange(packet, frame, lane, timeout or self._timeout, retries, stops)
        finally:
            if lane.pending is None:
                self._turns.give_back(lane)
            else:
                lane.pending.abandoned = True  # its turn lasts until it is answered or too late
        return answer  # type: ignore[return-value]  # the lane's id and accepts() vouch for it

    async def send(
        self, packet: Command, *, unless_stopped_since: int | None = None, unless_units_since: int | None = None
    ) -> bool:
        """Send a packet that is never answered; returns when it is sent, or False if it must not be any more.

        That is when `units_sent` is no longer `unless_units_since`. After a stop movements raise RequestError.
        """
        if asyncio.get_running_loop() is not self._loop:
            self._refuse_loop()
        frame = self.codec.encode(packet)
        stops = self.stops if unless_stopped_since is None else unless_stopped_since
        await self._take_turn(None)
        try:
            if self.lanes.in_doubt(None):
                patience = self._timeout * (self._retries + 1)
                await self._fence(None, self._loop.time() + patience)
                if self.lanes.in_doubt(None):
                    raise timed_out(packet, self.transport.url, 0, patience, self.stats)
            if stops != self.stops:
                self._refuse_if_moving(packet)
            if unless_units_since not in {None, self.units_sent}:
                return False
            await self._write(frame)
        finally:
            self._turns.give_back(None)
        return True

    async def send_stop(self, packet: SetServoParameterRequest) -> None:
        """Send `packet` before everything else, without waiting for anything, not even its answer."""
        if asyncio.get_running_loop() is not self._loop:
            self._refuse_loop()
        self._raise_if_ended()
        self.stops += 1
        self.answers.overtake(self.lanes.of(packet), self._sending(packet, self._timeout, self._loop.time()))
        await self._write(self.codec.encode(packet))

    def _refuse_loop(self) -> NoReturn:
        """Raise RuntimeError: a future of one event loop would never wake who waits in another."""
        raise RuntimeError(
            f"{escape(self.transport.url)} was connected in another event loop"
            f"{', which has ended: ' if self._loop.is_closed() else ': use it there, or '}connect again in this one"
        )

    async def _take_turn(self, lane: Lane | None, *, alone: bool = False, first: bool = False) -> None:
        self._raise_if_ended()
        await self._turns.take(lane, alone=alone, first=first)
        if self.answers.ended is not None:
            self._turns.give_back(lane)
            self._raise_if_ended()

    async def _exchange(
        self, packet: Request[Any], frame: bytes, lane: Lane, timeout: float, retries: int | None, stops: int
    ) -> Response:
        now = begun = self._loop.time()
        asks = isinstance(packet, Query)
        repeats = 0 if not asks else self._retries if retries is None else retries
        until = begun + timeout * (max(repeats, self._retries) + 1)
        fault: DecodeError | None = None
        tries = 0
        while tries <= repeats and (tries == 0 or until - now > timeout * _LEAST):
            if self.lanes.in_doubt(lane):
                late = await self._fence(lane, until)
                if late is not None and tries:  # the very answer that this query waited for
                    self.stats.rescued += 1
                    return late
                if self.lanes.in_doubt(lane):
                    break
                now = self._loop.time()
            if stops != self.stops:
                self._refuse_if_moving(packet)
            tries += 1
            if tries > 1:
                self.stats.retries += 1
            if asks and now < until < now + timeout:  # a change, or what a stall delayed, gets its whole time
                timeout = until - now
            pending = self._sending(packet, timeout, now)
            self.answers.expect(lane, pending)
            await self._write(frame)
            answer = await pending.answer
            if answer is not None:
                return answer
            fault = pending.fault
            now = self._loop.time()
        waited = self._loop.time() - begun
        if tries and not asks:
            raise outcome_unknown(packet, self.transport.url, waited)
        raise fault or timed_out(packet, self.transport.url, tries, waited, self.stats)

    def _sending(self, packet: Request[Any], timeout: float, now: float) -> PendingRequest:
        if isinstance(packet, SetAngleUnitRequest):
            self.units_sent += 1
        return PendingRequest(packet, self.lanes.next_number(), now, now + timeout, timeout, self._loop.create_future())

    async def _write(self, frame: bytes) -> None:
        self._raise_if_ended()
        self.stats.frames_sent += 1
        self.stats.bytes_sent += len(frame)
        if frame_logger.isEnabledFor(logging.DEBUG):
            self.answers.frame_log.sent(frame)
        try:
            await self.transport.send(frame)
        except ConnectionLost as error:
            self.answers.lost(error)
            raise
        except asyncio.CancelledError:
            self._leaving.hold()
            raise

    def _refuse_if_moving(self, packet: Request[Any] | Command) -> None:
        moves = isinstance(packet, (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest)) or (
            isinstance(packet, SetServoParameterRequest) and packet.is_start == 1
        )
        if moves:
            raise RequestError(f"{type(packet).__name__} was not sent: a stop came first", packet)

    async def _fence(self, own: Lane | None, until: float) -> Response | None:
        """Ask something else, until an answer proves that nothing is owed on `own`; return what came late there.

        Returns without proof when `until` has passed. Raises ConnectionLost when no fence is left to be sent
        and the board has been silent for long.
        """
        if own is not None:
            own.late = None
        while self.lanes.in_doubt(own) and self._loop.time() < until:
            clean = self._clean_fences(own)
            if (lane := self._turns.borrow(clean)) is not None:
                await self._send_fence(lane, clean[lane], own, until)
            elif not clean and self.answers.silent_for() >= _SILENCE * self._timeout:
                self._break_off()
            else:
                await self._wait(until - self._loop.time(), self.answers.next_answer())
        return own.late if own is not None else None

    def _clean_fences(self, own: Lane | None) -> dict[Lane, Query[Any]]:
        self._fences.rotate(-1)
        fences = {self.lanes.of(query): query for query in self._fences}
        if any(lane.owed is not None and lane.owed.number < 1 for lane in fences):
            fences |= {self.lanes.of(query): query for query in MORE_FENCES}
        return {lane: query for lane, query in fences.items() if lane.owed is None and lane is not own}

    async def _send_fence(self, lane: Lane, query: Query[Any], own: Lane | None, until: float) -> None:
        """Send a fence, which has time until `until`, and wait until it is over or is no longer needed."""
        self.stats.fences += 1
        try:
            now = self._loop.time()
            pending = self._sending(query, min(self._timeout, until - now), now)
            self.answers.expect(lane, pending)
            await self._write(self.codec.encode(query))
            while not pending.answer.done() and self.lanes.in_doubt(own):
                await self._wait(None, pending.answer, self.answers.next_answer())
        finally:
            if lane.pending is None:
                self._turns.give_back_borrowed(lane)
            else:
                lane.pending.abandoned = lane.pending.borrowed = True

    async def _wait(self, timeout: float | None, *futures: asyncio.Future[Any]) -> None:
        await asyncio.wait(futures, timeout=timeout, return_when=asyncio.FIRST_COMPLETED)
        self._raise_if_ended()

    def _break_off(self) -> NoReturn:
        silent = TimeoutError("the board answered none of the queries that would show that it still listens")
        self.answers.lost(silent)
        raise same(self.answers.ended or lost(self.transport.url, silent))

    def _raise_if_ended(self) -> None:
        if self.answers.ended is not None:
            raise same(self.answers.ended)


def _lanes_after(before: Lanes) -> Lanes:
    """Return the lanes of a link that follows another: with all that is owed there, if that leaves a fence."""
    lanes = Lanes()
    lanes.inherit(before, own=False)
    if all(lanes.of(query).owed is not None for query in (*FENCES, *MORE_FENCES)):
        lanes = Lanes()
        lanes.inherit(before, own=True)
    return lanes
