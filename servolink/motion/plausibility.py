"""Doubts about readings: values of servos that cannot be true, although the board reports them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from servolink.motion.angles import AngleUnit, Degrees
from servolink.protocol import ServoState

_BEYOND = "beyond 360"
_NOT_MEASURED = "not measured"
_ZEROS = "only zeros, unlike the others"
_OTHER_ORDER = "fits only the other byte order"
_FLAGS = "neither 0 nor 1 in start or hold"

_FILLS = {-1, 0x7FFF, -0x8000}  # in every field of a state that was not measured
_MOST_RAW, _MOST_TYPE = 0xFFF, 0xFF  # of an analog-to-digital converter of 12 bits; of a kind of servo
_LEAST_EVIDENCE = 2


def doubts(
    states: Sequence[ServoState], unit_of: Callable[[int], AngleUnit | None], *, compares: bool = False
) -> dict[int, str]:
    """Return why the values of servos cannot be true, by servo id; servos without a doubt are left out.

    With `compares`, also where a servo reports nothing but zeros, and the others do not: that may be true.
    """
    is_swapped = _is_swapped(states)
    found = {
        state.servo_id: _doubt(state, unit_of(state.servo_id)) or (_OTHER_ORDER if is_swapped else "")
        for state in states
    }
    return (_only_zeros(states) if compares else {}) | {each: doubt for each, doubt in found.items() if doubt}


def _only_zeros(states: Iterable[ServoState]) -> dict[int, str]:
    """Return the doubt about servos that report nothing but zeros, where others report temperature and type."""
    blank = [state for state in states if not (state.angle or state.current or state.temperature or state.servo_type)]
    others = [state for state in states if state not in blank]
    is_told = bool(others) and all(state.temperature and state.servo_type for state in others)
    return {state.servo_id: _ZEROS for state in blank} if is_told else {}


def _doubt(state: ServoState, unit: AngleUnit | None) -> str:
    if state.angle == state.current == state.temperature and state.angle in _FILLS:
        return _NOT_MEASURED
    if unit == "degree" and Degrees(state.angle).is_beyond:
        return _BEYOND
    return "" if {state.is_start, state.is_hold} <= {0, 1} else _FLAGS


def _is_swapped(states: Iterable[ServoState]) -> bool:
    """Return whether the raw values and types fit their usual ranges in the other byte order only, without exception.

    Values that fit in both byte orders, or in neither, say nothing.
    """
    evidence = 0
    for state in states:
        for value, most in ((state.current, _MOST_RAW), (state.temperature, _MOST_RAW), (state.servo_type, _MOST_TYPE)):
            fits, fits_swapped = 0 <= value <= most, 0 <= _swapped(value) <= most
            if fits and not fits_swapped:
                return False
            evidence += fits_swapped and not fits
    return evidence >= _LEAST_EVIDENCE


def _swapped(value: int) -> int:
    return int.from_bytes(value.to_bytes(2, "little", signed=True), "big", signed=True)
