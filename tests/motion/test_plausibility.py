"""Doubts about readings: sentinels, angles beyond a turn, flags, and values in the other byte order."""

from __future__ import annotations

import pytest

from servolink.motion import AngleUnit, doubts
from servolink.protocol import ServoState


def state(
    servo_id: int = 1,
    angle: int = 10,
    current: int = 12,
    temperature: int = 301,
    servo_type: int = 1,
    flags: tuple[int, int] = (1, 1),
) -> ServoState:
    return ServoState(servo_id, angle, current, temperature, servo_type, *flags)


@pytest.mark.parametrize(
    ("reported", "unit", "doubt"),
    [
        (state(), "degree", None),
        (state(angle=-1), "degree", None),
        (state(angle=-360), "degree", None),
        (state(angle=361), "degree", "beyond 360"),
        (state(angle=361), "adc", None),
        (state(angle=361), None, None),
        (state(angle=-1, current=-1, temperature=-1), "degree", "not measured"),
        (state(angle=0x7FFF, current=0x7FFF, temperature=0x7FFF), "adc", "not measured"),
        (state(flags=(255, 1)), "degree", "neither 0 nor 1 in start or hold"),
        (state(current=0x0C00, temperature=0x2D01, servo_type=0x0100), "degree", "fits only the other byte order"),
        (state(current=0x0C00, temperature=0x2D01), "degree", None),  # the type fits in this order only
        (state(current=0, temperature=0, servo_type=0), "degree", None),
    ],
)
def test_only_values_that_cannot_be_true_are_doubted(
    reported: ServoState, unit: AngleUnit | None, doubt: str | None
) -> None:
    assert doubts([reported], lambda _: unit) == ({} if doubt is None else {1: doubt})


def test_one_servo_in_this_byte_order_speaks_for_all() -> None:
    swapped = state(2, current=0x0C00, temperature=0x2D01, servo_type=0x0100)
    assert doubts([swapped, state(1)], lambda _: "degree") == {}


def test_zeros_say_something_only_beside_servos_that_report() -> None:
    blank = state(3, 0, 0, 0, 0, (0, 0))
    zeros = {3: "only zeros, unlike the others"}
    assert doubts([state(1), blank], lambda _: "degree", compares=True) == zeros
    assert doubts([state(1), blank], lambda _: "degree") == {}
    assert doubts([blank], lambda _: "degree", compares=True) == {}
    assert doubts([state(1, temperature=0), blank], lambda _: "degree", compares=True) == {}
