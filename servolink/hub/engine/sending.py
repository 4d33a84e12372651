"""PacketSender: sends the packets of programs to the board, with gates and units first."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from contextlib import AbstractContextManager
from functools import partial
from typing import Any

from msgspec.structs import replace

from servolink.client import Board, servos_of
from servolink.connection import Connection
from servolink.errors import ConnectionLost, MotionRefused, OutcomeUnknown, Rejected, ServolinkError, WrongBoard
from servolink.hub.engine.button_relay import ButtonRelay
from servolink.hub.engine.hub_gates import Standstill, refuse_role
from servolink.hub.engine.lease_keeper import LeaseKeeper
from servolink.hub.engine.motions import Motions
from servolink.hub.engine.program import Program
from servolink.hub.engine.unit_switch import UnitsKept, UnitSwitch
from servolink.hub.rules.exchanges import Exchange
from servolink.motion import StopCounter, Ticket, carries_angles
from servolink.protocol import (
    ALL_SERVOS,
    PACKETS,
    ClearAllDataRequest,
    Command,
    ExecuteActionRequest,
    ExecuteMacroResponse,
    Packet,
    Query,
    QueryServoRequest,
    QueryServoResponse,
    Request,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SubscribeButtonEventRequest,
    WriteProjectIDRequest,
)

Done = Callable[[Exchange, "Packet | ServolinkError", "bytes | None"], None]
"""Called with the response to a query, and the content as received, if known; or with an error."""

_SILENCE = 0.3  # seconds for a query that the board is known not to answer; later ones of the program wait meanwhile


class PacketSender:
    """Sender of packets: opens the gates, sets units, and refuses forbidden packets."""

    def __init__(
        self,
        board: Board,
        motions: Motions,
        stops: StopCounter,
        keeper: LeaseKeeper,
        units: UnitSwitch,
        buttons: ButtonRelay,
        exclusive: Callable[[Exchange], AbstractContextManager[None]],
        on_refused: Callable[[Exchange, str], None],
        programs: Mapping[str, Program],
        standstill: Standstill,
    ) -> None:
        """Send to `board` the requests of `programs`, in the units that `units` sets.

        While everything is deleted, others wait because of `exclusive`. Call `on_refused` with each packet that is not
        sent, and the reason.
        """
        self.is_stopped = False
        """Whether all servos are stopped, and none was started since."""
        self.motions = 0
        """How many motions were sent, or are being sent."""
        self._board = board
        self._servos = servos_of(board)
        self._motions = motions
        self._stops = stops
        self._keeper = keeper
        self._buttons = buttons
        self._units = units
        self._exclusive = exclusive
        self._on_refused = on_refused
        self._programs = programs
        self._standstill = standstill
        self._guarded: Connection | None = None
        self.forecast: Callable[[Exchange], Awaitable[ServolinkError | None]] | None = None
        """Gate that tries a motion on a twin, and returns the refusal; None without one."""

    def send_at_once(self, exchange: Exchange, done: Done) -> bool:
        """Send a query that needs no preparation, and pass the outcome to `done`. Return whether the query was sent."""
        packet, connection, units = exchange.packet, self._servos.connection, self._units
        if not isinstance(packet, Query) or self._is_unanswered(packet):
            return False
        heard: Callable[[Packet | ServolinkError, bytes | None], None] = partial(done, exchange)
        has_angles = isinstance(packet, QueryServoRequest)
        if isinstance(packet, QueryServoRequest):
            if self._is_for_each(packet) or not units.enter_at_once(packet, exchange.program.units):
                return False
            heard = partial(self._heard_angles, heard)
        try:
            is_sent = connection.ask(packet, heard)
        except ConnectionLost:
            is_sent = False
        if has_angles and not is_sent:
            units.leave()
        return is_sent

    def _heard_angles(
        self,
        done: Callable[[Packet | ServolinkError, bytes | None], None],
        outcome: Packet | ServolinkError,
        content: bytes | None,
    ) -> None:
        self._units.leave()
        done(outcome, content)

    def may_wait(self, exchange: Exchange) -> bool:
        """Return whether a packet may have to wait for more than the line: for units, or a check against limits."""
        packet = exchange.packet
        has_check = bool(self._board.limits) or self.forecast is not None
        if isinstance(packet, SetAngleUnitRequest) or (packet.is_motion and has_check):
            return True
        return carries_angles(packet) and not self._units.is_set_for(packet, exchange.program.units)

    async def send(self, exchange: Exchange, on_free: Callable[[], None]) -> Packet | None:
        """Send a packet and return the response for the program, None without one.

        The queue of the program is blocked by it until it is with the connection, which keeps the order; then `on_free`
        is called.
        """
        packet, angle_units = exchange.packet, exchange.program.units
        exchange.is_unsent = self._servos.connection.ended is not None
        is_inside = False
        try:
            if isinstance(packet, SetAngleUnitRequest):
                return await self._units.set(packet, angle_units)
            if isinstance(packet, SubscribeButtonEventRequest):
                return await self._buttons.set(exchange.program, packet)
            if not isinstance(packet, Query) and (refusal := await self._prepare(exchange)):
                return await self.refused(exchange, refusal)
            if self.forecast is not None and packet.is_motion and (falls := await self.forecast(exchange)):
                return await self.refused(exchange, falls)
            if carries_angles(packet):
                await self._units.enter(packet, angle_units)
                is_inside = True
            if not exchange.is_wanted:
                return None
            if packet.is_motion:
                return await self._move(exchange)
            # In the next turn of the loop: the packet must reach the connection first.
            asyncio.get_running_loop().call_soon(self._free, exchange, on_free)
            return await self._send(exchange)
        except UnitsKept as error:
            return await self.refused(exchange, error)
        finally:
            self._free(exchange, on_free)
            if is_inside:
                self._units.leave()

    async def refused(self, exchange: Exchange, refusal: ServolinkError) -> Packet | None:
        """Return the response to a packet that is not sent."""
        exchange.error = refusal
        self._on_refused(exchange, str(refusal))
        return await self._motions.refused(exchange.packet)

    async def _prepare(self, exchange: Exchange) -> ServolinkError | None:
        """Check the identity of the board and take the lease for a motion. Return the refusal, None if there is none.

        The connection does the same for a motion that is sent at once.
        """
        packet, program, connection = exchange.packet, exchange.program, self._servos.connection
        self._guard(connection)
        if program.has_left:  # and must not take the lease
            return MotionRefused("its program has left")
        if refusal := refuse_role(packet, program.role):
            return refusal
        if packet.is_motion and not exchange.may_wait:
            return None
        if late := self._standstill.refuse(packet, exchange.ticket, self._stops):
            return late
        try:
            await connection.prepare(packet, connection.stops.ticket(who=program.session_id))
        except WrongBoard as error:
            return error
        return self._keeper.refuse(packet, exchange.ticket)

    def _free(self, exchange: Exchange, on_free: Callable[[], None]) -> None:
        if exchange.program.queue.blocked_by is exchange:
            exchange.program.queue.blocked_by = None
            on_free()

    async def _send(self, exchange: Exchange) -> Packet | None:
        packet = exchange.packet
        match packet:
            case ClearAllDataRequest():
                with self._exclusive(exchange):
                    return PACKETS.result_of(packet, done=await _is_done(self._board.clear_all_data()))
            case WriteProjectIDRequest():  # by which the board is recognised after a loss
                is_done = await _is_done(self._board.write_project_id(packet.project_id))
                return PACKETS.result_of(packet, done=is_done)
            case QueryServoRequest() if self._is_for_each(packet):
                return QueryServoResponse(await self._servos.all.states())
            case Request():
                return await self._request(packet, unchecked=exchange.is_unchecked)
            case _:
                assert isinstance(packet, Command), packet  # noqa: S101 - narrows the type
                await self._servos.connection.send(packet)
                return None

    def _is_for_each(self, packet: QueryServoRequest) -> bool:
        """Return whether a query for all servos must be sent for each servo (see `AllServos.is_separate`)."""
        return packet.servo_id == ALL_SERVOS and self._servos.all.is_separate

    async def _move(self, exchange: Exchange) -> Packet | None:
        """Send a motion, unless forbidden by a limit, or by a stop or another holder since the request."""
        if refusal := self._standstill.refuse(exchange.packet, exchange.ticket, self._stops):
            return await self.refused(exchange, refusal)
        connection, until = self._servos.connection, exchange.ticket.until
        motions = connection.motions
        try:
            ticket = connection.stops.ticket(until=until, who=exchange.program.session_id)
            if exchange.order is not None:
                outcome = await self._motions.move(exchange, exchange.order, ticket)
                self.is_stopped = self.is_stopped and not exchange.order.start
            elif exchange.points is None:
                outcome = await self._motions.send(exchange.packet, ticket, unchecked=exchange.is_unchecked)
            else:
                outcome = await self._motions.stream(exchange.packet, exchange.points, ticket)
                exchange.packet = ExecuteActionRequest(exchange.points.latest)
        except (OutcomeUnknown, ConnectionLost):
            exchange.is_unsent = connection.motions == motions
            if not exchange.is_unsent:
                self._keeper.moved(exchange)  # the board may have carried out the motion
                self._motions.courses.forget()
            raise
        finally:
            if exchange.has_begun:
                self._units.release()
        if outcome.refusal is not None:
            exchange.error = outcome.refusal
            self._on_refused(exchange, str(outcome.refusal))
        elif outcome.response != ExecuteMacroResponse(0):
            self._keeper.moved(exchange)
            if isinstance(exchange.packet, SetServoParameterRequest) and exchange.packet.is_start:
                self.is_stopped = False
        return outcome.response

    def _guard(self, connection: Connection) -> None:
        """Install the gates of programs on a new connection to the board."""
        if connection is self._guarded:
            return
        self._guarded, inner = connection, connection.gates.ticket

        def lease(packet: Packet, ticket: Ticket) -> ServolinkError | None:
            return self._keeper.refuse(packet, ticket) if ticket.who else None

        def stop(packet: Packet, ticket: Ticket) -> ServolinkError | None:
            if not ticket.who:
                return inner(packet, ticket)
            return self._standstill.refuse(packet, ticket, connection.stops)

        connection.gates = replace(connection.gates, lease=lease, ticket=stop)
        connection.preparations += (self._take_lease,)

    async def _take_lease(self, packet: Packet, ticket: Ticket) -> None:
        """Take the lease for a motion of a program, and keep the program's units during a soft start."""
        if not ticket.who or not packet.is_motion:
            return
        program = self._programs.get(ticket.who)
        if program is None:
            raise MotionRefused("its program has left")
        self.motions += self._keeper.take_for_motion(ticket.who, program.dead_man)
        exchange = program.queue.blocked_by
        is_soft = exchange is not None and exchange.packet.is_motion and packet != exchange.packet
        if exchange is not None and is_soft and isinstance(packet, ExecuteActionRequest):
            exchange.has_begun = True
            self._motions.courses.forget()
            # A soft start lasts seconds; do not block programs that need other units.
            self._units.keep_for(program.units, math.inf)

    async def _request(self, packet: Request[Any], *, unchecked: bool) -> Packet:
        timeout = _SILENCE if self._is_unanswered(packet) else None
        response: Packet = await self._servos.connection.request(packet, timeout=timeout, unchecked=unchecked)
        return response

    def _is_unanswered(self, packet: Request[Any]) -> bool:
        """Return whether the board is known to leave a query unanswered, for which no program should wait for long."""
        return bool(self._servos.connection.opener.unsupported) and packet.short_name in self._board.unanswered


async def _is_done(doing: Coroutine[Any, Any, None]) -> bool:
    """Return whether the board has done it, and not refused."""
    try:
        await doing
    except Rejected:
        return False
    return True
