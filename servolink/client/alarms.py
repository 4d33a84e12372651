"""Alarms on readings of servos, such as `current_raw>800 for 0.5s`; the time of each reading is passed in."""

from __future__ import annotations

import math
import re
from collections.abc import Hashable, Iterable, Sequence
from typing import Generic, Literal, TypeAlias, TypeVar, cast, get_args

from msgspec import Struct
from msgspec.structs import force_setattr

from servolink.client.servo_state import Servo
from servolink.errors import quote
from servolink.support import as_number, is_integer

K = TypeVar("K", bound=Hashable)

Quantity: TypeAlias = Literal["current_raw", "temperature_raw"]
"""Raw readings of a servo (3.2.2); the document gives no units for them."""

LONGEST = 3600.0
"""Seconds that a value may be asked to last."""

_SLACK = 1e-6  # seconds: sums of periods are not exact
# Compiled on first use: compiling takes longer than loading the module.
_RULE = r"\s*([a-z_]{1,20})\s*([<>])\s*(-?[0-9]{1,10})(?:\s+for\s+([0-9]{1,6}(?:\.[0-9]{1,6})?)\s*s)?\s*"
_ATTRIBUTES: dict[str, str] = {"current_raw": "current", "temperature_raw": "temperature"}


class Alarm(Struct, frozen=True):
    """Value no servo should have, for some time or at all.

    It is raised once for each servo, and again after a reading in which the servo's value was good. Raise ValueError
    for an unknown quantity or sign, or a time out of range.
    """

    quantity: Quantity
    """Value to compare: `current_raw` or `temperature_raw`."""
    sign: Literal["<", ">"]
    """Whether values below or above the limit are bad."""
    limit: int
    seconds: float = 0.0
    """Seconds for which every reading must be bad, 0..3600; 0 for a single reading."""
    stops: bool = False
    """Whether the alarm stops and holds all servos (see `Board.stop`)."""

    def __post_init__(self) -> None:
        """Refuse conditions without a meaning."""
        if self.quantity not in get_args(Quantity):
            raise ValueError(f"an alarm is about current_raw or temperature_raw, not {quote(self.quantity)}")
        if self.sign not in ("<", ">"):
            raise ValueError(f"the sign of an alarm must be '<' or '>', not {quote(self.sign)}")
        force_setattr(self, "limit", as_number(self.limit))
        force_setattr(self, "seconds", as_number(self.seconds))
        if not is_integer(self.limit):
            raise TypeError(f"the limit of an alarm must be an integer, not {quote(self.limit)}")
        if not math.isfinite(self.seconds) or not 0 <= self.seconds <= LONGEST:
            raise ValueError(f"the time of an alarm must be from 0 to {LONGEST:g} s, not {quote(self.seconds)}")

    @classmethod
    def parse(cls, text: str, *, stops: bool = False) -> Alarm:
        """Return the alarm described by `text`, such as `temperature_raw>300` or `current_raw>800 for 0.5s`."""
        found = re.fullmatch(_RULE, text, re.ASCII)
        if found is None:
            raise ValueError(
                f"an alarm looks like 'temperature_raw>300' or 'current_raw>800 for 0.5s', not like {quote(text)}"
            )
        quantity, sign, limit, seconds = found.groups()
        return cls(cast("Quantity", quantity), cast("Literal['<', '>']", sign), int(limit), float(seconds or 0), stops)

    def __str__(self) -> str:
        """Return the text of the alarm, as for `parse`."""
        return f"{self.quantity}{self.sign}{self.limit}" + (f" for {self.seconds:g}s" if self.seconds else "")

    def value_of(self, servo: Servo) -> int:
        """Return the watched value of a servo."""
        value: int = getattr(servo, _ATTRIBUTES[self.quantity])
        return value

    def is_bad(self, value: int) -> bool:
        """Return whether the value of a servo is bad."""
        return value > self.limit if self.sign == ">" else value < self.limit


class RaisedAlarm(Struct, frozen=True):
    """Alarm raised for a servo."""

    alarm: Alarm
    servo_id: int
    value: int
    """Raw value in the reading."""

    def __str__(self) -> str:
        """Return servo, value and alarm, such as `servo 3: temperature_raw is 312 (alarm temperature_raw>300)`."""
        return f"servo {self.servo_id}: {self.alarm.quantity} is {self.value} (alarm {self.alarm})"


def checked_alarms(alarms: object) -> tuple[Alarm, ...]:
    """Return `alarms`. Raise TypeError for a single alarm, and for texts or other types."""
    if isinstance(alarms, str) or not isinstance(alarms, Iterable):
        raise TypeError(f"alarms must be a list of alarms, such as [Alarm.parse(...)], not {quote(alarms)}")
    checked = tuple(alarms)
    for alarm in checked:
        if not isinstance(alarm, Alarm):
            raise TypeError(f"alarms must be of type Alarm, not {quote(alarm)}; see Alarm.parse")
    return checked


class Lasting(Generic[K]):
    """Conditions that must last: each is raised once, and again after an observation in which it did not hold."""

    def __init__(self) -> None:
        self._since: dict[K, float] = {}
        self._raised: set[K] = set()

    def is_raised(self, key: K, now: float, *, holds: bool, seconds: float) -> bool:
        """Take an observation at `now`; return whether the condition has held for `seconds`, and is raised by it."""
        if not holds:
            self._since.pop(key, None)
            self._raised.discard(key)
            return False
        if key in self._raised or now - self._since.setdefault(key, now) < seconds - _SLACK:
            return False
        self._raised.add(key)
        return True


class AlarmWatch:
    """Compares readings with alarms, and keeps since when values are bad."""

    def __init__(self, alarms: Iterable[Alarm]) -> None:
        self._alarms = checked_alarms(alarms)
        self._bad = Lasting[tuple[Alarm, int]]()

    def check(self, servos: Sequence[Servo], now: float) -> tuple[RaisedAlarm, ...]:
        """Return the alarms raised by the states of `servos` at `now`."""
        if not self._alarms:  # almost always, 50 times a second for each program that watches
            return ()
        return tuple(
            RaisedAlarm(alarm, servo.servo_id, alarm.value_of(servo))
            for alarm in self._alarms
            for servo in servos
            if self._is_raised(alarm, servo, now)
        )

    def _is_raised(self, alarm: Alarm, servo: Servo, now: float) -> bool:
        """Return whether a reading of a servo raises a new alarm."""
        is_bad = alarm.is_bad(alarm.value_of(servo))
        return self._bad.is_raised((alarm, servo.servo_id), now, holds=is_bad, seconds=alarm.seconds)
