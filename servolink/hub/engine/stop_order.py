"""Stopping: a stop goes to the board before everything, and counts when confirmed by the servos' state."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Literal, NamedTuple

from msgspec import Struct

from servolink.client import Board, servos_of
from servolink.control import ProblemNotice
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    OutcomeUnknown,
    Reason,
    RequestRefused,
    RequestTimeout,
    ServolinkError,
    escape,
)
from servolink.hub.engine.hub_gates import stops_all
from servolink.hub.engine.lease_keeper import LeaseKeeper
from servolink.hub.engine.program import Program
from servolink.hub.engine.sending import PacketSender
from servolink.hub.engine.upstream import RequestFollower, Upstream
from servolink.hub.rules.exchanges import Exchange
from servolink.motion import STOPPED, StopCounter, Ticket
from servolink.protocol import (
    ALL_SERVOS,
    QueryServoRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
)
from servolink.support import Tasks

_logger = logging.getLogger(__name__)

_TRIES = 3
_LAST_TRIES = 1.0  # seconds in which stops may still be confirmed, or sent again, when the hub ends


class MotionsCancelled(Struct, frozen=True):
    """Notice within the hub: motions requested until now are not sent any more."""

    are_all: bool
    """Whether all servos are being stopped; False for some."""
    reason: str = STOPPED
    stalled: int | None = None
    """Servo whose stall is the reason; None for any other reason."""

    @property
    def cause(self) -> Reason:
        """The reason, for programs."""
        return Reason.STOP if self.stalled is None else Reason.STALL


ALL_CANCELLED = MotionsCancelled(are_all=True)


class _Stopping(NamedTuple):
    """Stop under way, shared by equal stops."""

    motions: int
    """Number of motions sent before the stop began."""
    task: asyncio.Task[SetServoParameterResponse]


class Stops:
    """Stops servos for programs, and for the hub itself: at once, in spite of the lease and of exclusive use by others.

    No motion is sent that was asked for before a stop.
    """

    def __init__(
        self,
        board: Board,
        stops: StopCounter,
        sender: PacketSender,
        upstream: Upstream,
        keeper: LeaseKeeper,
        *,
        tell: Callable[[Struct, str], None],
        follow: RequestFollower,
    ) -> None:
        """Stop `board`. `tell` passes on notices; `follow` hears of stops without a packet of a program."""
        self._board = board
        self._stops = stops
        self._sender = sender
        self._upstream = upstream
        self._keeper = keeper
        self._tell = tell
        self._follow = follow
        self._now = asyncio.get_running_loop().time
        self._tasks = Tasks()
        self._under_way: dict[SetServoParameterRequest, _Stopping] = {}

    async def close(self) -> None:
        """Give up stops without a confirmation soon."""
        await self._tasks.close(linger=_LAST_TRIES)

    def ask(self, exchange: Exchange) -> None:
        """Send the stop of a program before everything else, and finish the request."""
        packet = exchange.packet
        assert isinstance(packet, SetServoParameterRequest)  # noqa: S101 - narrows the type
        if stops_all(packet):
            self._all_stop(exchange.program.session_id)
        else:
            self._drop_motions(exchange.program.session_id, MotionsCancelled(are_all=False))
        self._send(packet).add_done_callback(lambda task: self._upstream.finish(exchange, _outcome_of(task)))

    def begin(
        self, who: str, session_id: str = "", cancels: MotionsCancelled = ALL_CANCELLED
    ) -> asyncio.Task[SetServoParameterResponse]:
        """Stop all servos for `who`; see `Hub.begin_stop`."""
        _logger.info("%s stops the board", escape(who))
        self._all_stop(session_id, cancels)
        begun = self._now()
        stopping = self._send(SetServoParameterRequest(ALL_SERVOS, 0, 1))
        stopping.add_done_callback(lambda task: self._over(ALL_SERVOS, _outcome_of(task), begun, who))
        return stopping

    def begin_unwatched(self, who: str, cancels: MotionsCancelled = ALL_CANCELLED) -> asyncio.Task[Ticket | None]:
        """Stop all servos without a watching program; without a connection, as soon as the board is connected again.

        Programs hear `cancels`. The task returns a ticket issued at the stop, or None after a loss of the connection, a
        failure or another stop.
        """
        self._drop_motions("", cancels)  # now: a motion in between would take the lease again
        return self._tasks.begin(self._stop_unwatched(who, cancels, self._stops.ticket()))

    async def end_move(self, program: Program, servo_ids: Sequence[int]) -> None:
        """Stop servos where they are, and start them again; see `Hub.end_move`."""
        self._drop_motions(program.session_id, MotionsCancelled(are_all=False))
        ticket = self._stops.ticket(who=program.session_id)
        try:
            await self._stop_some(servo_ids, program.who)
        except ServolinkError as error:
            self.begin_unwatched(f"{program.who} has let go")
            raise OutcomeUnknown(f"{error}; all servos are stopped instead") from error
        if ALL_SERVOS in servo_ids:
            servo_ids = servos_of(self._board).all.separate_ids or servo_ids
        # A board may turn a started servo to an old target: start only stopped servos (3.2.3).
        for servo_id in servo_ids:
            if self._sender.is_stopped or self._upstream.waiting.holder not in (None, program.queue):
                return
            packet = SetServoParameterRequest(servo_id, 1, 1)
            await self._upstream.begin(Exchange(program, packet, ticket, asked_at=self._now()))

    async def _stop_unwatched(self, who: str, cancels: MotionsCancelled, begun: Ticket) -> Ticket | None:
        async for state in self._board.states():
            if state == "closed":
                break
            if state == "lost":
                begun = begun.expired()
                self._tell(ProblemNotice(f"{who}: the board is stopped as soon as it is connected again"), "")
                continue
            is_only = self._stops.holds(begun)  # no stop of another program, and no earlier try
            stopping = self.begin(who, cancels=cancels)
            ticket = self._stops.ticket()
            try:
                await Tasks.shared_result(stopping)
            except ConnectionLost:
                continue
            except ServolinkError as error:
                self._tell(ProblemNotice(str(error)), "")
                break
            return ticket if is_only else None
        return None

    def _all_stop(self, session_id: str, cancels: MotionsCancelled = ALL_CANCELLED) -> None:
        """Count all servos as stopped, until somebody starts one."""
        self._drop_motions(session_id, cancels)
        self._sender.is_stopped = True
        self._keeper.stopped()

    def stood_still(self, reason: str) -> None:
        """Cancel all motions requested until now, and end the lease if its time is over: the hub stood still."""
        _logger.warning("%s", reason)
        self._drop_motions("", MotionsCancelled(are_all=True, reason=reason))
        self._keeper.look()
        self._tell(ProblemNotice(f"{reason}: what was asked for before moves nothing"), "")

    def _drop_motions(self, session_id: str, cancels: MotionsCancelled) -> None:
        """Cancel all motions requested until now, and notify programs with unsent motions."""
        self._stops.stop(cancels.reason, cancels.cause)
        # Motions under way in the connection, even before a stop is sent.
        self._board.connection.stops.stop(cancels.reason, cancels.cause)
        self._upstream.drop_motions(cancels.reason)
        self._tell(cancels, session_id)

    def _send(self, packet: SetServoParameterRequest) -> asyncio.Task[SetServoParameterResponse]:
        """Send a stop immediately and return the task; or the task of an equal stop without a motion since.

        Others may wait for the task, too: do not cancel it.
        """
        motions, under_way = self._sender.motions, self._under_way.get(packet)
        if under_way is not None and under_way.motions == motions:
            return under_way.task
        task = self._tasks.begin(_stop(self._board, packet))
        self._under_way[packet] = _Stopping(motions, task)
        task.add_done_callback(partial(self._forget, packet))
        return task

    def _forget(self, packet: SetServoParameterRequest, task: asyncio.Task[SetServoParameterResponse]) -> None:
        if self._under_way[packet].task is task:
            del self._under_way[packet]
        outcome = _outcome_of(task)
        if isinstance(outcome, ServolinkError):
            _logger.warning("%s", outcome)

    async def _stop_some(self, servo_ids: Sequence[int], who: str) -> None:
        """Stop servos, or all for the id 255, and report the outcome to the followers of requests."""
        begun = self._now()
        outcome: ServolinkError | bool = False
        try:
            if ALL_SERVOS in servo_ids:
                await Tasks.shared_result(self._send(SetServoParameterRequest(ALL_SERVOS, 0, 1)))
            else:
                await _stop_each(self._board, servo_ids)
            outcome = True
        except ServolinkError as error:
            outcome = error
            raise
        finally:
            for servo_id in servo_ids:
                response = SetServoParameterResponse(servo_id, 0, 1) if outcome is True else outcome
                self._over(servo_id, response, begun, who)

    def _over(self, servo_id: int, outcome: object, begun: float, who: str) -> None:
        self._follow(SetServoParameterRequest(servo_id, 0, 1), outcome, begun, who, "")


async def _stop(board: Board, packet: SetServoParameterRequest) -> SetServoParameterResponse:
    """Stop and hold one servo or all servos, and return their reported state.

    Raise OutcomeUnknown or ConnectionLost if that cannot be confirmed.
    """
    if packet.servo_id == ALL_SERVOS:
        await board.stop()
        return SetServoParameterResponse(ALL_SERVOS, 0, 1)
    servos = servos_of(board)
    for _ in range(_TRIES):
        connection = board.connection
        await connection.send_stop(packet)
        servos.known.set(packet.servo_id, is_idle=True)
        try:
            states = await servos.all.states(packet.servo_id, timeout=connection.patience / _TRIES, first=True)
        except (RequestTimeout, DecodeError):
            continue
        except RequestRefused as error:
            raise OutcomeUnknown(f"a stop was sent and could not be confirmed: {error}", packet) from error
        if not states:
            return SetServoParameterResponse(0, 1, 0)  # as a board without such a servo answers
        if (states[0].is_start, states[0].is_hold) == (0, 1):
            return SetServoParameterResponse(packet.servo_id, 0, 1)
    raise OutcomeUnknown(f"a stop was sent {_TRIES} times and could not be confirmed", packet)


async def _stop_each(board: Board, servo_ids: Iterable[int]) -> None:
    """Stop and hold some servos, with all stops sent together and confirmed by one reading.

    Raise OutcomeUnknown if one of them does not report it, RequestTimeout or ConnectionLost if nothing is reported.
    """
    connection = board.connection
    wanted = set(servo_ids)
    servos = servos_of(board)
    for servo_id in wanted:
        await connection.send_stop(SetServoParameterRequest(servo_id, 0, 1))
        servos.known.set(servo_id, is_idle=True)
    try:
        states = await servos.all.states(timeout=connection.patience / _TRIES, first=True)
    except RequestRefused as error:
        text = f"servos {sorted(wanted)} were asked to stop, which could not be confirmed: {error}"
        raise OutcomeUnknown(text, QueryServoRequest(ALL_SERVOS)) from error
    stopped = {state.servo_id for state in states if (state.is_start, state.is_hold) == (0, 1)}
    if missing := sorted(wanted - stopped):
        raise OutcomeUnknown(
            f"servos {missing} were asked to stop, and do not report that they are stopped",
            QueryServoRequest(ALL_SERVOS),
        )


def _outcome_of(
    task: asyncio.Task[SetServoParameterResponse],
) -> SetServoParameterResponse | ServolinkError | Literal[False]:
    """Return the outcome of the finished task of a stop; False after giving up."""
    if task.cancelled():
        return False
    error = task.exception()  # `result` would raise it, and make the traceback of those who wait longer
    return error if isinstance(error, ServolinkError) else task.result()
