"""Unit of the time of a movement, measured with a servo named by the user."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from typing import NamedTuple

from servolink.boards import Measured, SafetyLimits
from servolink.client import Board
from servolink.errors import RequestTimeout, ServolinkError
from servolink.motion import Degrees
from servolink.protocol import ExecuteActionRequest, Step

DEGREES = 10
"""Angle of the movement in degrees, by default."""

_UNITS = (0.001, 0.01, 0.1)
"""Possible units in seconds; the document says 0.01."""
_INTERVAL = 100  # units: 0.1 s, 1 s or 10 s
_LONGEST_INTERVAL = 1000
_NEAR = 1.1  # factor within which a time matches a unit, or another time
_PATIENCE = 15.0  # seconds to wait for a single movement
_BEGUN = 1  # degrees of a turn counted as a movement
_PAUSE = 0.005
_PASSING = 0.1  # seconds in which a servo that only passes an angle leaves it
_LONGER = 4  # times as long, where several units fit
_AMBIGUOUS = "read too seldom to tell units"
_STOPPING = 0.2  # seconds to wait for the confirmation of a stop


@dataclass(frozen=True, slots=True)
class PlannedMovement:
    """Planned movement of a servo there and back."""

    servo_id: int
    start: int
    """Start of the movement in degrees."""
    goal: int
    interval: int
    """Duration of the movement, in units of unknown length: 1, 10 or 100 ms each."""

    def __str__(self) -> str:
        """Return a description of the movement, for the user."""
        return (
            f"servo {self.servo_id} will turn from {self.start}° to {self.goal}° and back, in 0.1 to 10 s each way: "
            "the duration is measured"
        )


async def plan_movement(board: Board, servo_id: int, limits: SafetyLimits, degrees: int = DEGREES) -> PlannedMovement:
    """Return a movement towards the middle, within `limits` for every possible time unit of the board.

    Raise ServolinkError if the servo cannot move or the limits leave no room.
    """
    servo = await board.servo(servo_id)
    if not (servo.is_start and servo.is_hold):
        raise ServolinkError(
            f"servo {servo_id} is stopped or released and would not move: "
            f"`servolink move {servo_id}={servo.angle} --start` starts and holds the servo at the present angle"
        )
    start, allowed = int(servo.angle), limits.for_motions()
    low, high = allowed.of(servo_id) or (-180.0, 180.0)
    away = degrees if start <= 0 else -degrees
    goals = [goal for goal in (start + away, start - away) if low <= goal <= high]
    if not goals or not low <= start <= high:
        raise ServolinkError(
            f"servo {servo_id} is at {start}° and may only be moved within {low:g}..{high:g}°, without room "
            f"for {degrees}°: move the servo first"
        )
    slowest = allowed.soft_speed_of(servo_id) or allowed.cap_of(servo_id) or degrees / (_INTERVAL * _UNITS[0])
    interval = max(_INTERVAL, round(degrees / slowest / _UNITS[0]))
    if interval > _LONGEST_INTERVAL:
        raise ServolinkError(
            f"servo {servo_id} may not turn faster than {slowest:g}°/s, too slow to be timed while the unit is unknown"
        )
    return PlannedMovement(servo_id, start, goals[0], interval)


async def interval_finding(board: Board, planned: PlannedMovement) -> Measured:
    """Move there and back, and measure both times. After an error or a cancellation the servo is stopped."""
    try:
        measured = await _measured(board, planned)
        # Longer, for a board that is read too seldom to tell the units apart.
        longer = replace(planned, interval=_LONGER * planned.interval)
        if measured.value is None and longer.interval <= _LONGEST_INTERVAL and _is_ambiguous(measured):
            measured = await _measured(board, longer)
    except BaseException:
        # No longer wait: after Ctrl-C the program ends, and the stop itself is sent at once.
        await asyncio.wait({asyncio.ensure_future(board.stop())}, timeout=_STOPPING)
        raise
    return measured


async def _measured(board: Board, planned: PlannedMovement) -> Measured:
    """Move there and back once, and return the unit, if only one fits."""
    forth = await _seconds_to(board, planned, planned.goal)
    back = await _seconds_to(board, planned, planned.start)
    times = [timed for timed in (forth, back) if timed is not None]
    shown = " and ".join(f"{timed.seconds:.2f} s" for timed in times)
    text = (
        f"servo {planned.servo_id} took {shown or 'longer than was waited'} for {abs(planned.goal - planned.start)}° "
        f"at interval {planned.interval}"
    )
    if len(times) < 2:
        angle = int((await board.servo(planned.servo_id)).angle)
        text += f"; it reports {angle}° where {planned.start}° was commanded"
        if angle != planned.start or forth is None:
            text += ", so its angles may be in another unit than degrees"
        return Measured("interval_unit", None, "guess", text)
    shortest = planned.interval * _UNITS[0]
    if any(timed.after < 0 and timed.by < shortest / 2 for timed in times):
        text += ", shown by the first reading: it reports the commanded angle, not where it is"
        return Measured("interval_unit", None, "guess", text)
    fitting = [unit for unit in _UNITS if all(each.fits(unit * planned.interval) for each in times)]
    if len(fitting) == 1:
        return Measured("interval_unit", fitting[0], "certain", text)
    if fitting:
        text += f", {_AMBIGUOUS} of {' and '.join(f'{unit * 1000:g}' for unit in fitting)} ms"
        return Measured("interval_unit", None, "guess", text)
    text += ", not a unit of 1, 10 or 100 ms"
    if times[0].fits(times[1].seconds):
        # Rather too short than too long: a movement planned with a short unit is slower than allowed, not faster.
        seconds = sum(each.seconds for each in times) / 2 / planned.interval
        return Measured("interval_unit", float(f"{seconds:.2g}"), "guess", text)
    return Measured("interval_unit", None, "guess", text)


def _is_ambiguous(measured: Measured) -> bool:
    return _AMBIGUOUS in measured.evidence


class _TimedMotion(NamedTuple):
    """Duration of a movement, known with the accuracy of the readings."""

    after: float
    """Latest time in seconds with the servo still on the way; negative without a reading on the way."""
    seconds: float
    """Time of the query with a response that shows the arrival."""
    by: float
    """Time of the response that shows the arrival."""

    def fits(self, seconds: float) -> bool:
        """Return whether a movement of so many seconds could have been read so."""
        return self.after / _NEAR <= seconds <= self.by * _NEAR


async def _seconds_to(board: Board, planned: PlannedMovement, goal: int) -> _TimedMotion | None:
    """Move to `goal` and return the time of arrival; None if the servo does not arrive."""
    loop = asyncio.get_running_loop()
    await board.send(ExecuteActionRequest((Step(planned.servo_id, goal, planned.interval),)))
    begun, after = loop.time(), -1.0
    while (elapsed := loop.time() - begun) < _PATIENCE:
        try:
            angle = (await board.servo(planned.servo_id)).angle
        except RequestTimeout:  # a busy board: the bounds of the time stay right
            continue
        if abs(angle - Degrees(goal)) < _BEGUN:
            timed = _TimedMotion(after, elapsed, loop.time() - begun)
            await asyncio.sleep(_PASSING)
            if abs((await board.servo(planned.servo_id)).angle - Degrees(goal)) < 2 * _BEGUN:
                return timed
        after = elapsed
        await asyncio.sleep(_PAUSE)
    return None
