"""State of servos, and readings of the state until servos have arrived at their targets."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import aclosing

from msgspec import Struct

from servolink.errors import NotFound, OutcomeUnknown, RequestTimeout, TargetNotReached, html_table
from servolink.motion import AngleUnit, Degrees, doubts, in_unit
from servolink.protocol import ALL_SERVOS, QueryServoRequest, ServoState

_ARRIVED = 2  # degrees (or ADC steps) from the target
_GRACE = 1.0  # seconds beyond the planned duration of a movement
_PAUSE = 0.04  # seconds between two readings of moving servos
_LOOK_EVERY = 0.1  # seconds between two looks whether a motion was ended
_MOST_NAMED = 8  # servos still away from their targets


class Servo(Struct, frozen=True):
    """State of a servo as reported by the board (3.2.2)."""

    servo_id: int
    angle: int
    """`Degrees` or `Adc`; a plain number if the unit is unknown."""
    current: int
    """Raw reading, without a unit in the document."""
    temperature: int
    """Raw reading, without a unit in the document."""
    servo_type: int
    is_start: bool
    """Whether the servo may move; a stopped servo ignores movements."""
    is_hold: bool
    """Whether the servo holds an angle; a released servo is limp."""
    doubt: str = ""
    """Why these values cannot be true, such as `not measured`; empty for a plausible state."""

    @property
    def state(self) -> str:
        """`released`, `stopped`, or `ready` to move; for values that cannot be true, the doubt."""
        return self.doubt or ("released" if not self.is_hold else "stopped" if not self.is_start else "ready")

    def _repr_html_(self) -> str:
        return Servos((self,))._repr_html_()


def servos_of_states(states: Sequence[ServoState], unit_of: Callable[[int], AngleUnit | None]) -> Servos:
    """Return servos with the states in a response, angles in the units of `unit_of`, and doubts about the values."""
    doubtful = doubts(states, unit_of)
    return Servos(_servo_of(state, unit_of(state.servo_id), doubtful.get(state.servo_id, "")) for state in states)


def _servo_of(state: ServoState, unit: AngleUnit | None, doubt: str) -> Servo:
    return Servo(
        state.servo_id,
        in_unit(state.angle, unit),
        state.current,
        state.temperature,
        state.servo_type,
        bool(state.is_start),
        bool(state.is_hold),
        doubt,
    )


class Servos(tuple[Servo, ...]):
    """Servos, shown as a table in notebooks."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        columns = ("servo", "angle", "state", "current (raw)", "temperature (raw)", "type")
        rows = [
            (one.servo_id, _angle_text(one), one.state, one.current, one.temperature, one.servo_type) for one in self
        ]
        return html_table(columns, rows)


def _angle_text(servo: Servo) -> str:
    text = f"{servo.angle}°" if isinstance(servo.angle, Degrees) else str(servo.angle)
    return f"{text} ({servo.doubt})" if servo.doubt else text


def angles_of(servo_ids: Iterable[int], servos: Iterable[Servo]) -> dict[int, int]:
    """Return the angles of the servos wanted, by id. Raise NotFound for a missing servo."""
    pose = {servo.servo_id: servo.angle for servo in servos}
    if missing := [servo_id for servo_id in servo_ids if servo_id not in pose]:
        raise NotFound(f"the board has no servo {missing[0]}", QueryServoRequest(ALL_SERVOS))
    return {servo_id: pose[servo_id] for servo_id in servo_ids}


async def until_arrived(
    read: Callable[[], Awaitable[tuple[Servo, ...]]], goals: Mapping[int, int], seconds: float, *, settle: bool = False
) -> AsyncGenerator[tuple[Servo, ...], None]:
    """Yield readings for `seconds` and until all are at `goals`; with `settle`, until two readings agree too."""
    loop = asyncio.get_running_loop()
    start = loop.time()
    before: dict[int, int] = {}
    while True:
        # By the time of the request: after a stall of the loop, the reading is from before the stall.
        too_late = loop.time() - start >= seconds + _GRACE
        try:
            servos = await read()
        except RequestTimeout as error:
            text = f"the motion was sent, and whether the servos have arrived is unknown: {error}"
            raise OutcomeUnknown(text, error.request) from error
        elapsed = loop.time() - start
        yield servos
        pose = angles_of(goals, servos)
        away = [servo_id for servo_id in goals if _distance(servo_id, pose[servo_id], goals[servo_id]) > _ARRIVED]
        if elapsed >= seconds and not away and (too_late or not settle or pose == before):
            return
        if too_late:
            raise _not_arrived({servo_id: (pose[servo_id], goals[servo_id]) for servo_id in away})
        before = pose
        await asyncio.sleep(_PAUSE)


async def until_over(
    read: Callable[[], Awaitable[tuple[Servo, ...]]],
    goals: Mapping[int, int],
    seconds: float,
    check: Callable[[], None],
    *,
    settle: bool = False,
) -> None:
    """Wait for `seconds`, and until all servos are at `goals`, as `until_arrived` does.

    `check` raises the error of a motion that a stop, a loss or another program has ended. Such an end is the better
    reason for a servo that has not arrived, or is not read.
    """
    loop = asyncio.get_running_loop()
    end = loop.time() + seconds
    # The line is left free meanwhile, so an end is looked for here.
    while (remaining := end - loop.time()) > 0:
        await asyncio.sleep(min(remaining, _LOOK_EVERY))
        check()
    try:
        async with aclosing(until_arrived(read, goals, 0.0, settle=settle)) as readings:
            async for _ in readings:
                check()
    except (TargetNotReached, OutcomeUnknown):
        check()
        raise


def _not_arrived(away: Mapping[int, tuple[int, int]]) -> TargetNotReached:
    """Return the error for servos away from their targets."""
    places = [f"servo {servo_id} is at {angle}, not at {goal}" for servo_id, (angle, goal) in away.items()]
    if len(places) > _MOST_NAMED:
        places[_MOST_NAMED:] = [f"{len(places) - _MOST_NAMED} more servos are on their way"]
    noun = "it" if len(away) == 1 else "they"
    return TargetNotReached(
        f"{'; '.join(places)}, {_GRACE:.0f} s after {noun} should have arrived: {noun} may be stopped or released "
        "(then start and hold first), blocked, overloaded or unable to turn that far; the motion was sent, so look at "
        "the robot before you repeat it",
        away,
    )


def _distance(servo_id: int, angle: int, goal: int) -> int:
    if type(angle) is not type(goal):
        raise OutcomeUnknown(
            f"servo {servo_id} was moved to {goal!r} and now reports {angle!r}: its angle unit was changed meanwhile, "
            "so whether it has arrived is unknown; read it again"
        )
    return abs(angle - goal)
