"""Angles: their unit goes with them."""

from __future__ import annotations

import csv
import io
import json
import math
import operator
from collections.abc import Callable

import pytest

from servolink.errors import EncodeError
from servolink.motion.angles import Adc, Angle, AngleUnit, Degrees, in_unit, wire_angle


def test_a_reported_angle_has_the_unit_it_was_reported_in() -> None:
    assert (type(in_unit(90, "degree")), type(in_unit(2048, "adc")), type(in_unit(7, None))) == (Degrees, Adc, int)
    assert in_unit(90, "degree") == 90


def test_an_angle_is_a_number_wherever_it_is_written() -> None:
    row = io.StringIO()
    csv.writer(row).writerow([Degrees(22), Adc(2048)])
    assert row.getvalue() == "22,2048\r\n"
    assert (str(Degrees(-5)), f"{Adc(2048)}", f"{Degrees(5):+d}", "%s" % Degrees(7)) == ("-5", "2048", "+5", "7")  # noqa: UP031
    assert json.dumps([Degrees(22)]) == "[22]"


def test_repr_shows_the_unit() -> None:
    assert (repr(Degrees(-5)), repr(Adc(2048))) == ("Degrees(-5)", "Adc(2048)")


def test_arithmetic_keeps_the_unit() -> None:
    for angle, number in (
        (Degrees(5) + 3, 8),
        (Degrees(5) + Degrees(3), 8),
        (3 + Degrees(5), 8),
        (Degrees(5) - 3, 2),
        (3 - Degrees(5), -2),
        (-Degrees(5), -5),
        (sum([Degrees(1), Degrees(2)]), 3),
    ):
        assert type(angle) is Degrees
        assert angle == number


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.lt, operator.le, operator.gt, operator.ge])
def test_units_do_not_mix(operation: Callable[[object, object], object]) -> None:
    with pytest.raises(TypeError, match="different units"):
        operation(Degrees(5), Adc(5))
    with pytest.raises(TypeError, match="different units"):
        operation(Adc(5), Degrees(5))


def test_a_sum_of_different_units_is_refused() -> None:
    with pytest.raises(TypeError, match="different units"):
        sum([Degrees(1), Adc(2)])


def test_comparison_with_the_own_unit_and_with_plain_numbers() -> None:
    assert Degrees(4) < Degrees(5) <= Degrees(5) <= 6
    assert Degrees(5) > Degrees(4) >= Degrees(4) >= 3
    assert Degrees(5) == Degrees(5) == 5
    assert Degrees(5) != Degrees(6)
    assert Degrees(5) != 6
    assert not Degrees(5) != 5  # noqa: SIM202 - the operator is what is tested


def test_angles_of_different_units_are_never_equal() -> None:
    same: Angle = Adc(5)
    assert Degrees(5) != same
    assert not Degrees(5) == same  # noqa: SIM201 - the operator is what is tested
    assert len({Degrees(5), Adc(5)}) == 2


def test_an_angle_is_found_where_its_number_is() -> None:
    assert {90: "up"}[Degrees(90)] == "up"


@pytest.mark.parametrize(
    ("value", "unit", "wire"),
    [
        (90, "degree", 90),
        (-90.0, "degree", -90),
        (Degrees(90), "degree", 90),
        (Adc(2048), "adc", 2048),
        (1234, None, 1234),
        (-32768, "degree", -32768),
        (32767.0, None, 32767),
    ],
)
def test_what_goes_together_is_sent(value: float, unit: AngleUnit | None, wire: int) -> None:
    assert wire_angle(value, unit, 1) == wire
    assert type(wire_angle(value, unit, 1)) is int


@pytest.mark.parametrize(
    ("value", "unit", "words"),
    [
        (Adc(2048), "degree", r"servo 7: Adc\(2048\) was given, but this servo is set to degree"),
        (Degrees(90), "adc", r"servo 7: Degrees\(90\) was given, but this servo is set to adc"),
        (Degrees(90), None, r"an unknown unit"),
        (90, "adc", r"write Adc\(90\)"),
        (1.5, "degree", r"must be a whole number, not 1\.5"),
        (math.nan, "degree", "must be a whole number, not nan"),
        (math.inf, "degree", "must be a whole number, not inf"),
        (-math.inf, None, "must be a whole number, not -inf"),
        (True, "degree", "must be a whole number, not True"),
        ("90", "degree", "must be a whole number, not '90'"),
        (32768, "degree", r"servo 7: the angle 32768 is outside -32768\.\.32767"),
        (-32769.0, None, "is outside"),
        (10**400, "degree", "is outside"),
        (1e300, "degree", "is outside"),
    ],
)
def test_what_does_not_go_together_is_refused(value: float, unit: AngleUnit | None, words: str) -> None:
    with pytest.raises(EncodeError, match=words):
        wire_angle(value, unit, 7)


def test_a_fraction_is_never_cut_off() -> None:
    with pytest.raises(TypeError, match="only whole numbers"):
        operator.add(Degrees(90), 0.5)
    with pytest.raises(TypeError, match="only whole numbers"):
        operator.sub(Degrees(90), 0.5)
