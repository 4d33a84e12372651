"""Servos (3.2): their angle units, reading, moving and stopping them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterable, Mapping

from msgspec import Struct

from servolink.client.session import Session
from servolink.connection.connection import Connection
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    EncodeError,
    NotFound,
    OutcomeUnknown,
    Rejected,
    RequestTimeout,
    TransportError,
)
from servolink.escaping import quote
from servolink.motion import (
    INTERVAL_UNIT,
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
from servolink.protocol.record_types import ACTION
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


class AngleUnits:
    """Tracks the unit of each servo, and sets the one that the program asked for.

    A board keeps its units when the program ends, and a query does not say in which unit it is answered. So the unit
    of all servos is set before the first command with an angle. An angle that was computed or read before a unit was
    sent (`Connection.units_sent`) must not be used after it.
    """

    def __init__(self, session: Session, angle_unit: AngleUnit | None) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None leaves them as they are."""
        self._session = session
        self._unit: AngleUnit | None = angle_unit
        self._units: dict[int, AngleUnit] = {}  # of servos that were set to one of their own
        self._is_set = angle_unit is None
        self._setting = asyncio.Lock()
        session.restore_with(self._restore)

    @property
    def is_changing(self) -> bool:
        """Whether a unit is being set, so that `of` may be outdated in a moment."""
        return self._setting.locked()

    def of(self, servo_id: int) -> AngleUnit | None:
        """Return the unit of a servo, None if it is unknown."""
        return self._units.get(servo_id) or self._unit

    async def set(self, unit: AngleUnit, servo_id: int = ALL_SERVOS) -> None:
        """Set the unit of a servo (255: all). Raise Rejected if the board refuses."""
        if unit not in ("degree", "adc"):
            raise EncodeError(f"unit must be 'degree' or 'adc', not {quote(unit)}")
        async with self._setting:
            if servo_id != ALL_SERVOS:
                await self._set_first()  # or a later command would set all servos over this one
            await self._set(unit, servo_id)

    async def ensure(self) -> None:
        """Wait until units are known: for a change under way, and for the first one of this session."""
        if self._is_set and not self._setting.locked():
            return
        async with self._setting:
            await self._set_first()

    async def _set_first(self) -> None:
        """Set the unit of all servos unless it is known to be set. The caller holds the lock."""
        if not self._is_set and self._unit is not None:
            await self._set(self._unit, ALL_SERVOS)

    async def _set(self, unit: AngleUnit, servo_id: int) -> None:
        """Set a unit. The caller holds the lock."""
        connection = self._session.connection
        sent = connection.units_sent
        try:
            await _set_unit(connection, unit, servo_id)
        except Rejected:
            raise
        except BaseException:
            # Sent, and the response is missing: the board may be in either unit. Forget what is known, so that all
            # servos are set again before the next angle.
            if connection.units_sent != sent:
                self._units.clear()
                self._is_set = self._unit is None
            raise
        if servo_id == ALL_SERVOS:
            self._units.clear()
            self._unit, self._is_set = unit, True
        else:
            self._units[servo_id] = unit

    async def _restore(self, connection: Connection) -> None:
        """Set the same units on a new connection: the board may have been switched off and on."""
        if not self._is_set:
            return
        units: dict[int, AngleUnit] = {} if self._unit is None else {ALL_SERVOS: self._unit}
        units |= self._units
        for servo_id, unit in units.items():
            await _set_unit(connection, unit, servo_id)


async def _set_unit(connection: Connection, unit: AngleUnit, servo_id: int) -> None:
    """Set the unit of a servo. Raise Rejected if the board reports another servo or unit."""
    request = SetAngleUnitRequest(servo_id, int(unit == "adc"))
    response = await connection.request(request)
    if (response.servo_id, response.unit_type) != (servo_id, request.unit_type):
        raise Rejected(
            f"servo {servo_id} was asked for angle unit {request.unit_type}; the board answered "
            f"servo {response.servo_id}, unit {response.unit_type}",
            request,
        )


_ARRIVED = 2  # within this many degrees (or ADC steps) of the target
_GRACE = 1.0  # seconds that a movement may take longer than planned
_PAUSE = 0.04  # seconds between two readings of moving servos
_STOP_TRIES = 3


class Servo(Struct, frozen=True):
    """One servo as the board reports it (3.2.2)."""

    servo_id: int
    angle: int
    """`Degrees` or `Adc`; a plain number if the unit is unknown."""
    current: int
    """Raw reading."""
    temperature: int
    """Raw reading."""
    servo_type: int
    is_start: bool
    """Whether it may move; a stopped servo ignores movements."""
    is_hold: bool
    """Whether it holds its angle; a released servo is limp."""


