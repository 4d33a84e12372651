"""Commands of chapter 3.2: reading and moving servos, stop and release."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from msgspec import Struct

from servolink.client.session import Chapter
from servolink.connection.connection import Connection
from servolink.errors import DecodeError, EncodeError, NotFound, OutcomeUnknown, Rejected, RequestTimeout
from servolink.escaping import quote
from servolink.motion import (
    AngleUnit,
    MotionLimits,
    check_limits,
    checked_targets,
    flag,
    in_unit,
    intervals_for,
    seconds_for,
    wire_angles,
)
from servolink.protocol.records import Step
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    ServoState,
    SetAngleUnitRequest,
    SetServoParameterRequest,
)


class Units(Chapter):
    """The angle units of a board's servos.

    An angle that was worked out or asked for before a unit was sent (`Link.units_sent`) must not be used after it.
    """

    def __init__(self, link: Connection, angle_unit: AngleUnit | None) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None leaves them as they are."""
        super().__init__(link)
        self._unit: AngleUnit | None = angle_unit
        self._units: dict[int, AngleUnit] = {}
        self._unit_is_set = angle_unit is None
        self._setting_unit = asyncio.Lock()

    async def set_angle_unit(self, unit: AngleUnit, servo_id: int = ALL_SERVOS) -> None:
        """Give and report angles of a servo (255: all) in degrees or raw ADC (3.2.4); Rejected if it is refused."""
        if unit not in ("degree", "adc"):
            raise EncodeError(f"unit: {quote(unit)} is neither 'degree' nor 'adc'")
        async with self._setting_unit:
            if servo_id != ALL_SERVOS:
                await self._set_first_unit()
            await self._set_unit(unit, servo_id)

    def unit_of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit in which a servo's angle is given and reported; None if it is not known."""
        return self._units.get(servo_id) or self._unit

    async def _ensure_unit(self) -> None:
        """Wait until units are known: for a change that is under way, and for the first one."""
        if self._unit_is_set and not self._setting_unit.locked():
            return
        async with self._setting_unit:
            await self._set_first_unit()

    async def _set_first_unit(self) -> None:
        """Set the unit of all servos, while nobody else does, unless it is known to be set."""
        if not self._unit_is_set and self._unit is not None:
            await self._set_unit(self._unit, ALL_SERVOS)

    async def _set_unit(self, unit: AngleUnit, servo_id: int) -> None:
        """Set a unit, while nobody else does."""
        link, sent = self._link, self._link.units_sent
        try:
            await _ask(link, unit, servo_id)
        except Rejected:
            raise
        except BaseException:
            if link.units_sent != sent:  # it may have been done: all are set again before the next angle
                self._units.clear()
                self._unit_is_set = self._unit is None
            raise
        if servo_id == ALL_SERVOS:
            self._units.clear()
            self._unit, self._unit_is_set = unit, True
        else:
            self._units[servo_id] = unit

    async def _restore_units(self, link: Connection) -> None:
        """Set on a new link the units that were set on the one before it; Rejected if the board does not take them."""
        if not self._unit_is_set:
            return
        units: dict[int, AngleUnit] = {} if self._unit is None else {ALL_SERVOS: self._unit}
        units |= self._units
        for servo_id, unit in units.items():
            await _ask(link, unit, servo_id)


async def _ask(link: Connection, unit: AngleUnit, servo_id: int) -> None:
    """Set the unit of a servo; Rejected if the board answers that it is in another."""
    request = SetAngleUnitRequest(servo_id, int(unit == "adc"))
    answer = await link.request(request)
    if (answer.servo_id, answer.unit_type) != (servo_id, request.unit_type):
        raise Rejected(
            f"servo {servo_id} was asked for angle unit {request.unit_type}; the board answered "
            f"servo {answer.servo_id}, unit {answer.unit_type}",
            request,
        )


_ARRIVED = 2  # within so many degrees (or ADC steps) of the target
_GRACE = 1.0  # seconds that a movement may take longer than asked
_STOP_TRIES = 3


