"""Servos (3.2): reading, moving, stopping and releasing them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Callable, Hashable, Iterable, Mapping
from contextlib import aclosing, suppress
from functools import partial

from msgspec.structs import replace

from servolink.client.all_servos import AllServos, KnownServos
from servolink.client.angle_units import AngleUnits
from servolink.client.captions import Targets
from servolink.client.servo_state import Servo, angles_of, servos_of_states, until_arrived, until_over
from servolink.client.session import Session
from servolink.client.soft_start import SoftStart
from servolink.connection import Connection, UnitsChanged
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    EncodeError,
    MotionRefused,
    NotFound,
    OutcomeUnknown,
    Reason,
    Rejected,
    RequestRefused,
    RequestTimeout,
    TargetNotReached,
    TransportError,
    quote,
)
from servolink.motion import (
    FRESH,
    AngleUnit,
    MotionLimits,
    MotionPlan,
    MotionPlanner,
    Movement,
    ServoUnits,
    SetPoints,
    Speed,
    Ticket,
    check_pace,
    checked_targets,
    in_unit,
)
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
)
from servolink.support import time_with_sleep

_STOP_TRIES = 3
_ALL = "all"  # as in `captions`, which is loaded for captions only


class ServoController:
    """Reads, moves, stops and releases the servos of a board."""

    def __init__(
        self,
        session: Session,
        angle_unit: AngleUnit | None,
        planner: MotionPlanner,
        shared: ServoController | None = None,
        units: ServoUnits | None = None,
    ) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None changes no unit.

        Movements are planned by `planner`. For a program of a hub, what is known of the servos is that of `shared`, and
        the hub sets `units`, those of the program, before each packet that depends on them.
        """
        self.all = AllServos(session, None if shared is None else shared.known)
        self.known: KnownServos = self.all.known
        self.units = AngleUnits(session, self.all, angle_unit, units)
        self.soft_start: SoftStart = SoftStart(session) if shared is None else shared.soft_start
        self.planner = planner
        self._session = session
        self._read_after: tuple[int, int] | None = None  # losses and units sent before the reading of `doubtful`

    @property
    def connection(self) -> Connection:
        """Present connection to the board."""
        return self._session.connection  # type: ignore[return-value]  # another kind only within a hub

    async def servo_ids(self) -> tuple[int, ...]:
        """Return the ids of all servos (3.2.1)."""
        listed = (await self._session.request(QueryServoListRequest())).servo_id_list
        servo_ids = tuple(dict.fromkeys(listed))  # some boards list an id twice
        self.known.take_list(servo_ids)
        return servo_ids

    async def servos(self) -> tuple[Servo, ...]:
        """Return the state of all servos (3.2.2)."""
        return await self._read(ALL_SERVOS)

    async def doubtful(self) -> frozenset[int]:
        """Return the servos whose latest reading cannot be true. All are read once for a connection; no unit is set."""
        unit_of, read_after = self.units.current.of, (self._session.losses, self._session.connection.units_sent)
        if self._read_after != read_after:
            self._read_after = read_after
            with suppress(RequestTimeout, DecodeError):  # a board may move servos without reporting them
                await self._read(ALL_SERVOS, unit_of)
        return self.known.doubtful(unit_of)

    async def servo(self, which: int | str) -> Servo:
        """Return the state of a servo (3.2.2). Raise NotFound for a missing servo."""
        if which == _ALL:
            raise NotFound("'all' stands for all servos, whose states `servos` returns; for a caption write 'name:all'")
        servo_id = await self.all.id_of(which)
        for servo in await self._read(servo_id):
            if servo.servo_id == servo_id:
                return servo
        raise NotFound(f"the board has no servo {servo_id}", QueryServoRequest(servo_id))

    async def set_servo(self, which: int | str, *, start: bool, hold: bool, ticket: Ticket | None = None) -> None:
        """Start or stop, hold or release a servo (3.2.3). Raise Rejected if the board reports another state."""
        is_start, is_hold = _checked_flag("start", start), _checked_flag("hold", hold)
        ticket = ticket or self._session.ticket()
        servo_id = await self.all.id_of(which)
        request = SetServoParameterRequest(servo_id, is_start, is_hold)
        response = await self.answer_to(request, ticket=ticket)
        if response != SetServoParameterResponse(servo_id, is_start, is_hold):
            await self._session.check_refused(request, ticket)
            raise Rejected(
                f"servo {servo_id} was asked for start {is_start}, hold {is_hold}; the board "
                f"answered servo {response.servo_id}, start {response.is_start}, hold {response.is_hold}",
                request,
            )

    async def answer_to(
        self, request: SetServoParameterRequest, *, ticket: Ticket | None = None, unchecked: bool = False
    ) -> SetServoParameterResponse:
        """Set a servo, or each servo if the board ignores the request for all, and return the response.

        For each servo, the first response that refuses is returned, and no further servo is set.
        """
        if request.servo_id != ALL_SERVOS or not self.all.is_separate:
            try:
                return await self.request(request, ticket=ticket, unchecked=unchecked)
            except OutcomeUnknown:
                if request.is_start or request.servo_id != ALL_SERVOS or not await self.all.finds_separate():
                    raise
        accepted = SetServoParameterResponse(ALL_SERVOS, request.is_start, request.is_hold)
        for servo_id in await self.all.ids():
            single = SetServoParameterRequest(servo_id, request.is_start, request.is_hold)
            response = await self.request(single, ticket=ticket, unchecked=unchecked)
            if response != replace(accepted, servo_id=servo_id):
                return response
        return accepted

    async def request(
        self,
        packet: SetServoParameterRequest,
        *,
        timeout: float | None = None,
        unchecked: bool = False,
        ticket: Ticket | None = None,
    ) -> SetServoParameterResponse:
        """Send a packet to start, stop, hold or release, and return the response without a check."""
        readies = bool(packet.is_start and packet.is_hold)
        try:
            response = await self._session.request(packet, timeout=timeout, unchecked=unchecked, ticket=ticket)
            if readies and response == SetServoParameterResponse(packet.servo_id, 1, 1):
                self.known.set(packet.servo_id, is_idle=False)
            return response
        finally:  # answered or not: the request may have been executed
            self.soft_start.forget(packet)
            if not readies:
                self.known.set(packet.servo_id, is_idle=True)

    async def movement(
        self,
        targets: Targets,
        *,
        duration: float | None = None,
        speed: Speed | None = None,
        any_angle: bool = False,
    ) -> Movement:
        """Return a movement with its captions replaced by ids. Raise the errors that need no units (see `move`)."""
        check_pace(duration, speed, self.planner.interval_unit)  # refuse an impossible pace before anything is sent
        by_id = checked_targets(await self.all.targets_by_id(targets))  # a copy: callers change theirs
        return Movement(by_id, duration, speed, any_angle)

    async def plan(
        self, movement: Movement, ticket: Ticket, *, start: bool = False, planner: MotionPlanner | None = None
    ) -> MotionPlan:
        """Return the plan of a movement, without sending anything. Raise as `move`."""
        planner = planner or self.planner
        await self._idle(movement, ticket, planner, start=start)
        return (await self._planned(movement, planner))[0]

    async def move(
        self, movement: Movement, ticket: Ticket, *, start: bool = False, planner: MotionPlanner | None = None
    ) -> MotionPlan:
        """Plan a movement and send it (see `Board.move`). Return the plan that was sent.

        A hub plans the movements of a program with the `planner` for its limits.
        """
        planner = planner or self.planner
        if idle := await self._idle(movement, ticket, planner, start=start):
            await self._planned(movement, planner)  # no servo is started for a refused movement
        for servo_id in idle:
            await self.set_servo(servo_id, start=True, hold=True, ticket=ticket)
        connection = self._session.connection
        while True:
            plan, moving = await self._planned(movement, planner)
            # The movement may wait for its turn. If a unit is sent meanwhile, its numbers mean other angles.
            with suppress(UnitsChanged):
                fresh = _while_fresh(ticket, plan.goals, planner)
                await connection.send(plan.packet, ticket=fresh.checked(connection.units_sent))
                break
        self.soft_start.moved(moving, plan.seconds, ticket)
        return plan

    async def until_over(self, plan: MotionPlan, ticket: Ticket) -> None:
        """Wait until the servos of a plan, just sent, have arrived. Raise as `Session.check_goes_on`."""
        check = partial(self._session.check_goes_on, "the motion", plan.packet, ticket)
        await until_over(self.servos, plan.goals, plan.seconds, check)

    async def _idle(self, movement: Movement, ticket: Ticket, planner: MotionPlanner, *, start: bool) -> list[int]:
        """Return the servos to be started first (see `AllServos.ready`). A stop since `ticket` is the better reason."""
        # During a change, only `_planned` knows the units, and only a reading whether a servo is outside its limits.
        if not self.units.is_changing:
            planner.check(movement, self.units.of)
        try:
            return await self.all.ready(movement.targets, start=start)
        except RequestRefused as error:
            raise self._session.connection.gates.ticket(ExecuteActionRequest(), ticket) or error from None

    async def follow(
        self, targets: Targets, seconds: float, *, settle: bool = False
    ) -> AsyncGenerator[tuple[Servo, ...], None]:
        """Yield readings until the servos have arrived (see `Board.follow`)."""
        ticket = self._session.ticket()
        angles = checked_targets(await self.all.targets_by_id(targets))
        await self.units.ensure()
        goals = self.planner.goals(angles, self.units.of)
        try:
            async with aclosing(until_arrived(self.servos, goals, seconds, settle=settle)) as readings:
                async for servos in readings:
                    self._check_not_stopped(ticket)
                    yield servos
        except (TargetNotReached, OutcomeUnknown):
            self._check_not_stopped(ticket)
            raise

    def _check_not_stopped(self, ticket: Ticket) -> None:
        """Raise the error of a motion that a stop or a loss has ended. A lease is not asked: others may look on."""
        if not self._session.connection.stops.holds(ticket):
            self._session.check_goes_on("the motion", ExecuteActionRequest(), ticket)

    async def until_at_rest(self, angles: Mapping[int, int], seconds: float, check: Callable[[], None]) -> None:
        """Wait for `seconds`, and until servos rest at `angles`, in the unit of each servo (see `until_over`)."""
        goals = {servo_id: in_unit(angle, self.units.of(servo_id)) for servo_id, angle in angles.items()}
        await until_over(self.servos, goals, seconds, check, settle=True)

    async def send(self, packet: ExecuteActionRequest, *, ticket: Ticket | None = None) -> None:
        """Send a movement unchanged. Raise MotionRefused beyond the limits (see `Board.send`)."""
        connection, planner = self._session.connection, self.planner
        ticket = ticket or connection.stops.ticket()
        angles = {step.servo_id: step.degree for step in packet.steps}
        while True:
            await self.units.ensure()
            first = self.soft_start.first_moves(angles, planner.limits)
            pose, moving = await self._start(angles, needed=planner.limits_need_pose(angles, first))
            units_sent = connection.units_sent
            first = self.soft_start.first_moves(moving, planner.limits)
            planner.check_steps(packet.steps, self.units.of, pose, first)
            with suppress(UnitsChanged):
                await connection.send(packet, ticket=_while_fresh(ticket, angles, planner).checked(units_sent))
                break
        self.soft_start.moved(moving, planner.seconds_of(packet.steps), ticket)

    async def stream(self, targets: Mapping[int, float], points: SetPoints, ticket: Ticket) -> dict[int, int]:
        """Send a movement toward set-points, shortened by `points` to its limits. Return the angles sent."""
        loop = asyncio.get_running_loop()
        while True:
            await self.units.ensure()
            connection = self._session.connection
            units_sent = connection.units_sent
            for servo_id in targets:
                if self.units.of(servo_id) != "degree":
                    text = f"servo {servo_id} must be set to degrees, the unit of all set-points"
                    raise MotionRefused(text, reason=Reason.ANGLE_UNIT)
            # After any other motion, the last targets of the stream say nothing about the present angles.
            if points.motions != (motions := connection.motions):
                points.forget(motions)
            if points.lacking(targets, loop.time()):
                servos = await self.servos()
                points.read(angles_of(targets, servos), loop.time())
            if not points.any_angle:
                await self._check_start(targets, points.limits)
            steps = points.steps(targets, loop.time())
            # The movement may wait for the line. After a change of units meanwhile, everything is computed again.
            with suppress(UnitsChanged):
                await connection.send(ExecuteActionRequest(steps), ticket=ticket.checked(units_sent))
                break
        points.sent(targets, steps, loop.time())
        self.soft_start.moved(points.arrived, 0.0, ticket)
        return {step.servo_id: step.degree for step in steps}

    async def stop(self) -> None:
        """Stop and hold all servos, ahead of all waiting packets (see `Board.stop`)."""
        request = SetServoParameterRequest(ALL_SERVOS, 0, 1)
        doubt = ""
        for _ in range(_STOP_TRIES):
            connection = self._session.connection
            # Not a normal request: nothing is waited for, and the response looks like that of an earlier
            # `set_servo`. So the state of the servos is what counts.
            for servo_id in (ALL_SERVOS, *self.all.separate_ids):
                await connection.send_stop(SetServoParameterRequest(servo_id, 0, 1))
            self.known.set(ALL_SERVOS, is_idle=True)
            self.known.doubt()
            if connection.hub is not None and connection.is_suspended:
                await connection.hub.stop()  # the hub reads the servos: no other program may now
                return
            try:
                await connection.shake_hands()  # if put off, so that the stop goes first
                states = await self.all.states(timeout=connection.patience / _STOP_TRIES, first=True)
            except (RequestTimeout, DecodeError, RequestRefused) as error:
                doubt = str(error)
                continue
            except TransportError as error:
                if error.reason is Reason.SEVERAL_BOARDS:
                    doubt = str(error)
                    continue
                raise ConnectionLost(f"a stop was sent and could not be confirmed; stop again: {error}") from error
            moving = [state.servo_id for state in states if state.is_start or not state.is_hold]
            silent = sorted(self.known.ids - {state.servo_id for state in states})
            if states and not moving and not silent:
                return
            doubt = f"servos {silent} do not report" if silent and states else "no servo reports"
            if moving:
                doubt = f"servos {moving} report that they may still move or are not held"
        raise OutcomeUnknown(f"a stop was sent {_STOP_TRIES} times and could not be confirmed: {doubt}", request)

    async def _read(self, servo_id: int, unit_of: Callable[[int], AngleUnit | None] | None = None) -> tuple[Servo, ...]:
        """Return a servo or all servos (255), with angles in the reported unit, which is set first if not given."""
        while True:
            if unit_of is None:
                await self.units.ensure()
            connection = self._session.connection
            units_sent = connection.units_sent
            states = await self.all.states(servo_id)
            # After a unit sent during the query, the unit of the response is unknown: read again.
            if units_sent == connection.units_sent:
                servos = servos_of_states(states, unit_of := unit_of or self.units.of)
                self.known.take_readings({each.servo_id: (each.angle, each.doubt) for each in servos}, unit_of)
                return servos

    async def _planned(self, movement: Movement, planner: MotionPlanner) -> tuple[MotionPlan, set[int]]:
        """Return the plan of a movement for the units set now, and the servos that move."""
        await self.units.ensure()
        first = self.soft_start.first_moves(movement.targets, planner.limits)
        pose, moving = await self._start(movement.targets, needed=planner.needs_pose(movement, first))
        if not movement.any_angle:
            await self._check_start(movement.targets, planner.limits)
        first = self.soft_start.first_moves(moving, planner.limits)
        return planner.plan(movement, self.units.of, pose, first), moving

    async def _check_start(self, servo_ids: Iterable[int], limits: MotionLimits) -> None:
        """Raise MotionRefused for servos with readings that cannot be true; servos without a reading are read."""
        if self.known.lacks_reading(servo_ids, self.units.of):
            with suppress(RequestTimeout):  # a board may move servos without reporting them
                await self.servos()
        self.known.check_readings(servo_ids, self.units.of, limits)

    async def _start(self, servo_ids: Iterable[int], *, needed: bool) -> tuple[dict[int, int], set[int]]:
        """Return the present angles of servos, if needed, and the servos to move.

        Stopped and released servos do not move.
        """
        if not needed:
            return {}, set(servo_ids)
        servos = await self.servos()
        pose = angles_of(servo_ids, servos)
        return pose, {servo.servo_id for servo in servos if servo.servo_id in pose and servo.is_start and servo.is_hold}


def _while_fresh(ticket: Ticket, targets: Mapping[int, int], planner: MotionPlanner) -> Ticket:
    """Return `ticket`; for targets outside the limits it ends with the reading that allows them, just made."""
    if not planner.are_outside(targets):
        return ticket
    return replace(ticket, until=min(ticket.until, time_with_sleep() + FRESH))


def _checked_flag(name: str, value: object) -> int:
    """Return 0 or 1 for False or True. Raise EncodeError, with a text beginning with `name`, for other values."""
    if isinstance(value, float) or not isinstance(value, Hashable) or value not in {0, 1}:
        raise EncodeError(f"{name} must be True or False, not {quote(value)}")
    return int(value == 1)
