"""Angles that carry their unit, so that degrees and raw ADC readings cannot be mixed."""

from __future__ import annotations

from typing import ClassVar, Literal, Self

from servolink.errors import EncodeError
from servolink.printable import shown

AngleUnit = Literal["degree", "adc"]


class Angle(int):
    """A whole number in one unit; it adds to and compares with plain numbers and its own unit only."""

    unit: ClassVar[str] = ""

    def _same_unit(self, other: object) -> None:
        if isinstance(other, Angle) and type(other) is not type(self):
            raise TypeError(f"{self!r} and {other!r} are in different units")

    def _whole(self, other: int) -> int:
        self._same_unit(other)
        if not isinstance(other, int):
            raise TypeError(f"{self!r} is a whole number, and {other!r} is not")
        return int(other)

    def __add__(self, other: int, /) -> Self:
        """Return the sum, in this unit; TypeError for a fraction."""
        return type(self)(int(self) + self._whole(other))

    def __sub__(self, other: int, /) -> Self:
        """Return the difference, in this unit; TypeError for a fraction."""
        return type(self)(int(self) - self._whole(other))

    __radd__ = __add__

    def __rsub__(self, other: int, /) -> Self:
        """Return the difference, in this unit."""
        return -self + other

    def __neg__(self) -> Self:
        """Return the opposite angle."""
        return type(self)(-int(self))

    def __lt__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) < other

    def __le__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) <= other

    def __gt__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) > other

    def __ge__(self, other: int, /) -> bool:
        """Compare; TypeError across units."""
        self._same_unit(other)
        return int(self) >= other

    def __eq__(self, other: object, /) -> bool:
        """Compare; never equal across units."""
        if isinstance(other, Angle) and type(other) is not type(self):
            return False
        return int(self) == other

    def __ne__(self, other: object, /) -> bool:
        """Compare; `int` has an operator of its own, which knows no units."""
        return not self == other

    def __hash__(self) -> int:
        """Hash as the number, to which it is equal."""
        return hash(int(self))

    def __repr__(self) -> str:
        """Show value and unit."""
        return f"{type(self).__name__}({int(self)})"


class Degrees(Angle):
    """An angle in degrees."""

    unit: ClassVar[str] = "degree"

    def __str__(self) -> str:
        """Show as people write it."""
        return f"{int(self)}°"


class Adc(Angle):
    """An angle as the raw reading of a servo's converter."""

    unit: ClassVar[str] = "adc"

    def __str__(self) -> str:
        """Show with its unit, since nobody expects it."""
        return f"{int(self)} ADC"


def in_unit(value: int, unit: AngleUnit | None) -> int:
    """Return a number that the board reported as an angle in `unit`; a plain number if that is unknown."""
    return value if unit is None else {"degree": Degrees, "adc": Adc}[unit](value)


def wire_angle(value: float, unit: AngleUnit | None, servo_id: int) -> int:
    """Return the number to send for `value` to a servo that is set to `unit`; EncodeError if that is another unit."""
    where = f"servo {servo_id}"
    if isinstance(value, Angle):
        if value.unit != unit:
            raise EncodeError(
                f"{where}: {shown(value)} was given, but this servo is set to {unit or 'an unknown unit'}"
            )
    elif unit == "adc":
        raise EncodeError(f"{where}: {shown(value)} was given, but this servo is set to adc; write Adc({shown(value)})")
    if isinstance(value, bool) or not isinstance(value, (int, float)) or value != value // 1:
        raise EncodeError(f"{where}: {shown(value)} is no whole number of degrees; the protocol has no fractions")
    return int(value)