class Servo(Struct, frozen=True):
    """One servo as the board reports it."""

    servo_id: int
    angle: int
    """`Degrees` or `Adc`; a plain number where the unit was left alone."""
    current: int
    """Raw ADC."""
    temperature: int
    """Raw ADC."""
    servo_type: int
    is_start: bool
    """May move; a stopped servo ignores movements."""
    is_hold: bool
    """Holds its angle; a released servo is limp."""


class Servos(Units):
    """The servos of a board."""

    def __init__(self, link: Connection, angle_unit: AngleUnit | None, limits: MotionLimits) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None leaves them as they are."""
        super().__init__(link, angle_unit)
        self._limits = limits

    async def servo_ids(self) -> tuple[int, ...]:
        """Return the ids of all servos (3.2.1)."""
        return (await self.request(QueryServoListRequest())).servo_id_list

    async def servos(self) -> tuple[Servo, ...]:
        """Return the state of all servos (3.2.2)."""
        return await self._read(QueryServoRequest(ALL_SERVOS))

    async def servo(self, servo_id: int) -> Servo:
        """Return the state of one servo (3.2.2); NotFound if there is none."""
        request = QueryServoRequest(servo_id)
        for servo in await self._read(request):
            if servo.servo_id == servo_id:
                return servo
        raise NotFound(f"the board has no servo {servo_id}", request)

    async def set_servo(self, servo_id: int, *, start: bool, hold: bool) -> None:
        """Let a servo (255: all) move or stop it, hold or release it (3.2.3); Rejected if the board does not."""
        request = SetServoParameterRequest(servo_id, flag("start", start), flag("hold", hold))
        answer = await self.request(request)
        if (answer.servo_id, answer.is_start, answer.is_hold) != (servo_id, request.is_start, request.is_hold):
            raise Rejected(
                f"servo {servo_id} was asked for start {request.is_start}, hold {request.is_hold}; the board answered "
                f"servo {answer.servo_id}, start {answer.is_start}, hold {answer.is_hold}",
                request,
            )

    async def move(
        self,
        targets: Mapping[int, float],
        *,
        duration: float | None = None,
        speed: float | None = None,
        wait: bool = False,
    ) -> float:
        """Move servos, all at once, to angles in degrees (or `Adc`) and return how long it takes, in seconds (3.2.5).

        Give either `duration`, 0.01..327.67 s, or `speed` in degrees per second; the angles are then read first,
        and each servo turns at that speed. EncodeError, before anything moves, for a target outside the limits
        or a speed above the cap. Returns when it is sent, or with `wait` when all have arrived; RequestTimeout
        names a servo that has not arrived a second after it should have.
        """
        stops = self._link.stops
        seconds_for(0, duration, speed)  # refuses what is not possible before anything is sent
        targets = checked_targets(targets)  # a copy, which nobody changes while we wait
        if not self._setting_unit.locked():  # or it is not known yet
            self._goals(targets, speed)
        while True:
            goals, intervals = await self._planned(targets, duration, speed)
            units = self._link.units_sent
            steps = tuple(Step(servo_id, int(goal), intervals[servo_id]) for servo_id, goal in goals.items())
            request = ExecuteActionRequest(steps)
            if await self._link.send(request, unless_stopped_since=stops, unless_units_since=units):
                break  # or an angle unit was sent before its turn came
        longest = max(intervals.values(), default=0) / 100
        if wait:
            await self._arrival(goals, longest)
        return longest

    async def run_action(self, action_id: int) -> None:
        """Run a stored action (3.2.6); returns when it is sent, the board does not answer."""
        await self.send(ExecuteActionExRequest(action_id))

    async def stop(self) -> None:
        """Stop all servos where they are and keep them held, before everything else that waits to be sent.

        Confirmed by reading the servos back; OutcomeUnknown if that does not show all of them stopped and held.
        A stopped servo ignores movements until `set_servo(..., start=True, hold=True)`.
        """
        request = SetServoParameterRequest(ALL_SERVOS, 0, 1)
        doubt = ""
        for _ in range(_STOP_TRIES):
            await self._link.send_stop(request)
            try:
                states = await self._link.request(QueryServoRequest(ALL_SERVOS), first=True, retries=0)
            except (RequestTimeout, DecodeError) as error:
                doubt = str(error)
                continue
            going = [state.servo_id for state in states.servos if state.is_start or not state.is_hold]
            if states.servos and not going:
                return
            doubt = f"servos {going} report that they may still move or are not held" if going else "none is reported"
        raise OutcomeUnknown(f"a stop was sent {_STOP_TRIES} times and could not be confirmed: {doubt}", request)

    async def release(self, servo_id: int = ALL_SERVOS) -> None:
        """Let a servo (255: all) go limp; a raised limb falls."""
        await self.set_servo(servo_id, start=False, hold=False)

    async def _read(self, request: QueryServoRequest) -> tuple[Servo, ...]:
        """Return what the board reports, with angles in the unit in which it did: the one that is set now."""
        while True:
            await self._ensure_unit()
            link = self._link
            units = link.units_sent
            states = (await link.request(request)).servos
            if units == link.units_sent:
                return tuple(map(self._servo, states))

    def _servo(self, state: ServoState) -> Servo:
        return Servo(
            state.servo_id,
            in_unit(state.angle, self.unit_of(state.servo_id)),
            state.current,
            state.temperature,
            state.servo_type,
            bool(state.is_start),
            bool(state.is_hold),
        )

    def _goals(self, targets: Mapping[int, float], speed: float | None) -> dict[int, int]:
        """Return `targets` in the units that are set; EncodeError for what is not possible."""
        angles = wire_angles(targets, self.unit_of)
        check_limits(angles, self.unit_of, self._limits, speed)
        return {servo_id: in_unit(angle, self.unit_of(servo_id)) for servo_id, angle in angles.items()}

    async def _planned(
        self, targets: Mapping[int, float], duration: float | None, speed: float | None
    ) -> tuple[dict[int, int], dict[int, int]]:
        """Return the goals and each servo's time, right for the units that are set when it returns."""
        await self._ensure_unit()
        here: dict[int, int] = {}
        if speed is not None or self._limits.speed_cap is not None:
            here = await self._angles_now(targets)
        goals = self._goals(targets, speed)
        return goals, intervals_for(goals, here, self._limits, duration=duration, speed=speed)

    async def _angles_now(self, targets: Mapping[int, float]) -> dict[int, int]:
        request = QueryServoRequest(ALL_SERVOS)
        here = {servo.servo_id: servo.angle for servo in await self._read(request)}
        if missing := [servo_id for servo_id in targets if servo_id not in here]:
            raise NotFound(f"the board has no servo {missing[0]}", request)
        return here

    async def _arrival(self, goals: Mapping[int, int], seconds: float) -> None:
        await asyncio.sleep(seconds)
        loop = asyncio.get_running_loop()
        late = loop.time() + _GRACE
        while True:
            here = await self._angles_now(goals)
            away = [servo_id for servo_id in goals if _distance(servo_id, here[servo_id], goals[servo_id]) > _ARRIVED]
            if not away:
                return
            if loop.time() >= late:
                where, goal = int(here[away[0]]), int(goals[away[0]])
                raise RequestTimeout(
                    f"servo {away[0]} is at {where}, not at {goal}, {_GRACE:.0f} s after it should have arrived: "
                    "it may be stopped or released (then start it with set_servo), blocked or overloaded"
                )
            await asyncio.sleep(0.05)


def _distance(servo_id: int, here: int, goal: int) -> int:
    if type(here) is not type(goal):
        raise OutcomeUnknown(
            f"servo {servo_id} was moved to {goal!r} and now reports {here!r}: its angle unit was changed meanwhile, "
            "so it cannot be told whether it has arrived; read it again"
        )
    return abs(here - goal)
