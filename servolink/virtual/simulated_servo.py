"""Simulation of a servo: angle, current and temperature."""

from __future__ import annotations

from math import exp
from typing import ClassVar

from msgspec import Struct

from servolink.protocol import ServoState

DEGREES, ADC = 0, 1
"""Values of `SimulatedServo.unit`, the angle unit."""
LOWEST, HIGHEST = -180.0, 180.0
"""Mechanical stops, in degrees."""

_ADC_CENTRE, _ADC_PER_DEGREE, _ADC_HIGHEST = 2048, 4096 / 360, 4095
_HOLDING, _MOVING = 40.0, 120.0  # current, raw ADC
_PER_SPEED = 0.8  # current for each degree/s, raw ADC
_AMBIENT, _WARMTH = 250.0, 0.4  # temperature, raw ADC (10 for each degree Celsius), and its rise by a current
_WARMING = 60.0  # time constant, in seconds


def to_degrees(adc: int) -> float:
    """Return the angle in degrees for the value `adc` of the position sensor."""
    return (adc - _ADC_CENTRE) / _ADC_PER_DEGREE


def to_adc(degrees: float) -> int:
    """Return the value of the position sensor at `degrees`."""
    return max(0, min(_ADC_HIGHEST, round(_ADC_CENTRE + degrees * _ADC_PER_DEGREE)))


class _Motion(Struct):
    target: float
    speed: float
    end: float


class SimulatedServo:
    """Servo with movements at constant speed."""

    IDLE_CURRENT: ClassVar[float] = 3.0
    """Current of a released servo, raw ADC."""
    MAX_CURRENT: ClassVar[float] = 900.0
    """Highest current, raw ADC."""

    def __init__(self, servo_id: int, angle: float, friction: float) -> None:
        """Start at rest at `angle` (degrees). `friction`, about 1, multiplies the current, different for each servo."""
        self.servo_id = servo_id
        self.angle = angle
        self.unit = DEGREES
        self.is_start = 1
        self.is_hold = 1
        self._charge = 0.0
        self._friction = friction
        self._temperature = _AMBIENT
        self._motion: _Motion | None = None
        self._now: float | None = None
        self.reach = LOWEST, HIGHEST
        """Angles between which nothing is in the way, degrees; a servo that presses against it draws most."""
        self.has_sensor = True
        """Whether the current is measured; a board without reports 0."""

    @property
    def moving(self) -> bool:
        """Whether the servo is moving."""
        return self._motion is not None

    @property
    def position(self) -> float:
        """Angle of the servo as measured, in degrees."""
        return max(self.reach[0], min(self.reach[1], self.angle))

    @property
    def current(self) -> float:
        """Present current of the servo, raw ADC."""
        if self.is_blocked:
            return self.MAX_CURRENT
        if self._motion is not None:
            return min(self.MAX_CURRENT, (_MOVING + _PER_SPEED * abs(self._motion.speed)) * self._friction)
        return _HOLDING * self._friction if self.is_hold else self.IDLE_CURRENT

    @property
    def is_blocked(self) -> bool:
        """Whether something is in the way of the servo, which presses against it."""
        return bool(self.is_hold) and not self.reach[0] <= self.angle <= self.reach[1]

    def state(self) -> ServoState:
        """Return the state for a response of the board, with the angle in the unit of the servo."""
        angle = round(self.position) if self.unit == DEGREES else to_adc(self.position)
        return ServoState(
            servo_id=self.servo_id,
            angle=angle,
            current=round(self.current) if self.has_sensor else 0,
            temperature=round(self._temperature),
            servo_type=1,
            is_start=self.is_start,
            is_hold=self.is_hold,
        )

    def advance(self, now: float) -> None:
        """Advance angle, charge and temperature to `now`; the result does not depend on the number of calls."""
        if self._motion is not None and self._motion.end <= now:
            motion = self._motion
            self._elapse(motion.end)
            self.angle, self._motion = motion.target, None
        self._elapse(now)

    def take_charge(self) -> float:
        """Return the charge used since the last call, current (raw ADC) times seconds."""
        charge, self._charge = self._charge, 0.0
        return charge

    def move(self, target: int, duration: float, now: float) -> None:
        """Move to `target` (in the unit of the servo) in `duration` seconds, unless stopped or released."""
        if not (self.is_start and self.is_hold):
            return
        self.advance(now)
        angle = float(target) if self.unit == DEGREES else to_degrees(target)
        angle = max(LOWEST, min(HIGHEST, angle))
        if duration > 0:
            self._motion = _Motion(angle, (angle - self.angle) / duration, now + duration)
        else:
            self.angle, self._motion = angle, None

    def set_flags(self, is_start: int, is_hold: int, now: float) -> None:
        """Start or stop, hold or release the servo. A stop or release ends the motion at the present angle."""
        self.advance(now)
        if self.is_blocked:
            self.angle = self.position
        self.is_start, self.is_hold = is_start, is_hold
        if not (is_start and is_hold):
            self._motion = None

    def push(self, angle: float) -> None:
        """Turn the servo by hand to `angle` (degrees), up to the stops. No effect on a held servo."""
        if not self.is_hold:
            self.angle = max(LOWEST, min(HIGHEST, angle))

    def switch(self, *, on: bool) -> None:
        """Switch the power on, to hold the angle, or off, to release the servo. Everything but the angle is reset."""
        self.unit, self.is_start, self.is_hold, self._motion = DEGREES, 1, int(on), None

    def _elapse(self, until: float) -> None:
        elapsed = 0.0 if self._now is None else until - self._now
        if elapsed < 0:
            return
        load = self.current
        self._charge += load * elapsed
        settled = _AMBIENT + _WARMTH * load
        self._temperature = settled + (self._temperature - settled) * exp(-elapsed / _WARMING)
        if self._motion is not None:
            self.angle = max(LOWEST, min(HIGHEST, self.angle + self._motion.speed * elapsed))
        self._now = until
