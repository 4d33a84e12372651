"""Angles: whole numbers with a unit, and the values sent for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import ClassVar, Literal, Self

from servolink.errors import EncodeError, quote
from servolink.support import as_number, is_number

AngleUnit = Literal["degree", "adc"]

_LEAST, _GREATEST = -0x8000, 0x7FFF  # in the field of a packet


class Angle(int):
    """Whole number with a unit. `str` gives the number; `repr` shows the unit.

    It adds to and compares with plain numbers and angles in the same unit. Raise TypeError for another unit.
    """

    unit: ClassVar[str] = ""

    def _same_unit(self, other: object) -> None:
        if isinstance(other, Angle) and type(other) is not type(self):
            raise TypeError(f"{self!r} and {other!r} are in different units")

    def _whole(self, other: int) -> int:
        self._same_unit(other)
        number = as_number(other)
        if not isinstance(number, int):
            raise TypeError(f"only whole numbers can be added to {self!r}, not {other!r}")
        return int(number)

    def __add__(self, other: int, /) -> Self:
        """Return the sum, in the same unit. Raise TypeError for a fraction."""
        return type(self)(int(self) + self._whole(other))

    def __sub__(self, other: int, /) -> Self:
        """Return the difference, in the same unit. Raise TypeError for a fraction."""
        return type(self)(int(self) - self._whole(other))

    __radd__ = __add__

    def __rsub__(self, other: int, /) -> Self:
        """Return the difference, in the unit of this angle."""
        return -self + other

    def __neg__(self) -> Self:
        """Return the opposite angle."""
        return type(self)(-int(self))

    def __lt__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) < other

    def __le__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) <= other

    def __gt__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) > other

    def __ge__(self, other: int, /) -> bool:
        """Compare. Raise TypeError for another unit."""
        self._same_unit(other)
        return int(self) >= other

    def __eq__(self, other: object, /) -> bool:
        """Compare. Angles in different units are never equal."""
        if isinstance(other, Angle) and type(other) is not type(self):
            return False
        return int(self) == other

    def __ne__(self, other: object, /) -> bool:
        """Compare as angles; the operator of `int` ignores units."""
        return not self == other

    def __hash__(self) -> int:
        """Return the hash of the number, because both are equal."""
        return hash(int(self))

    def __str__(self) -> str:
        """Return the number alone, so that CSV files, logs and f-strings hold numbers."""
        return int.__repr__(self)

    def __repr__(self) -> str:
        """Return number and unit, such as `Degrees(90)`."""
        return f"{type(self).__name__}({int(self)})"


class Degrees(Angle):
    """An angle in degrees."""

    unit: ClassVar[str] = "degree"


class Adc(Angle):
    """An angle as the raw reading of the servo's analog-to-digital converter."""

    unit: ClassVar[str] = "adc"


_MOST_DEGREES = 360


def is_no_degree(angle: int) -> bool:
    """Return whether an angle is reported in degrees and is beyond a full turn, so that it must be something else."""
    return isinstance(angle, Degrees) and not -_MOST_DEGREES <= int(angle) <= _MOST_DEGREES


def in_unit(value: int, unit: AngleUnit | None) -> int:
    """Return `value` as an angle in `unit`, or unchanged if the unit is unknown."""
    return value if unit is None else {"degree": Degrees, "adc": Adc}[unit](value)


def wire_angle(value: float, unit: AngleUnit | None, servo_id: int) -> int:
    """Return the number to send to a servo set to `unit`.

    Raise EncodeError for an angle in another unit, and outside -32768..32767.
    """
    where = f"servo {servo_id}"
    if isinstance(value, Angle):
        if value.unit != unit:
            raise EncodeError(
                f"{where}: {quote(value)} was given, but this servo is set to {unit or 'an unknown unit'}"
            )
    elif unit == "adc":
        raise EncodeError(f"{where}: {quote(value)} was given, but this servo is set to adc; write Adc({quote(value)})")
    if not is_number(value) or value != value // 1:
        raise EncodeError(
            f"{where}: the angle must be a whole number, not {quote(value)}; the protocol has no fractions"
        )
    if not _LEAST <= value <= _GREATEST:
        raise EncodeError(f"{where}: the angle {quote(value)} is outside {_LEAST}..{_GREATEST}")
    return int(value)


def wire_angles(targets: Mapping[int, float], unit_of: Callable[[int], AngleUnit | None]) -> dict[int, int]:
    """Return the numbers to send for `targets`. Raise EncodeError for an angle in a wrong unit."""
    return {servo_id: wire_angle(value, unit_of(servo_id), servo_id) for servo_id, value in targets.items()}
