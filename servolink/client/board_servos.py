"""Servos (3.2): reading, moving, stopping and releasing them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Iterable, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING

from msgspec.structs import replace

from servolink.client.all_servos import AllServos
from servolink.client.angle_units import AngleUnits
from servolink.client.servo_state import Servo, Servos, angles_of, until_arrived
from servolink.client.session import Session
from servolink.client.soft_start import SoftStart
from servolink.connection.gates import UnitsChanged
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    MotionRefused,
    NotFound,
    OutcomeUnknown,
    Reason,
    Rejected,
    RequestTimeout,
    TransportError,
)
from servolink.motion.angles import AngleUnit, in_unit, wire_angles
from servolink.motion.limits import MotionLimits, degrees_per_second
from servolink.motion.movement import INTERVAL_UNIT, Speed, check_limits, check_pace, checked_targets, intervals_for
from servolink.motion.ticket import Ticket
from servolink.numeric import checked_flag, is_number
from servolink.platforms.time_asleep import time_with_sleep
from servolink.protocol.records import Step
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    ServoState,
    SetServoParameterRequest,
    SetServoParameterResponse,
)

if TYPE_CHECKING:
    from servolink.client.captions import Targets
    from servolink.motion.set_points import SetPoints

_STOP_TRIES = 3
_ALL = "all"  # as in `captions`, which is loaded for captions only


class ServoController:
    """Reads, moves, stops and releases the servos of a board."""

    def __init__(
        self,
        session: Session,
        angle_unit: AngleUnit | None,
        limits: MotionLimits,
        interval_unit: float = INTERVAL_UNIT,
    ) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None changes no unit.

        An interval of 1 (3.2.5) stands for `interval_unit` seconds.
        """
        self.all = AllServos(session)
        self.units = AngleUnits(session, self.all, angle_unit)
        self.soft_start = SoftStart(session, limits)
        self._session = session
        self._limits = limits
        self._interval_unit = interval_unit

    async def servo_ids(self) -> tuple[int, ...]:
        """Return the ids of all servos (3.2.1)."""
        return (await self._session.request(QueryServoListRequest())).servo_id_list

    async def servos(self) -> tuple[Servo, ...]:
        """Return the state of all servos (3.2.2)."""
        return await self._read(ALL_SERVOS)

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
        is_start, is_hold = checked_flag("start", start), checked_flag("hold", hold)
        ticket = ticket or self._session.ticket()
        servo_id = await self.all.id_of(which)
        request = SetServoParameterRequest(servo_id, is_start, is_hold)
        response = await self.answer_to(request, ticket=ticket)
        if response != SetServoParameterResponse(servo_id, is_start, is_hold):
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
        try:
            return await self._session.request(packet, timeout=timeout, unchecked=unchecked, ticket=ticket)
        finally:
            self.soft_start.forget(packet)  # answered or not: the request may have been executed

    async def move(
        self,
        targets: Targets,
        *,
        duration: float | None = None,
        speed: Speed | None = None,
        wait: bool = False,
        dry_run: bool = False,
        ticket: Ticket | None = None,
    ) -> float:
        """Move servos together (see `Board.move`)."""
        connection = self._session.connection
        ticket = ticket or connection.stops.ticket()
        check_pace(duration, speed, self._interval_unit)  # refuse an impossible pace before anything is sent
        angles = checked_targets(await self.all.targets_by_id(targets))  # a copy: callers change theirs
        # During a change, only `_planned` knows the units, and only a reading whether a servo is outside its limits.
        if not self.units.is_changing and not self._are_outside(angles):
            self._goals(angles, speed, {})
        while True:
            goals, intervals, moving = await self._planned(angles, duration, speed)
            steps = tuple(Step(servo_id, int(goal), intervals[servo_id]) for servo_id, goal in goals.items())
            request = ExecuteActionRequest(steps)
            longest = round(
                max(intervals.values()) * self._interval_unit, 9
            )  # 0.07 s rather than 0.07000000000000001 s
            if dry_run:
                return longest
            # The movement may wait for its turn. If a unit is sent meanwhile, its numbers mean other angles.
            with suppress(UnitsChanged):
                fresh = self._while_fresh(ticket, goals)
                await connection.send(request, ticket=fresh.checked(connection.units_sent))
                break
        self.soft_start.moved(moving, longest, ticket)
        if wait:
            await asyncio.sleep(longest)
            async for _ in self.until_arrived(goals, 0.0):
                if refusal := connection.gates.lease(request, ticket):
                    raise MotionRefused(f"the motion was sent, and then interrupted: {refusal}") from refusal
        return longest

    async def follow(
        self, targets: Targets, seconds: float, *, settle: bool = False
    ) -> AsyncGenerator[tuple[Servo, ...], None]:
        """Yield readings until the servos have arrived (see `Board.follow`)."""
        angles = checked_targets(await self.all.targets_by_id(targets))
        await self.units.ensure()
        goals = self._in_units(wire_angles(angles, self.units.of))
        async for servos in self.until_arrived(goals, seconds, settle=settle):
            yield servos

    def until_at_rest(self, angles: Mapping[int, int]) -> AsyncGenerator[tuple[Servo, ...], None]:
        """Yield readings until servos rest at `angles`, in the unit of each servo."""
        return self.until_arrived(self._in_units(angles), 0.0, settle=True)

    def until_arrived(
        self, goals: Mapping[int, int], seconds: float, *, settle: bool = False
    ) -> AsyncGenerator[tuple[Servo, ...], None]:
        """Yield readings for `seconds` and until all are at `goals`, in the unit of each servo."""
        return until_arrived(self.servos, goals, seconds, settle=settle)

    async def send(self, packet: ExecuteActionRequest, *, ticket: Ticket | None = None) -> None:
        """Send a movement unchanged. Raise MotionRefused beyond the limits (see `Board.send`)."""
        connection = self._session.connection
        ticket = ticket or connection.stops.ticket()
        angles = {step.servo_id: step.degree for step in packet.steps}
        while True:
            await self.units.ensure()
            pose, moving = await self._start(angles, needed=self._needs_pose(angles))
            units_sent = connection.units_sent
            check_limits(angles, self.units.of, self._limits, pose=pose)
            first = self.soft_start.first_moves(moving)
            for step in packet.steps if pose else ():
                self._check_speed(step, abs(step.degree - pose[step.servo_id]), is_first=step.servo_id in first)
            with suppress(UnitsChanged):
                await connection.send(packet, ticket=self._while_fresh(ticket, angles).checked(units_sent))
                break
        longest = max((step.interval for step in packet.steps), default=0) * self._interval_unit
        self.soft_start.moved(moving, longest, ticket)

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
            if connection.hub is not None and connection.is_suspended:
                await connection.hub.stop()  # the hub reads the servos: no other program may now
                return
            try:
                await connection.shake_hands()  # if put off, so that the stop goes first
                states = await self.all.states(timeout=connection.patience / _STOP_TRIES, first=True)
            except (RequestTimeout, DecodeError) as error:
                doubt = str(error)
                continue
            except TransportError as error:
                raise ConnectionLost(f"a stop was sent and could not be confirmed; stop again: {error}") from error
            moving = [state.servo_id for state in states if state.is_start or not state.is_hold]
            silent = sorted({*self.all.separate_ids} - {state.servo_id for state in states})
            if states and not moving and not silent:
                return
            doubt = f"servos {silent} do not report" if silent and states else "no servo reports"
            if moving:
                doubt = f"servos {moving} report that they may still move or are not held"
        raise OutcomeUnknown(f"a stop was sent {_STOP_TRIES} times and could not be confirmed: {doubt}", request)

    async def _read(self, servo_id: int) -> tuple[Servo, ...]:
        """Return a servo or all servos (255), with angles in the reported unit."""
        while True:
            await self.units.ensure()
            connection = self._session.connection
            units_sent = connection.units_sent
            if servo_id == ALL_SERVOS:
                states = await self.all.states()
            else:
                states = (await connection.request(QueryServoRequest(servo_id))).servos
            # After a unit sent during the query, the unit of the response is unknown: read again.
            if units_sent == connection.units_sent:
                return Servos(map(self._servo, states))

    def _servo(self, state: ServoState) -> Servo:
        return Servo(
            state.servo_id,
            in_unit(state.angle, self.units.of(state.servo_id)),
            state.current,
            state.temperature,
            state.servo_type,
            bool(state.is_start),
            bool(state.is_hold),
        )

    def _goals(self, targets: Mapping[int, float], speed: Speed | None, pose: Mapping[int, int]) -> dict[int, int]:
        """Return `targets` in the units set now. Raise EncodeError for impossible targets."""
        angles = wire_angles(targets, self.units.of)
        check_limits(angles, self.units.of, self._limits, speed, pose=pose)
        return self._in_units(angles)

    def _in_units(self, angles: Mapping[int, int]) -> dict[int, int]:
        return {servo_id: in_unit(angle, self.units.of(servo_id)) for servo_id, angle in angles.items()}

    async def _planned(
        self, targets: Mapping[int, float], duration: float | None, speed: Speed | None
    ) -> tuple[dict[int, int], dict[int, int], set[int]]:
        """Return the goals, the time of each servo in intervals and the moving servos, for the units set now."""
        await self.units.ensure()
        pose, moving = await self._start(targets, needed=speed is not None or self._needs_pose(targets))
        goals = self._goals(targets, speed, pose)
        first = self.soft_start.first_moves(moving)
        intervals = intervals_for(
            goals, pose, self._limits, duration=duration, speed=speed, unit=self._interval_unit, soft=first
        )
        return goals, intervals, moving

    def _needs_pose(self, targets: Mapping[int, float]) -> bool:
        """Return whether the check of a movement needs the present angles."""
        if not self._limits:
            return False
        has_cap = any(self._limits.cap_of(servo_id) is not None for servo_id in targets)
        return has_cap or bool(self.soft_start.first_moves(targets)) or self._are_outside(targets)

    def _are_outside(self, targets: Mapping[int, float]) -> bool:
        """Return whether a target is outside the angle limits of its servo."""
        return bool(self._limits) and any(
            is_number(angle) and angle == angle // 1 and self._limits.exceeded_angles(servo_id, angle)
            for servo_id, angle in targets.items()
        )

    def _while_fresh(self, ticket: Ticket, targets: Mapping[int, int]) -> Ticket:
        """Return `ticket`; for targets outside the limits it ends with the reading that allows them, just made."""
        if not self._are_outside(targets):
            return ticket
        from servolink.motion.set_points import FRESH  # late: most boards have no limits beyond the document's

        return replace(ticket, until=min(ticket.until, time_with_sleep() + FRESH))

    async def _start(self, servo_ids: Iterable[int], *, needed: bool) -> tuple[dict[int, int], set[int]]:
        """Return the present angles of servos, if needed, and the servos to move.

        Stopped and released servos do not move.
        """
        if not needed:
            return {}, set(servo_ids)
        servos = await self.servos()
        pose = angles_of(servo_ids, servos)
        return pose, {servo.servo_id for servo in servos if servo.servo_id in pose and servo.is_start and servo.is_hold}

    def _check_speed(self, step: Step, degrees: int, *, is_first: bool) -> None:
        """Raise MotionRefused for too fast a step of `degrees`."""
        seconds = step.interval * self._interval_unit
        exceeded = self._limits.exceeded_cap(step.servo_id, degrees, seconds)
        why = f"its cap is {exceeded}"
        if not exceeded and is_first:
            exceeded = self._limits.exceeded_soft_start(degrees, seconds)
            why = f"from an unknown pose its soft start allows {exceeded}, to which `move` keeps by itself"
        if exceeded:
            speed = degrees_per_second(degrees, seconds)
            raise MotionRefused(
                f"servo {step.servo_id}: {degrees} degrees in {seconds:g} s is {speed:.0f} degrees/s; {why}",
                reason=Reason.LIMIT,
            )
