"""What a plot draws of the latest readings: as much as can be told apart, and never less than the extremes."""

from __future__ import annotations

import random

import pytest

from tests.studio.web_code import call_all, needs_node

pytestmark = needs_node

_HZ = 50
_KEPT = 3000  # readings


def stretched(angles: list[int], seconds: float, points: int) -> tuple[list[float], list[float]]:
    times, values = call_all([("../../../tests/studio/web_stretch.js", "stretched", [angles, _HZ, seconds, points])])[0]
    return times, values


@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_few_readings_are_all_drawn(count: int) -> None:
    angles = [random.Random(at).randint(-90, 90) for at in range(count)]
    times, values = stretched(angles, 60, 100)
    assert values == angles
    assert times == pytest.approx([(at - count + 1) / _HZ for at in range(count)])


@pytest.mark.parametrize(("count", "seconds", "kept"), [(2000, 60, 2000), (7001, 60, _KEPT), (7001, 10, 501)])
def test_many_readings_are_thinned_out_and_no_extreme_is_lost(count: int, seconds: float, kept: int) -> None:
    angles = [0] * count
    for at in range(count - kept + 20, count, 97):
        angles[at] = at % 180 - 90
    times, values = stretched(angles, seconds, 200)
    assert len(times) == len(values) <= 202
    assert times == sorted(times)
    assert times[-1] == 0
    assert set(angles[count - kept + 20 :]) == set(values)


def test_a_group_stays_the_same_as_it_moves_along() -> None:
    angles = [at * at % 41 for at in range(2000)]
    (_, before), (_, after) = (stretched(angles[: 1900 + more], 20, 200) for more in (0, 3))
    assert str(before[20:-20])[1:-1] in str(after)
