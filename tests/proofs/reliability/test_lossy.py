"""Queries and openings on a board that loses, damages or delays its responses."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.proofs.reliability.lossy import LOSSY, MIX, outcome


def test_a_board_that_loses_one_response_in_ten_answers_each_query_within_half_a_second() -> None:
    for seed in range(50):  # also the first ones, which are sent when little was timed
        counts, seconds = outcome(LOSSY, 1, 40, seed)
        assert counts["failed"] == counts["not opened"] == 0
        assert seconds[-1] < 0.5


@pytest.mark.parametrize("depth", [2, 4, 16])
def test_nor_does_a_query_take_longer_among_others(depth: int) -> None:
    counts, seconds = outcome(LOSSY, depth, 8000, 1)
    assert counts["failed"] == 0
    assert seconds[-1] < 0.5


def test_nearly_all_openings_and_queries_succeed_in_the_mix() -> None:
    counts = sum((outcome(MIX, 1, 5, seed)[0] for seed in range(100)), Counter[str]())
    assert counts["not opened"] <= 2
    assert counts["failed"] <= 10
