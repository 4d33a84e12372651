"""Searches of a space of points: some of them in every run, all of them where slow tests run."""

from __future__ import annotations

import random
from collections.abc import Container, Iterable

import pytest


def every(step: int) -> pytest.MarkDecorator:
    """Give a test `step`, for `some`; 1 when slow tests run."""
    return pytest.mark.parametrize(
        "step", [pytest.param(step, id="some"), pytest.param(1, id="all", marks=pytest.mark.slow)]
    )


def sampled(cases: Iterable[object], count: int, always: Container[object] = ()) -> list[object]:
    """Return parameters for all of `cases`; all are slow but `always` and `count` others, the same in each run."""
    every_case = list(cases)
    drawn = random.Random(count).sample(range(len(every_case)), count)
    return [
        case
        if at in drawn or case in always
        else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
        for at, case in enumerate(every_case)
    ]


def some(start: int, stop: int, step: int) -> range:
    """Return every `step`-th point from a random one on: other points in each run, over some runs all of them."""
    return range(start + random.randrange(step), stop, step)
