"""Runs of stored actions and macros (3.2.6, 3.3.9), read with all that they run, and compared with the limits."""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, TypeAlias

from servolink.client.board_records import RecordStore
from servolink.client.board_servos import ServoController
from servolink.client.servo_state import Servo, until_over
from servolink.client.session import Session
from servolink.errors import ConnectionLost, MotionRefused, NotFound, Reason, Rejected, RequestRefused, TargetNotReached
from servolink.motion import Ticket
from servolink.project import Project, RecordRun, name_of, preflight_run, uncheckable
from servolink.protocol import (
    ACTION,
    MACRO,
    Action,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    Macro,
    Packet,
    RecordType,
)
from servolink.support import check_seconds, computed

_MOST = ACTION.list_limit + MACRO.list_limit  # bound of all lists of records

Get: TypeAlias = Callable[[RecordType[Any], int], Awaitable[Any]]
"""Returns a record by type and id. Raises NotFound if there is none."""


class StoredRuns:
    """Runs stored actions and macros. Under limits, refuses a run beyond a limit."""

    def __init__(self, session: Session, servos: ServoController, records: RecordStore) -> None:
        """Read records with `records`, and servos with `servos`, whose planner has the limits."""
        self._session = session
        self._servos = servos
        self._records = records
        self._limits = servos.planner.limits
        self._interval_unit = servos.planner.interval_unit

    async def run_action(
        self,
        action: int | str,
        *,
        wait: bool = False,
        dry_run: bool = False,
        any_angle: bool = False,
        ticket: Ticket | None = None,
    ) -> float:
        """Run a stored action and return its duration in seconds (see `Board.run_action`)."""
        connection = self._session.connection
        ticket = ticket or connection.stops.ticket()
        action_id = await self._records.id_of(ACTION, action)
        if self._limits:
            run, ticket = await self._prepare(
                ACTION, action_id, ticket, wait=wait, dry_run=dry_run, any_angle=any_angle
            )
        else:
            await self._check_start(ACTION, action_id, any_angle=any_angle)
            # read all the same: the board does not answer the command itself, and ignores unknown ids
            run = await self._read(ACTION, action_id, wait=wait)
        request = ExecuteActionExRequest(action_id)
        if dry_run:
            return run.seconds()
        await connection.send(request, ticket=ticket)
        if wait:
            await self.until_at_rest(run, request, ticket, run.seconds())
        return run.seconds()

    async def run_macro(
        self,
        macro: int | str,
        *,
        wait: bool = False,
        dry_run: bool = False,
        any_angle: bool = False,
        ticket: Ticket | None = None,
    ) -> None:
        """Start a stored macro (see `Board.run_macro`)."""
        connection = self._session.connection
        ticket = ticket or connection.stops.ticket()
        macro_id = await self._records.id_of(MACRO, macro, must_exist=not (self._limits or wait))
        run = None
        if self._limits:
            run, ticket = await self._prepare(MACRO, macro_id, ticket, wait=wait, dry_run=dry_run, any_angle=any_angle)
        else:
            await self._check_start(MACRO, macro_id, any_angle=any_angle)
            if wait or dry_run:
                run = await self._read(MACRO, macro_id, wait=wait)
        if dry_run:
            return
        request = ExecuteMacroRequest(macro_id)
        response = await connection.request(request, ticket=ticket)
        if not response.result:
            await self._session.check_refused(request, ticket)
            cause = "the macro may run itself, or something that is not stored"
            raise Rejected(f"{self._session.url} refused {request.described}: {cause}", request)
        if wait and run is not None:
            await self.until_at_rest(run, request, ticket, run.seconds())

    async def request(
        self,
        packet: ExecuteMacroRequest,
        *,
        timeout: float | None = None,
        unchecked: bool = False,
        ticket: Ticket | None = None,
    ) -> ExecuteMacroResponse:
        """Start a stored macro and return the response without a check. Raise MotionRefused beyond limits."""
        if not self._limits:
            return await self._session.request(packet, timeout=timeout, unchecked=unchecked, ticket=ticket)
        if timeout is not None:
            check_seconds("timeout", timeout)
        connection = self._session.connection
        ticket = ticket or connection.stops.ticket()
        _, ticket = await self._prepare(MACRO, packet.macro_id, ticket, any_angle=True)
        return await connection.request(packet, timeout=timeout, unchecked=unchecked, ticket=ticket)

    async def _check_start(self, kind: RecordType[Any], record_id: int, *, any_angle: bool) -> None:
        """Raise MotionRefused for a run of servos with readings that cannot be true. The run is read only for such."""
        if not any_angle and (doubtful := await self._servos.doubtful()):
            moved = (await self._read(kind, record_id, wait=False)).servo_ids() & doubtful
            self._servos.known.check_readings(moved, self._servos.units.current.of, self._limits)

    async def _read(self, kind: RecordType[Any], record_id: int, *, wait: bool) -> RecordRun:
        """Read the run of a record. Raise RequestRefused if the caller wants to wait for an unknown end."""
        stored = await collect(self._records.get, kind, record_id)
        run = await computed(RecordRun)(stored, kind.by_id(stored)[record_id], self._interval_unit)
        if wait:
            await computed(check_can_wait)(run, await self._servos.servos())
        return run

    async def _prepare(
        self, kind: RecordType[Any], record_id: int, ticket: Ticket, **options: bool
    ) -> tuple[RecordRun, Ticket]:
        """Read a record with all records run by it, and prepare the run (see `prepare`)."""
        return await self.prepare(lambda: self._read(kind, record_id, wait=False), ticket, **options)

    async def prepare(
        self,
        read: Callable[[], Awaitable[RecordRun]],
        ticket: Ticket,
        *,
        wait: bool = False,
        dry_run: bool = False,
        any_angle: bool = False,
    ) -> tuple[RecordRun, Ticket]:
        """Return the run from `read` if allowed to begin now, with a ticket of this check.

        Servos in an unknown pose are moved to the first pose of the record. That takes seconds, so everything is read
        and checked again. Raise MotionRefused for a record that exceeds the limits or cannot be checked, and unless
        `any_angle`, for servos with readings that cannot be true.
        """
        while True:
            run = await read()
            stored, record = run.stored, run.record
            servos = {servo.servo_id: servo for servo in await self._servos.servos()}
            units_sent = self._session.connection.units_sent
            _refuse(record, await _first(uncheckable, stored))
            pose = run.first_pose()
            self._check_servos(record, stored, servos)
            if not any_angle:
                self._servos.known.check_readings(run.servo_ids(), self._servos.units.of, self._limits)
            active = {servo_id for servo_id in pose if servo_id in servos and _is_active(servos[servo_id])}
            first = self._servos.soft_start.first_moves(active, self._limits)
            start = {servo_id: int(servo.angle) for servo_id, servo in servos.items()}
            start |= {servo_id: pose[servo_id] for servo_id in first}
            _refuse(record, await _first(preflight_run, run, stored, self._limits, start), Reason.LIMIT)
            if wait:
                await computed(check_can_wait)(run, servos.values())
            self.check_is_current(name_of(record), ticket)
            if dry_run or not first:
                return run, ticket.checked(units_sent)
            await self._move_softly(record, {servo_id: pose[servo_id] for servo_id in first}, ticket)
            ticket = ticket.begun()

    async def until_at_rest(self, run: RecordRun, packet: Packet, ticket: Ticket, seconds: float = 0.0) -> None:
        """Wait for `seconds`, and until servos rest in the last pose of a run (see `until_over`)."""
        check = partial(self._session.check_goes_on, name_of(run.record), packet, ticket)
        await self._servos.until_at_rest(run.last_pose(), seconds, check)

    async def _move_softly(self, record: Action | Macro, pose: Mapping[int, int], ticket: Ticket) -> None:
        """Move servos to the first pose of a record and wait for the arrival. A stop ends the movement."""
        softest = min(speed for servo_id in pose if (speed := self._limits.soft_speed_of(servo_id)) is not None)
        plan = await self._servos.move(await self._servos.movement(pose, speed=softest), ticket)
        try:
            check = partial(self.check_is_current, name_of(record), ticket)
            await until_over(self._servos.servos, plan.goals, plan.seconds, check)
        except TargetNotReached as error:
            text = f"{name_of(record)} was not run, as servos have not reached its first pose: {error}"
            raise TargetNotReached(text, error.late) from None

    def check_is_current(self, name: str, ticket: Ticket) -> None:
        """Raise the error of a run that cannot begin: a loss, a stop, or another program with the lease."""
        connection = self._session.connection
        if not connection.stops.issued(ticket):
            raise ConnectionLost(f"{name} was not run: the connection was lost while it was checked")
        if not connection.stops.holds(ticket):
            raise RequestRefused(f"{name} was not run: a stop came first", reason=Reason.STOP)
        if refusal := connection.gates.lease(ExecuteActionRequest(), ticket):
            raise MotionRefused(f"{name} was not run: {refusal}") from refusal

    def _check_servos(self, record: Action | Macro, stored: Project, servos: Mapping[int, Servo]) -> None:
        """Raise MotionRefused for a servo whose limits cannot be applied."""
        for action in stored.actions:
            for number, step in enumerate(action.steps, 1):
                if not self._limits.apply_to(step.servo_id):
                    continue
                where = f"{name_of(action)}, step {number} moves servo {step.servo_id}"
                if self._servos.units.of(step.servo_id) != "degree":
                    why = f"{where}, which is not set to degrees; limits and speeds are in degrees"
                    _refuse(record, why, Reason.ANGLE_UNIT)
                if step.servo_id not in servos and self._limits.limit_speed_of(step.servo_id):
                    _refuse(record, f"{where}, which the board does not report, so its speed is unknown")


