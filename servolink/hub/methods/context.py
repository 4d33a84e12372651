"""Context of the methods of the control interface: the hub, and the session of a program."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from typing import NamedTuple, TypeAlias, TypeVar

from msgspec import Struct

from servolink.client import Board, ServoStream, Session, servo_or_caption, servos_of, with_ticket
from servolink.connection import Connection
from servolink.control import Code, Greeting, HoldNotice, HoldStatus, Role, RpcError
from servolink.errors import ConnectionLost, OpenError, RequestTimeout
from servolink.hub.doors.direct import DirectProgram
from servolink.hub.engine.hub_gates import LeaseRefused, MotionOver
from servolink.hub.engine.questions import Questions
from servolink.hub.engine.stop_order import MotionsCancelled
from servolink.hub.hub import Hub
from servolink.hub.method_messages import MOST_LIMITS, Move
from servolink.hub.rules.exchanges import MoveOrder, RunEnd
from servolink.motion import AngleUnit, MotionLimits, MotionPlanner, StopCounter, Ticket
from servolink.protocol import ExecuteActionExRequest, ExecuteActionRequest, ExecuteMacroRequest
from servolink.support import time_with_sleep

T = TypeVar("T")

_ANY_MOTION = ExecuteActionRequest()

OpenBoard: TypeAlias = Callable[[], Awaitable[Board]]


class PreparedRun(NamedTuple):
    """Checked run of a program with the lease."""

    packet: ExecuteActionExRequest | ExecuteMacroRequest
    connection: Connection
    """Of the hub with the board, when it was checked."""
    ticket: Ticket
    """Ticket from before the check."""
    end: RunEnd | None
    """End of the run; None if unknown."""


class Readings:
    """Board read by the hub for all programs, so that all watchers share a poll."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._boards: dict[AngleUnit, Board] = {}  # a session of the hub for each unit, as angles are never converted

    async def board(self, unit: AngleUnit = "degree") -> Board:
        """Return the board of this program, with angles in `unit`."""
        if unit not in self._boards:
            who = "the hub" if unit == "degree" else "the hub, for raw angles"
            program = DirectProgram(self._hub, who=who, role=Role.WATCH, unit=unit)
            self._boards[unit] = _board_of(program, self._hub, self._hub.board.limits)
        return self._boards[unit]

    async def close(self) -> None:
        """Leave the hub at the end."""
        for board in self._boards.values():
            await board.close()


