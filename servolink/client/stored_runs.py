"""StoredRuns: stored actions and macros (3.2.6, 3.3.9), compared with the limits of movements before a run."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterator, Mapping
from contextlib import aclosing
from typing import TYPE_CHECKING, Any

from servolink.client.board_records import RecordStore
from servolink.client.board_servos import ServoController
from servolink.client.collect import check_can_wait, collect
from servolink.client.servo_state import Servo
from servolink.client.session import Session
from servolink.connection.explain import described
from servolink.errors import ConnectionLost, MotionRefused, Reason, Rejected, RequestRefused, TargetNotReached
from servolink.motion.angles import Degrees
from servolink.motion.limits import MotionLimits
from servolink.motion.movement import INTERVAL_UNIT
from servolink.motion.ticket import Ticket
from servolink.numeric import check_seconds
from servolink.project.model import Project
from servolink.project.record_lookup import name_of
from servolink.protocol.editing import ExecuteMacroRequest, ExecuteMacroResponse
from servolink.protocol.packet import Packet
from servolink.protocol.record_types import ACTION, MACRO, RecordType
from servolink.protocol.records import Action, Macro
from servolink.protocol.servos import ExecuteActionExRequest, ExecuteActionRequest
from servolink.tasks import computed

if TYPE_CHECKING:  # imported late: most programs run no stored records
    from servolink.project.speed import RecordRun

_LOOK_EVERY = 0.1  # seconds


class StoredRuns:
    """Runs stored actions and macros. Under limits, refuses a run beyond a limit."""

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

    async def run_action(
        self, action: int | str, *, wait: bool = False, dry_run: bool = False, ticket: Ticket | None = None
    ) -> float:
        """Run a stored action and return its duration in seconds (see `Board.run_action`)."""
        connection = self._session.connection
        ticket = ticket or connection.stops.ticket()
        action_id = await self._records.id_of(ACTION, action)
        if self._limits:
            run, ticket = await self._prepare(ACTION, action_id, ticket, wait=wait, dry_run=dry_run)
        else:  # read all the same: the board does not answer the command itself, and ignores unknown ids
            run = await self._read(ACTION, action_id, wait=wait)
        request = ExecuteActionExRequest(action_id)
        if dry_run:
            return run.seconds()
        await connection.send(request, ticket=ticket)
        if wait:
            await self._until_over(run, request, ticket)
        return run.seconds()

    async def run_macro(
        self, macro: int | str, *, wait: bool = False, dry_run: bool = False, ticket: Ticket | None = None
    ) -> None:
        """Start a stored macro (see `Board.run_macro`)."""
        connection = self._session.connection
        ticket = ticket or connection.stops.ticket()
        macro_id = await self._records.id_of(MACRO, macro, must_exist=not (self._limits or wait))
        run = None
        if self._limits:
            run, ticket = await self._prepare(MACRO, macro_id, ticket, wait=wait, dry_run=dry_run)
        elif wait or dry_run:
            run = await self._read(MACRO, macro_id, wait=wait)
        if dry_run:
            return
        request = ExecuteMacroRequest(macro_id)
        response = await connection.request(request, ticket=ticket)
        if not response.result:
            cause = "the macro may run itself, or something that is not stored"
            raise Rejected(f"{self._session.url} refused {described(request)}: {cause}", request)
        if wait and run is not None:
            await self._until_over(run, request, ticket)

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
        _, ticket = await self._prepare(MACRO, packet.macro_id, ticket or connection.stops.ticket())
        return await connection.request(packet, timeout=timeout, unchecked=unchecked, ticket=ticket)

    async def _read(self, kind: RecordType[Any], record_id: int, *, wait: bool) -> RecordRun:
        """Read the run of a record. Raise RequestRefused if the caller wants to wait for an unknown end."""
        from servolink.project.speed import RecordRun

        stored = await collect(self._records.get, kind, record_id)
        run = await computed(RecordRun)(stored, kind.by_id(stored)[record_id], self._interval_unit)
        if wait:
            await computed(check_can_wait)(run, await self._servos.servos())
        return run

    async def _prepare(
        self, kind: RecordType[Any], record_id: int, ticket: Ticket, *, wait: bool = False, dry_run: bool = False
    ) -> tuple[RecordRun, Ticket]:
        """Read a record with all records run by it, and prepare the run (see `prepare`)."""
        return await self.prepare(lambda: self._read(kind, record_id, wait=False), ticket, wait=wait, dry_run=dry_run)

    async def prepare(
        self, read: Callable[[], Awaitable[RecordRun]], ticket: Ticket, *, wait: bool = False, dry_run: bool = False
    ) -> tuple[RecordRun, Ticket]:
        """Return the run from `read` if allowed to begin now, with a ticket of this check.

        Servos in an unknown pose are moved to the first pose of the record. That takes seconds, so everything is read
        and checked again. Raise MotionRefused for a record that exceeds the limits or cannot be checked.
        """
        from servolink.project.preflight import preflight_run, uncheckable  # late: most programs set no limits

        while True:
            run = await read()
            stored, record = run.stored, run.record
            servos = {servo.servo_id: servo for servo in await self._servos.servos()}
            units_sent = self._session.connection.units_sent
            _refuse(record, await _first(uncheckable, stored))
            pose = run.first_pose()
            self._check_servos(record, stored, servos)
            active = {servo_id for servo_id in pose if servo_id in servos and _is_active(servos[servo_id])}
            first = self._servos.soft_start.first_moves(active)
            start = {servo_id: int(servo.angle) for servo_id, servo in servos.items()}
            start |= {servo_id: pose[servo_id] for servo_id in first}
            _refuse(record, await _first(preflight_run, run, stored, self._limits, start), Reason.LIMIT)
            if wait:
                await computed(check_can_wait)(run, servos.values())
            self._check_is_current(name_of(record), ticket)
            if dry_run or not first:
                return run, ticket.checked(units_sent)
            await self._move_softly(record, {servo_id: pose[servo_id] for servo_id in first}, ticket)
            ticket = ticket.begun()

    async def _until_over(self, run: RecordRun, packet: Packet, ticket: Ticket) -> None:
        """Wait until a run is over and the servos rest in the last pose (see `Board.run_action`)."""
        loop = asyncio.get_running_loop()
        end = loop.time() + run.seconds()
        # The line is left free meanwhile, so a stop and a loss are looked for here.
        while (remaining := end - loop.time()) > 0:
            await asyncio.sleep(min(remaining, _LOOK_EVERY))
            self._session.check_goes_on(name_of(run.record), packet, ticket)
        await self.until_at_rest(run, packet, ticket)

    async def until_at_rest(self, run: RecordRun, packet: Packet, ticket: Ticket) -> None:
        """Wait until the servos of a run rest in the last pose. Raise TargetNotReached for the others."""
        async with aclosing(self._servos.until_at_rest(run.last_pose())) as readings:
            async for _ in readings:
                self._session.check_goes_on(name_of(run.record), packet, ticket)

    async def _move_softly(self, record: Action | Macro, pose: Mapping[int, int], ticket: Ticket) -> None:
        """Move servos to the first pose of a record and wait for the arrival. A stop ends the movement."""
        softest = min(speed for servo_id in pose if (speed := self._limits.soft_speed_of(servo_id)) is not None)
        seconds = await self._servos.move(pose, speed=softest, ticket=ticket)
        goals = {servo_id: Degrees(angle) for servo_id, angle in pose.items()}
        try:
            async with aclosing(self._servos.until_arrived(goals, seconds)) as readings:
                async for _ in readings:
                    self._check_is_current(name_of(record), ticket)
        except TargetNotReached as error:
            text = f"{name_of(record)} was not run, as servos have not reached its first pose: {error}"
            raise TargetNotReached(text, error.late) from None

    def _check_is_current(self, name: str, ticket: Ticket) -> None:
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
