"""Upstream: what all programs ask is sent to the board through its one connection."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Coroutine
from typing import Any

from servolink.client.board import Board
from servolink.connection.connection import Connection
from servolink.errors import Rejected, ServolinkError
from servolink.escaping import escape
from servolink.hub.events import ButtonRelay
from servolink.hub.exchanges import Exchange, RoundRobin
from servolink.hub.roles import carries_angles, is_motion
from servolink.hub.session_state import SessionState
from servolink.hub.stopping import stop
from servolink.hub.units import BoardUnits
from servolink.protocol.editing import WriteProjectIDRequest, WriteProjectIDResponse
from servolink.protocol.joystick import SubscribeButtonEventRequest
from servolink.protocol.packet import Command, Packet, Query, Request
from servolink.protocol.servos import (
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
)
from servolink.protocol.settings import ClearAllDataRequest, ClearAllDataResponse

_logger = logging.getLogger(__name__)


class Upstream:
    """Sends the requests of all programs, as many at once as the connection has use for.

    The tasks live as long as the hub; one for each request would cost as much as the request.
    """

    def __init__(self, board: Board, buttons: ButtonRelay) -> None:
        """Ask `board`, from `start` on, and `buttons` for its button events."""
        self.board = board
        self._buttons = buttons
        self.waiting = RoundRobin()
        """What was not sent yet."""
        self.units = BoardUnits()
        self.stops = 0
        """How many stops there have been."""
        self._loop = asyncio.get_running_loop()
        self._connection: Connection | None = None  # to which `units` belong
        self._tasks = list[asyncio.Task[None]]()
        self._idle: deque[asyncio.Future[None]] = deque()
        self._active = 0  # tasks that have an exchange, or were woken for one
        self._stopping = set[asyncio.Task[None]]()
        self._setting_units = asyncio.Lock()
        self._angles = 0  # exchanges under way whose meaning depends on the present units
        self._no_angles = asyncio.Event()

    def start(self) -> None:
        """Begin to send."""
        self._tasks = [self._loop.create_task(self._work()) for _ in range(self.board.connection.depth_bound)]

    async def close(self) -> None:
        """Stop sending. What is under way is given up."""
        self._idle.clear()
        tasks = (*self._tasks, *self._stopping)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def ask(self, exchange: Exchange) -> None:
        """Send a request when it is its turn, and finish it."""
        exchange.stops = self.stops
        self.waiting.add(exchange)
        if self._idle:
            self.wake()

    def ask_stop(self, exchange: Exchange) -> None:
        """Send a stop at once, and finish it."""
        task = self._loop.create_task(self._stop(exchange))
        self._stopping.add(task)
        task.add_done_callback(self._stopping.discard)

    def drop_motions(self) -> list[Exchange]:
        """Return the motions of all programs that will not be sent any more, because of a stop."""
        self.stops += 1
        return self.waiting.drop_where(lambda waiting: is_motion(waiting.packet))

    def wake(self) -> None:
        """Look again for what may be sent now."""
        if self._idle and self._active < self.board.connection.callers:
            self._active += 1
            self._idle.popleft().set_result(None)

    # --- one task of many ---------------------------------------------------------------------------------------

    async def _work(self) -> None:
        while True:
            woken = self._loop.create_future()
            self._idle.append(woken)
            await woken
            try:
                while self._active <= self.board.connection.callers and (exchange := self.waiting.take(_any)):
                    if self.waiting:
                        self.wake()  # another task: there is more to do
                    await self._carry_out(exchange)
            finally:
                self._active -= 1

    async def _carry_out(self, exchange: Exchange) -> None:
        """Send a request, and finish it and all that its response answers as well."""
        equal = list[Exchange]()
        if isinstance(exchange.packet, Query) and self.waiting:
            state = exchange.program.state
            equal = self.waiting.take_equal(exchange, lambda other: _means_same(other, state))
        response: Packet | None = None
        try:
            response = await self._respond(exchange)
        except ServolinkError as error:
            _logger.debug("%s", error)
        except Exception:
            # A defect of ours. The board and the other programs should go on all the same.
            _logger.exception("%s of %s failed", type(exchange.packet).__name__, escape(exchange.program.who))
        finally:
            for each in (exchange, *equal):
                if response is None and isinstance(each.packet, Request):
                    each.program.counters.unanswered += 1
                each.program.finish(each, response)

    async def _stop(self, exchange: Exchange) -> None:
        packet, response = exchange.packet, None
        assert isinstance(packet, SetServoParameterRequest)  # noqa: S101 - narrows the type
        try:
            response = await stop(self.board, packet)
        except ServolinkError as error:
            _logger.warning("%s", error)
            exchange.program.counters.unanswered += 1
        finally:
            exchange.program.finish(exchange, response)

    async def _respond(self, exchange: Exchange) -> Packet | None:
        """Send a request and return its response, None if it has none."""
        packet, connection, queue = exchange.packet, self.board.connection, exchange.program.queue
        if connection is not self._connection:
            self._connection = connection
            self.units.forget()  # the board may have been switched off and on
        if isinstance(packet, Query) and not isinstance(packet, QueryServoRequest):
            return await self._request(packet, connection)
        queue.is_blocked = True  # nothing of the same program may overtake it while something is awaited here
        try:
            if connection.guard is not None and not isinstance(packet, Query):
                await connection.guard(packet)
            if isinstance(packet, SetAngleUnitRequest):
                return await self._set_unit(exchange, packet, connection)
            if isinstance(packet, SubscribeButtonEventRequest):
                return await self._buttons.set(exchange.program, packet)
            has_angles = carries_angles(packet)
            if has_angles:
                await self._enter_units(exchange, connection)
        finally:
            queue.is_blocked = False
            if self.waiting:
                self.wake()
        try:
            return await self._send(packet, connection)
        finally:
            if has_angles:
                self._leave_units()

    async def _send(self, packet: Packet, connection: Connection) -> Packet | None:
        match packet:
            case ClearAllDataRequest():
                return ClearAllDataResponse(await _is_done(self.board.clear_all_data()))
            case WriteProjectIDRequest():  # by which the board is recognised after a loss
                return WriteProjectIDResponse(await _is_done(self.board.write_project_id(packet.project_id)))
            case Command():
                await connection.send(packet)
                return None
            case Request():
                return await self._request(packet, connection)
            case _:
                raise AssertionError(f"{type(packet).__name__} is no request")

    async def _request(self, packet: Request[Any], connection: Connection) -> Packet:
        response: Packet = await connection.request(packet, unchecked=True)
        return response

    # --- angle units --------------------------------------------------------------------------------------------

    async def _enter_units(self, exchange: Exchange, connection: Connection) -> None:
        """Set the units that a packet means on the board, and keep them until `_leave_units`."""
        packet, state = exchange.packet, exchange.program.state
        if self._setting_units.locked() or self.units.needed(packet, state):
            async with self._setting_units:
                # Nothing else may be under way: a query that is repeated would be answered in other units.
                await self._until_no_angles()
                for request in self.units.needed(packet, state):
                    await self._set(request, connection)
                self._angles += 1
        else:
            self._angles += 1

    def _leave_units(self) -> None:
        self._angles -= 1
        if not self._angles:
            self._no_angles.set()

    async def _until_no_angles(self) -> None:
        while self._angles:
            self._no_angles.clear()
            await self._no_angles.wait()

    async def _set_unit(
        self, exchange: Exchange, packet: SetAngleUnitRequest, connection: Connection
    ) -> SetAngleUnitResponse:
        """Set a unit that a program asks for, which is its own from now on."""
        async with self._setting_units:
            await self._until_no_angles()
            self.units.asking(packet)
            response = await connection.request(packet, unchecked=True)
            if self.units.answered(packet, response):
                exchange.program.state.set_unit(packet)
        return response

    async def _set(self, request: SetAngleUnitRequest, connection: Connection) -> None:
        """Set a unit. Raise Rejected if the board refuses."""
        self.units.asking(request)
        if not self.units.answered(request, await connection.request(request)):
            raise Rejected(f"the board refused to set the unit of servo {request.servo_id}", request)


def _any(exchange: Exchange) -> bool:
    return True


def _means_same(exchange: Exchange, state: SessionState) -> bool:
    """Return whether the response to a query of a program with `state` answers an equal one as well."""
    other = exchange.program.state
    is_same = other is state or (other.unit == state.unit and other.units == state.units)
    return is_same or not carries_angles(exchange.packet)


async def _is_done(doing: Coroutine[Any, Any, None]) -> int:
    """Return 1 when something is done, 0 if the board refuses it."""
    try:
        await doing
    except Rejected:
        return 0
    return 1