class Control:
    """Session of a program with a hub, on the side of the control interface."""

    def __init__(self, hub: Hub, readings: Readings, greeting: Greeting, session: str) -> None:
        """Speak for the program of `greeting`: a greeting with a session means that the program uses frames already."""
        self.hub = hub
        self.who = greeting.who
        self.session = session
        """Session id, for lease and exclusive use."""
        self.wants_programs = False
        """Whether the program is notified of programs that join and leave."""
        self.prepared: PreparedRun | None = None
        """Prepared run for the method `run.start`; None without a run."""
        self.stream: ServoStream | None = None
        """Latest stream of set-points; None before the first."""
        self.streams = 0
        """Number of streams begun."""
        self._readings = readings
        self._limits: MotionLimits | None = None
        self._dead_man = greeting.dead_man
        self._program: DirectProgram | None = None
        if greeting.session is None:
            self._program = _joined(hub, who=self.who, role=Role.parse(greeting.role), session=session)
            self._program.dead_man = greeting.dead_man
        self.stops = StopCounter() if self._program is None else self._program.stops
        """Stops that end motions of the program."""
        self._board: Board | None = None
        self._changed = asyncio.Event()

    async def close(self) -> None:
        """Leave the hub, which ends lease and exclusive use; a program with frames ends only exclusive use."""
        self.hub.end_exclusive_use(self.session)
        if self._board is not None:
            await self._board.close()
        elif self._program is not None:
            await self._program.close()

    def heard(self, notice: Struct, session: str) -> None:
        """Take a notice of the hub that `session` caused.

        Its own stops of single servos end nothing: what it asks for after them is in order.
        """
        if isinstance(notice, MotionsCancelled) and (notice.are_all or session != self.session):
            self.stops.stop(notice.reason, notice.cause)
        if isinstance(notice, HoldNotice | MotionsCancelled):
            self._changed.set()

    def ticket_of_hub(self, ticket: Ticket) -> Ticket:
        """Return a ticket of the hub for a motion with `ticket`, which may be over."""
        of_hub = self.hub.stops.ticket(until=ticket.until, who=self.session)
        return of_hub if self.stops.holds(ticket) else of_hub.expired()

    async def board(self) -> Board:
        """Return the board of this program, once no other program has exclusive use."""
        self._own_program()
        await self.until_free()
        return self._own_board()

    async def board_to_stop(self, servo: int | str) -> Board:
        """Return the board of this program to stop a servo, even during exclusive use by another program.

        With a caption in place of an id that waits, as nobody else may read captions then.
        """
        by_id = isinstance(servo_or_caption(servo), int)
        return self._own_board() if by_id else await self.board()

    def _own_board(self) -> Board:
        if self._board is None:
            self._board = _board_of(self._own_program(), self.hub, self.limits)
            self._servos = servos_of(self._board)
        return self._board

    async def move(self, params: Move, ticket: Ticket) -> float:
        """Move servos for the program, and return the seconds of the movement (see `Hub.move`)."""
        await self._until_may_move(ticket)
        servos = self._servos
        movement = await servos.movement(
            params.targets, duration=params.duration, speed=params.speed, any_angle=params.any_angle
        )
        order = MoveOrder(movement, servos.planner, params.start)
        self._refuse_ticket(ticket)
        own = self.ticket_of_hub(ticket)
        if params.dry_run:
            return (await self.hub.plan(self.session, order, own)).seconds
        plan = await self.hub.move(self.session, order, own)
        if params.wait:
            await servos.until_over(plan, ticket)
        return plan.seconds

    async def board_to_move(self, ticket: Ticket) -> Board:
        """Return the board of the program for a motion, once no other program has exclusive use.

        Raise MotionRefused if a stop or `end_move` comes after the motion was asked for, and when its time has passed.
        """
        await self._until_may_move(ticket)
        return with_ticket(self._own_board(), ticket)

    async def _until_may_move(self, ticket: Ticket) -> None:
        """Wait for the end of exclusive use by another program. Raise as `board_to_move`."""
        self._own_board()
        try:
            async with asyncio.timeout(None if ticket.until == math.inf else ticket.until - time_with_sleep()):
                while self.holder is not None and self.stops.holds(ticket):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            raise MotionOver("nothing was moved: the time by which it was to begin has passed") from None
        self._refuse_ticket(ticket)

    def _refuse_ticket(self, ticket: Ticket) -> None:
        """Raise MotionOver after a stop, after the time of a motion, and right after the hub stood still."""
        if refusal := self._own_program().gates.ticket(_ANY_MOTION, ticket):
            raise refusal

    async def end_move(self, servo_ids: Sequence[int]) -> None:
        """Stop the motions of this program, including unsent ones (see `Hub.end_move`)."""
        self.stops.stop()
        self._changed.set()
        await self.hub.end_move(self.session, servo_ids)

    async def readings(self, unit: AngleUnit = "degree") -> Board:
        """Return the board that the hub reads for all programs, once no program has exclusive use.

        The program that holds it reads degrees with its own board, if it can.
        """
        await self.until_free()
        if unit == "degree" and self.hub.exclusive_use is not None and self._program is not None:
            return await self.board()
        return await self._readings.board(unit)

    async def read(self, work: Callable[[Board], Awaitable[T]], open_board: OpenBoard | None = None) -> T:
        """Return the result of `work` on the board of this program, or of `open_board`.

        If another program took exclusive use of the board meanwhile, and nothing was answered, read again afterwards.
        """
        while True:
            board = await (open_board or self.board)()
            try:
                return await work(board)
            except RequestTimeout:
                if self.hub.exclusive_use is None:
                    raise

    @property
    def limits(self) -> MotionLimits:
        """Limits of the motions of this program: those of the board, and those of `tighten`."""
        limits = self.hub.board.limits
        return limits if self._limits is None else limits.tightened(self._limits)

    def tighten(self, limits: MotionLimits) -> None:
        """Add `limits` to the motions of this program."""
        self._own_program()  # what moves by frames would not be limited
        if self._board is not None:
            raise RpcError(
                Code.INVALID_REQUEST,
                "this program has used the board already",
                remedy="tighten the limits before anything else",
            )
        if self._limits is not None and len(list(self._limits.parts())) >= MOST_LIMITS:
            raise RpcError(
                Code.INVALID_REQUEST,
                f"this program has {MOST_LIMITS} limits already",
                remedy="tighten the limits of all servos in one call",
            )
        self._limits = limits if self._limits is None else self._limits.tightened(limits)

    @property
    def questions(self) -> Questions:
        """Questions to a person. Raise RpcError for a connection that joined the session of another connection."""
        self._own_program()  # ids of sessions are no secret: a program could answer as a page that it has joined
        return self.hub.questions

    def _own_program(self) -> DirectProgram:
        """Return the session of this program. Raise RpcError for a connection that joined another one."""
        if self._program is None:
            raise RpcError(
                Code.FORBIDDEN,
                "this connection belongs to a program that has a board of its own",
                remedy="connect to the control interface without `session`",
            )
        return self._program

    # --- lease and hold -----------------------------------------------------------------------------------------

    def take_lease(self, *, force: bool = False, dead_man: float | None = None, is_beat: bool = False) -> None:
        """Take the lease. Raise LeaseRefused with the name of the holder.

        `dead_man` is that of the greeting unless it is given.
        """
        self._check_joined()
        dead_man = self._dead_man if dead_man is None else dead_man
        if not self.hub.leases.take(self.session, force=force, dead_man=dead_man, is_beat=is_beat):
            raise LeaseRefused(f"nothing was moved: {self.hub.leases.reason(self.session)}")

    @property
    def holder(self) -> HoldStatus | None:
        """Other program with exclusive use of the board; None without one."""
        hold = self.hub.exclusive_use
        return None if hold is None or hold.session == self.session else hold

    async def until_free(self) -> None:
        """Wait until no other program has exclusive use of the board."""
        while self.holder is not None:
            self._changed.clear()
            await self._changed.wait()

    @asynccontextmanager
    async def exclusive(self, reason: str) -> AsyncIterator[None]:
        """Take exclusive use of the board in this context, after waiting for other programs; unless already held."""
        hold = self.hub.exclusive_use
        if hold is not None and hold.session == self.session:
            yield
            return
        await self.begin_exclusive_use(reason)
        try:
            yield
        finally:
            self.hub.end_exclusive_use(self.session)

    @contextmanager
    def moving(self) -> Iterator[None]:
        """Hold the lease in this context. Raise LeaseRefused if another program holds the lease."""
        lease = self.hub.lease
        self.take_lease()
        try:
            yield
        finally:
            if lease is None or lease.session != self.session:
                self.hub.leases.give(self.session)

    async def begin_exclusive_use(self, reason: str) -> None:
        """Take exclusive use of the board, as soon as no other program has it."""
        self._check_joined()
        while not self.hub.begin_exclusive_use(self.session, reason):
            await self.until_free()
            self._check_joined()  # the session of the program's frames may have ended meanwhile

    def _check_joined(self) -> None:
        """Raise ConnectionLost for an ended session: the board was disconnected, or the hub has ended."""
        if self.session not in self.hub.programs:
            raise ConnectionLost("the session has ended; connect again")


def _joined(hub: Hub, *, who: str, role: Role, session: str) -> DirectProgram:
    try:
        return DirectProgram(hub, who=who, door="share", role=role, session_id=session)
    except ValueError as error:
        raise OpenError(f"share://{hub.name}: {error}") from None


def _board_of(program: DirectProgram, hub: Hub, limits: MotionLimits) -> Board:
    """Return the board of `hub` for a program, within `limits` and in the units of the program."""
    servos = servos_of(hub.board)
    planner = MotionPlanner(limits, servos.planner.interval_unit)
    return Board(Session(program, None, hub.board.profile), None, planner, servos, program.units)
