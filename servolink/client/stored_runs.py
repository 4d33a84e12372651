"""StoredRuns: runs what is stored on a board (3.2.6, 3.3.9), after comparing it with the limits of movements."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from contextlib import aclosing
from typing import Any, NamedTuple

from servolink.client.records import RecordStore
from servolink.client.servos import Servo, ServoController
from servolink.client.session import Session
from servolink.connection.connection import Connection
from servolink.connection.explain import described
from servolink.connection.options import check_seconds
from servolink.errors import ConnectionLost, MotionRefused, NotFound, Rejected, RequestError
from servolink.motion import INTERVAL_UNIT, Degrees, MotionLimits
from servolink.project.model import Project
from servolink.project.preflight import preflight_run, uncheckable
from servolink.project.records import name_of
from servolink.project.speed import Run
from servolink.protocol.editing import ExecuteMacroRequest, ExecuteMacroResponse
from servolink.protocol.record_types import ACTION, MACRO, RecordType, type_of
from servolink.protocol.records import Action, Macro
from servolink.protocol.servos import ExecuteActionExRequest

_DEEPEST = 32  # macros within macros: no robot needs more, and a board that makes them up is not read for ever
_MOST = ACTION.list_limit + MACRO.list_limit  # no board can list more


class _Asked(NamedTuple):
    """When a run was asked for: a later stop ends it, as does the loss of the connection."""

    connection: Connection
    stops: int


class StoredRuns:
    """Runs stored actions and macros. If movements are limited, what would exceed a limit is not run."""

    def __init__(
        self,
        session: Session,
        servos: ServoController,
        records: RecordStore,
        limits: MotionLimits,
        interval_unit: float = INTERVAL_UNIT,
    ) -> None:
        """Read records with `records` and servos with `servos`; an interval of 1 stands for `interval_unit` seconds."""
        self._session = session
        self._servos = servos
        self._records = records
        self._limits = limits
        self._interval_unit = interval_unit

    async def run_action(self, action_id: int, *, dry_run: bool = False) -> float:
        """Run a stored action and return its duration in seconds (see `Board.run_action`)."""
        asked = self._asked()
        if self._limits:
            action, units_sent = await self._prepare(ACTION, action_id, asked, dry_run=dry_run)
        else:  # read all the same: the board does not answer the command itself, and ignores unknown ids
            action, units_sent = await self._records.get(ACTION, action_id), None
        request = ExecuteActionExRequest(action_id)
        if not dry_run and not await asked.connection.send(
            request, unless_stopped_since=asked.stops, unless_units_since=units_sent
        ):
            raise RequestError(f"{name_of(action)} was not run: an angle unit was set while it was checked", request)
        longest = max((step.interval for step in action.steps), default=0)
        return round(longest * self._interval_unit, 9)

    async def run_macro(self, macro_id: int, *, dry_run: bool = False) -> None:
        """Start a stored macro (see `Board.run_macro`)."""
        if dry_run:
            if self._limits:
                await self._prepare(MACRO, macro_id, self._asked(), dry_run=True)
            return
        request = ExecuteMacroRequest(macro_id)
        if not (await self.request(request)).result:
            cause = "it may have no such macro, or the macro runs itself"
            raise Rejected(f"{self._session.url} refused {described(request)}: {cause}", request)

    async def request(
        self, packet: ExecuteMacroRequest, *, timeout: float | None = None, unchecked: bool = False
    ) -> ExecuteMacroResponse:
        """Start a stored macro and return the response, whatever it says. Raise MotionRefused beyond limits."""
        if not self._limits:
            return await self._session.request(packet, timeout=timeout, unchecked=unchecked)
        if timeout is not None:
            check_seconds("timeout", timeout)
        asked = self._asked()
        _, units_sent = await self._prepare(MACRO, packet.macro_id, asked)
        # Nothing was awaited since `_prepare` looked for a stop, and after a later one the connection does not send it.
        return await asked.connection.request(
            packet, timeout=timeout, unchecked=unchecked, unless_units_since=units_sent
        )

    def _asked(self) -> _Asked:
        connection = self._session.connection
        return _Asked(connection, connection.stops)

    async def _prepare(
        self, kind: RecordType[Any], record_id: int, asked: _Asked, *, dry_run: bool = False
    ) -> tuple[Any, int]:
        """Return a record that may run now, and how many angle units had been sent when it was checked.

        Servos in an unknown pose are moved to the first pose of the record. That takes seconds, so everything is read
        and checked again. Raise MotionRefused for a record that exceeds the limits or cannot be checked.
        """
        while True:
            stored = await self._collect(kind, record_id)
            record = kind.by_id(stored)[record_id]
            servos = {servo.servo_id: servo for servo in await self._servos.servos()}
            units_sent = asked.connection.units_sent
            _refuse(record, next(uncheckable(stored), ""))
            run = Run(stored, record, self._interval_unit)
            pose = run.first_pose()
            self._check_servos(record, stored, servos)
            active = {servo_id for servo_id in pose if servo_id in servos and _is_active(servos[servo_id])}
            first = self._servos.soft_start.first_moves(active)
            start = {servo_id: int(servo.angle) for servo_id, servo in servos.items()}
            start |= {servo_id: pose[servo_id] for servo_id in first}
            _refuse(record, next(preflight_run(run, stored, self._limits, start), ""))
            self._check_is_wanted(record, asked)
            if dry_run or not first:
                return record, units_sent
            await self._move_softly(record, {servo_id: pose[servo_id] for servo_id in first}, asked)

    async def _move_softly(self, record: Action | Macro, pose: Mapping[int, int], asked: _Asked) -> None:
        """Move servos to the first pose of a record and wait until they have arrived. A stop ends it."""
        softest = min(speed for servo_id in pose if (speed := self._limits.soft_speed_of(servo_id)) is not None)
        seconds = await self._servos.move(pose, speed=softest)
        goals = {servo_id: Degrees(angle) for servo_id, angle in pose.items()}
        async with aclosing(self._servos.until_arrived(goals, seconds)) as readings:
            async for _ in readings:
                self._check_is_wanted(record, asked)

    def _check_is_wanted(self, record: Action | Macro, asked: _Asked) -> None:
        """Raise RequestError if there was a stop since a run was asked for, ConnectionLost if the connection is new."""
        if asked.connection is not self._session.connection:
            raise ConnectionLost(f"{name_of(record)} was not run: the connection was lost while it was checked")
        if asked.connection.stops != asked.stops:
            raise RequestError(f"{name_of(record)} was not run: a stop came first")

    def _check_servos(self, record: Action | Macro, stored: Project, servos: Mapping[int, Servo]) -> None:
        """Raise MotionRefused for a servo whose limits cannot be applied."""
        for action in stored.actions:
            for number, step in enumerate(action.steps, 1):
                if not self._limits.apply_to(step.servo_id):
                    continue
                where = f"{name_of(action)}, step {number} moves servo {step.servo_id}"
                if self._servos.units.of(step.servo_id) != "degree":
                    _refuse(record, f"{where}, which is not set to degrees; limits and speeds are in degrees")
                if step.servo_id not in servos and self._limits.limit_speed_of(step.servo_id):
                    _refuse(record, f"{where}, which the board does not report, so its speed is unknown")

    async def _collect(self, kind: RecordType[Any], record_id: int) -> Project:
        """Read an action or a macro and all that it runs.

        Raise NotFound if the board does not return one of them, MotionRefused if they are too many or nested too deep.
        """
        record = await self._records.get(kind, record_id)
        found: dict[tuple[RecordType[Any], int], Any] = {(kind, record_id): record}
        waiting = deque([(record, 0)])
        while waiting:
            caller, depth = waiting.popleft()
            for called in type_of(caller).references(caller):
                if called in found:
                    continue
                if depth == _DEEPEST or len(found) == _MOST:
                    _refuse(record, f"it runs {len(found):,} records, in macros up to {depth + 1} deep")
                found[called] = await self._called(record, caller, *called)
                waiting.append((found[called], depth + 1))
        return Project(
            actions=tuple(one for one in found.values() if isinstance(one, Action)),
            macros=tuple(one for one in found.values() if isinstance(one, Macro)),
        )

    async def _called(self, record: Action | Macro, caller: Macro, kind: RecordType[Any], record_id: int) -> Any:
        try:
            return await self._records.get(kind, record_id)
        except NotFound as error:
            text = f"{name_of(record)} was not run: {name_of(caller)} runs {kind} {record_id}, which could not be read"
            raise NotFound(text, error.request) from error


def _is_active(servo: Servo) -> bool:
    """Return whether a servo would move; one that is stopped or released would not."""
    return servo.is_start and servo.is_hold


def _refuse(record: Action | Macro, why: str) -> None:
    """Raise MotionRefused if there is a reason."""
    if why:
        name = name_of(record)
        raise MotionRefused(f"{name} was not run: {why.removeprefix(f'{name}, ')}")