class ServoController:
    """Reads, moves, stops and releases the servos of a board."""

    def __init__(
        self,
        session: Session,
        angle_unit: AngleUnit | None,
        limits: MotionLimits,
        interval_unit: float = INTERVAL_UNIT,
    ) -> None:
        """Set all servos to `angle_unit` before the first command with an angle; None leaves them as they are.

        An interval of 1 (3.2.5) stands for `interval_unit` seconds.
        """
        self.units = AngleUnits(session, angle_unit)
        self._session = session
        self._limits = limits
        self._interval_unit = interval_unit

    async def servo_ids(self) -> tuple[int, ...]:
        """Return the ids of all servos (3.2.1)."""
        return (await self._session.request(QueryServoListRequest())).servo_id_list

    async def servos(self) -> tuple[Servo, ...]:
        """Return the state of all servos (3.2.2)."""
        return await self._read(QueryServoRequest(ALL_SERVOS))

    async def servo(self, servo_id: int) -> Servo:
        """Return the state of one servo (3.2.2). Raise NotFound if the board has no such servo."""
        request = QueryServoRequest(servo_id)
        for servo in await self._read(request):
            if servo.servo_id == servo_id:
                return servo
        raise NotFound(f"the board has no servo {servo_id}", request)

    async def set_servo(self, servo_id: int, *, start: bool, hold: bool) -> None:
        """Start or stop, hold or release a servo (3.2.3). Raise Rejected if the board reports another state."""
        request = SetServoParameterRequest(servo_id, flag("start", start), flag("hold", hold))
        response = await self._session.request(request)
        if (response.servo_id, response.is_start, response.is_hold) != (servo_id, request.is_start, request.is_hold):
            raise Rejected(
                f"servo {servo_id} was asked for start {request.is_start}, hold {request.is_hold}; the board answered "
                f"servo {response.servo_id}, start {response.is_start}, hold {response.is_hold}",
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
        """Move servos together (see `Board.move`)."""
        stops = self._session.connection.stops
        seconds_for(0, duration, speed, self._interval_unit)  # refuse an impossible pace before anything is sent
        targets = checked_targets(targets)  # a copy, because the caller may change the original meanwhile
        if not self.units.is_changing:  # while they change, only `_planned` can say what is possible
            self._goals(targets, speed)
        while True:
            goals, intervals = await self._planned(targets, duration, speed)
            connection = self._session.connection
            steps = tuple(Step(servo_id, int(goal), intervals[servo_id]) for servo_id, goal in goals.items())
            request = ExecuteActionRequest(steps)
            # The movement may wait for its turn. If a unit is sent meanwhile, its numbers mean other angles.
            units_sent = connection.units_sent
            if await connection.send(request, unless_stopped_since=stops, unless_units_since=units_sent):
                break
        longest = round(max(intervals.values()) * self._interval_unit, 9)  # 0.07 s, not 0.07000000000000001
        if wait:
            await asyncio.sleep(longest)
            async for _ in self._until_arrived(goals, 0.0, settle=False):
                pass
        return longest

    async def follow(
        self, targets: Mapping[int, float], seconds: float, *, settle: bool = False
    ) -> AsyncIterator[tuple[Servo, ...]]:
        """Yield what the servos report until they have arrived (see `Board.follow`)."""
        await self.units.ensure()
        goals = self._in_units(wire_angles(checked_targets(targets), self.units.of))
        async for servos in self._until_arrived(goals, seconds, settle=settle):
            yield servos

    async def run_action(self, action_id: int) -> None:
        """Run a stored action. Raise NotFound, with nothing moved, if the board has none with this id."""
        connection = self._session.connection
        stops = connection.stops
        request = ACTION.query(action_id)  # the board does not answer the command itself, and ignores unknown ids
        if ACTION.record_in(await self._session.request(request)) is None:
            raise NotFound(f"the board has no action {action_id}", request)
        await connection.send(ExecuteActionExRequest(action_id), unless_stopped_since=stops)

    async def stop(self) -> None:
        """Stop and hold all servos, ahead of everything that waits to be sent (see `Board.stop`)."""
        request = SetServoParameterRequest(ALL_SERVOS, 0, 1)
        doubt = ""
        for _ in range(_STOP_TRIES):
            connection = self._session.connection
            # Not a normal request: it waits for nothing, and its response cannot be told from that of an earlier
            # `set_servo`. So the state of the servos is what counts.
            await connection.send_stop(request)
            try:
                await connection.shake_hands()  # if that was put off, so that the stop goes first
                states = await connection.request(
                    QueryServoRequest(ALL_SERVOS), timeout=connection.patience / _STOP_TRIES, first=True
                )
            except (RequestTimeout, DecodeError) as error:
                doubt = str(error)
                continue
            except TransportError as error:
                raise ConnectionLost(f"a stop was sent and could not be confirmed: {error}") from error
            moving = [state.servo_id for state in states.servos if state.is_start or not state.is_hold]
            if states.servos and not moving:
                return
            doubt = f"servos {moving} report that they may still move or are not held" if moving else "no servo reports"
        raise OutcomeUnknown(f"a stop was sent {_STOP_TRIES} times and could not be confirmed: {doubt}", request)

    async def _read(self, request: QueryServoRequest) -> tuple[Servo, ...]:
        """Return the servos, with angles in the unit in which the board reported them."""
        while True:
            await self.units.ensure()
            connection = self._session.connection
            units_sent = connection.units_sent
            states = (await connection.request(request)).servos
            # A unit sent while the query was under way leaves open in which one it was answered: read again.
            if units_sent == connection.units_sent:
                return tuple(map(self._servo, states))

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

    def _goals(self, targets: Mapping[int, float], speed: float | None) -> dict[int, int]:
        """Return `targets` in the units that are set. Raise EncodeError for those that are not possible."""
        angles = wire_angles(targets, self.units.of)
        check_limits(angles, self.units.of, self._limits, speed)
        return self._in_units(angles)

    def _in_units(self, angles: Mapping[int, int]) -> dict[int, int]:
        return {servo_id: in_unit(angle, self.units.of(servo_id)) for servo_id, angle in angles.items()}

    async def _planned(
        self, targets: Mapping[int, float], duration: float | None, speed: float | None
    ) -> tuple[dict[int, int], dict[int, int]]:
        """Return the goals and each servo's time in units of 10 ms, for the units set when this returns."""
        await self.units.ensure()
        here: dict[int, int] = {}
        if speed is not None or any(self._limits.cap_of(servo_id) is not None for servo_id in targets):
            here = _angles(targets, await self.servos())
        goals = self._goals(targets, speed)
        unit = self._interval_unit
        return goals, intervals_for(goals, here, self._limits, duration=duration, speed=speed, unit=unit)

    async def _until_arrived(
        self, goals: Mapping[int, int], seconds: float, *, settle: bool
    ) -> AsyncIterator[tuple[Servo, ...]]:
        """Yield readings for `seconds` and until all are at `goals`; with `settle`, until two readings agree too."""
        loop = asyncio.get_running_loop()
        start = loop.time()
        before: dict[int, int] = {}
        while True:
            servos = await self.servos()
            elapsed = loop.time() - start
            yield servos
            here = _angles(goals, servos)
            away = [servo_id for servo_id in goals if _distance(servo_id, here[servo_id], goals[servo_id]) > _ARRIVED]
            too_late = elapsed >= seconds + _GRACE
            if elapsed >= seconds and not away and (too_late or not settle or here == before):
                return
            if too_late:
                where, goal = here[away[0]], goals[away[0]]
                raise RequestTimeout(
                    f"servo {away[0]} is at {where}, not at {goal}, {_GRACE:.0f} s after it should have arrived: "
                    "it may be stopped or released (then start and hold it first), blocked, overloaded or unable to "
                    "turn that far"
                )
            before = here
            await asyncio.sleep(_PAUSE)


def _angles(wanted: Iterable[int], servos: Iterable[Servo]) -> dict[int, int]:
    """Return the angles of the servos wanted, by id. Raise NotFound if one is missing."""
    here = {servo.servo_id: servo.angle for servo in servos}
    if missing := [servo_id for servo_id in wanted if servo_id not in here]:
        raise NotFound(f"the board has no servo {missing[0]}", QueryServoRequest(ALL_SERVOS))
    return {servo_id: here[servo_id] for servo_id in wanted}


def _distance(servo_id: int, here: int, goal: int) -> int:
    if type(here) is not type(goal):
        raise OutcomeUnknown(
            f"servo {servo_id} was moved to {goal!r} and now reports {here!r}: its angle unit was changed meanwhile, "
            "so whether it has arrived is unknown; read it again"
        )
    return abs(here - goal)
