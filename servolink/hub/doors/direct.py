"""DirectProgram: the session of a program in the hub's own process, whose packets need not become bytes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from copy import copy
from functools import partial
from typing import Any, TypeVar, cast

from servolink.client import ButtonEvent
from servolink.connection import HUB_MARGIN, SLOW_PATIENCE, BoardSharing, Gates, Stats, lost, outcome_unknown, timed_out
from servolink.control import Role
from servolink.errors import ConnectionLost, OutcomeUnknown, ServolinkError
from servolink.hub.engine.hub_gates import LeaseRefused, MotionOver, nothing_moved, refuse_other_use
from servolink.hub.engine.program import Program
from servolink.hub.hub import Hub
from servolink.hub.rules.exchanges import Exchange
from servolink.motion import AngleUnit, StopCounter, Ticket
from servolink.protocol import (
    ClearAllDataRequest,
    Codec,
    Command,
    Packet,
    Query,
    Request,
    Response,
    SetAngleUnitRequest,
    SetServoParameterRequest,
)
from servolink.support import call_at

R = TypeVar("R", bound=Response)

_EARLY = 1e-6  # seconds by which a timer may fire too early


class _Asked(Exchange, eq=False, kw_only=True):
    """Request of the program, and the future of the response."""

    answered: asyncio.Future[Packet | None]
    timer: asyncio.TimerHandle | None = None
    """Gives the request up."""


class _Events:
    """Notice of the hub that the program did not ask for."""

    def __init__(self) -> None:
        self.on_event: Callable[[ButtonEvent], None] = lambda event: None
        self.on_end: Callable[[ConnectionLost], None] = lambda error: None


class DirectProgram(Program):
    """Program that is its own connection to the board of a hub: packets enter the queue of the hub unchanged.

    They have the order, limits and rights of any other program. What is refused raises the refusal of the gate.
    """

    def __init__(
        self,
        hub: Hub,
        *,
        who: str,
        door: str = "local",
        role: Role = Role.EDIT,
        unit: AngleUnit = "degree",
        session_id: str | None = None,
    ) -> None:
        """Join `hub`, with angles in `unit`. Raise ValueError if the session id is in use."""
        super().__init__(hub, hub.board.codec, who=who, door=door, role=role, unit=unit, session_id=session_id)
        self.url = f"share://{hub.name}"
        self.board_url = hub.url
        self.patience = hub.board.connection.patience
        self.stats = Stats()
        self.stops = StopCounter()
        """Stops that cancel motions of this program: stops by other programs, and own stops of all servos."""
        self.motions = 0
        """Number of motions put into the queue of the hub."""
        self.hub: BoardSharing | None = None
        self.is_suspended = False
        self.outlasts_silence = True
        self.on_another: Callable[[str], None] = lambda text: None
        self.ended: ConnectionLost | None = None
        self.units_sent = 0
        self.answers = _Events()
        self._loop = asyncio.get_running_loop()
        self.gates = Gates(
            exclusive_use=self._refuse_other_use,
            lease=self._refuse_lease,
            ticket=hub.standstill.gate(self.stops),
            limits=Gates.of_units(lambda: self.units_sent),
        )
        self._hub: Hub = hub
        self._heard_at = 0.0  # when the latest response came, on the clock of the event loop
        self._open: dict[int, _Asked] = {}
        hub.add(self)
        self.on_end = lambda: self._end(lost(self.url, ConnectionError("the hub has ended")))

    @property
    def waiting(self) -> int:
        """Number of requests without a response so far."""
        return len(self._open)

    @property
    def unsupported(self) -> frozenset[str]:
        """Names of queries that the board is known not to answer."""
        return self._hub.board.unanswered

    @property
    def answered(self) -> tuple[Query[Any], ...]:
        """Short queries that the board has answered on opening."""
        return self._hub.board.connection.answered

    @property
    def depth_bound(self) -> int:
        """How many queries may ever be under way."""
        return self._hub.board.connection.depth_bound

    @property
    def write_depth_bound(self) -> int:
        """Most requests under way while a change is under way."""
        return self._hub.board.connection.write_depth_bound

    @property
    def pace(self) -> float:
        """Bytes per second that the line carries, 0 if unknown."""
        return self._hub.board.connection.pace

    @property
    def callers(self) -> int:
        """How many callers keep the line full."""
        return self._hub.board.connection.callers

    @property
    def has_waiting(self) -> bool:
        """Whether requests of this program wait for their turn."""
        return bool(self.queue.exchanges)

    def bulk(self) -> AbstractContextManager[None]:
        """Return a context for a large transfer."""
        return nullcontext()

    async def shake_hands(self) -> None:
        """Do nothing: a session with a hub begins clean."""

    async def close(self) -> None:
        """Fail all waiting requests, and leave the hub; may be called again."""
        self._end(lost(self.url, None))

    def _end(self, error: ConnectionLost) -> None:
        if self.ended is None:
            self.ended = error
            self.leave()
            self.answers.on_end(error)

    # --- the session --------------------------------------------------------------------------------------------

    def finish(
        self, exchange: Exchange, response: Packet | None, content: bytes | None = None, codec: Codec | None = None
    ) -> None:
        """Finish a request with a response, or with None."""
        asked = self._open.pop(id(exchange), None)
        if asked is None:
            return
        asked.is_over = True
        if response is not None:
            self.counters.responses += 1
            self._heard_at = self._now()
        if not asked.answered.done():
            asked.answered.set_result(response)

    def leave(self) -> None:
        """End the session; may be called again. Unsent requests are dropped, sent ones end without a response."""
        super().leave()
        for asked in list(self._open.values()):
            self.finish(asked, None)

    def push(self, event: ButtonEvent) -> None:
        """Pass on a button event."""
        self.answers.on_event(event)

    # --- requests -----------------------------------------------------------------------------------------------

    async def request(
        self,
        packet: Request[R],
        *,
        timeout: float | None = None,
        first: bool = False,
        unchecked: bool = False,
        ticket: Ticket | None = None,
        begun_at: float | None = None,
    ) -> R:
        """Return the response to `packet`. Raise RequestTimeout or OutcomeUnknown if the board does not answer.

        `timeout`, `unchecked`, `ticket` and `begun_at` are as for `Connection.request`.
        """
        asked = self._ask(packet, ticket, unchecked=unchecked)
        response = await self._outcome(asked, timeout, self._loop.time() if begun_at is None else begun_at)
        if response is None:
            raise (self.ended or lost(self.url, None)).copy()
        return cast("R", response)

    async def send(self, packet: Command, *, ticket: Ticket | None = None) -> bool:
        """Return True after sending a packet without response to the board."""
        await self._outcome(self._ask(packet, ticket), None, self._loop.time())
        if self.ended is not None:
            raise self.ended.copy()
        return True

    async def send_stop(self, packet: SetServoParameterRequest) -> bool:
        """Send `packet` before everything else, without waiting for the response."""
        self.stops.stop()
        self._ask(packet, None)
        return True

    def _ask(self, packet: Packet, ticket: Ticket | None, *, unchecked: bool = False) -> _Asked:
        """Queue a packet, with a ticket of the hub in exchange for the ticket of this connection."""
        if self.ended is not None:
            raise self.ended.copy()
        ticket = ticket or self.stops.ticket()
        if packet.is_motion:
            # The other gates of the row are asked where the hub sends the packet.
            for gate in (self.gates.exclusive_use, self.gates.ticket, self.gates.limits):
                if refusal := gate(packet, ticket):
                    raise refusal
            self.motions += 1
        elif isinstance(packet, SetAngleUnitRequest):
            self.units_sent += 1
        own = self._hub.stops.ticket(until=ticket.until, who=self.session_id)
        answered = self._loop.create_future()
        asked = _Asked(self, packet, own, asked_at=self._now(), is_unchecked=unchecked, answered=answered)
        self.counters.requests += 1
        self._open[id(asked)] = asked
        self.put(asked)
        return asked

    async def _outcome(self, asked: _Asked, timeout: float | None, begun_at: float) -> Packet | None:
        """Return the response when a request is over. Raise the failure; give the request up after the deadline.

        Without `timeout`, the time counts from the latest response to this program, as the hub may be busy with others.
        """
        patience = self.patience if timeout is None else timeout
        if timeout is None:
            slow = isinstance(asked.packet, ClearAllDataRequest)
            patience = (max(patience, SLOW_PATIENCE) if slow else patience) + HUB_MARGIN
        self._limit(asked, begun_at, patience, is_fixed=timeout is not None)
        try:
            response = await asked.answered
        except asyncio.CancelledError:
            self._withdraw(asked)
            raise
        finally:
            if asked.timer is not None:
                asked.timer.cancel()
        if asked.error is not None:
            raise self._error(asked)
        return response

    def _limit(self, asked: _Asked, begun_at: float, patience: float, *, is_fixed: bool) -> None:
        """Give a request up `patience` seconds after `begun_at`, or after a later response unless `is_fixed`."""
        since = begun_at if is_fixed else max(begun_at, self._heard_at)
        if self._loop.time() < since + patience - _EARLY:
            again = partial(self._limit, asked, begun_at, patience, is_fixed=is_fixed)
            asked.timer = call_at(self._loop, since + patience, again)
            return
        waited, hold = self._loop.time() - begun_at, self._hub.exclusive_use
        error: ServolinkError = outcome_unknown(asked.packet, self.url, waited)
        if self._withdraw(asked) or isinstance(asked.packet, Query):
            held = "" if hold is None else f"{hold.who} has exclusive use of the board"
            error = timed_out(asked.packet, self.url, 0, waited, self.stats, excuse=held)
        if not asked.answered.done():
            asked.answered.set_exception(error)

    def _withdraw(self, asked: _Asked) -> bool:
        """Give up a request. Return whether the request was not sent yet, and so never will be."""
        self._open.pop(id(asked), None)
        return self._hub.withdraw(asked)

    def _error(self, asked: _Asked) -> ServolinkError:
        """Return the error for a request without a response, as over any other connection."""
        error, packet = asked.error, asked.packet
        assert error is not None  # noqa: S101 - narrows the type
        if isinstance(error, ConnectionLost):  # of the hub with the board: this connection goes on
            is_certain = asked.is_unsent or isinstance(packet, Query)
            return error.copy() if is_certain else OutcomeUnknown(str(error), packet)
        return nothing_moved(copy(error))

    # --- gates --------------------------------------------------------------------------------------------------

    def _refuse_other_use(self, packet: Packet, ticket: Ticket) -> MotionOver | None:
        """Refuse a motion that would wait until another program ends exclusive use."""
        return refuse_other_use(self._hub.exclusive_use, self.session_id)

    def _refuse_lease(self, packet: Packet, ticket: Ticket) -> LeaseRefused | None:
        """Refuse a motion while another program holds the lease."""
        reason = self._hub.leases.reason(self.session_id)
        return LeaseRefused(reason) if reason else None