@computed
def _first(search: Callable[..., Iterator[str]], *arguments: Any) -> str:
    """Return the first fault that a search finds; empty if there is none."""
    return next(search(*arguments), "")


def _is_active(servo: Servo) -> bool:
    """Return whether a servo would move, neither stopped nor released."""
    return servo.is_start and servo.is_hold


def _refuse(record: Action | Macro, why: str, reason: Reason = Reason.OTHER) -> None:
    """Raise MotionRefused if there is a reason."""
    if why:
        name = name_of(record)
        raise MotionRefused(f"{name} was not run: {why.removeprefix(f'{name}, ')}", reason=reason)


async def collect(get: Get, kind: RecordType[Any], record_id: int) -> Project:
    """Read an action or a macro with all records run by it.

    Raise NotFound if the board does not return one of them, MotionRefused if they are too many or nested too deep.
    """
    record = await get(kind, record_id)
    found: dict[tuple[RecordType[Any], int], Any] = {(kind, record_id): record}
    waiting = deque([(record, 0)])
    while waiting:
        caller, depth = waiting.popleft()
        for called in RecordType.of(caller).references(caller):
            if called in found:
                continue
            if depth == Macro.MAX_NESTING or len(found) == _MOST:
                many = f"it runs {len(found):,} records, in macros up to {depth + 1} deep"
                raise MotionRefused(
                    f"{name_of(record)} was not run: {many}; at most {_MOST:,} and {Macro.MAX_NESTING} are read first"
                )
            try:
                found[called] = await get(*called)
            except NotFound as error:
                missing = f"{name_of(caller)} runs {called[0]} {called[1]}, which could not be read"
                raise NotFound(f"{name_of(record)} was not run: {missing}", error.request) from error
            waiting.append((found[called], depth + 1))
    return Project(
        actions=tuple(one for one in found.values() if isinstance(one, Action)),
        macros=tuple(one for one in found.values() if isinstance(one, Macro)),
    )


def check_can_wait(run: RecordRun, servos: Iterable[Servo]) -> None:
    """Raise RequestRefused for an endless run, NotFound for a run of missing servos."""
    name = name_of(run.record)
    if why := next(uncheckable(run.stored), ""):
        raise RequestRefused(f"{name} was not run, because its end could not be known: {why}")
    present = {servo.servo_id for servo in servos}
    if missing := sorted(servo_id for servo_id in run.last_pose() if servo_id not in present):
        raise NotFound(f"{name} was not run: it moves servo {missing[0]}, which the board does not have")
