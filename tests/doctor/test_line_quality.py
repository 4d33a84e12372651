"""What is made of the responses to sixty queries."""

from __future__ import annotations

import pytest

from servolink.doctor.line_quality import REQUESTS, LineCounts, check_line


@pytest.mark.parametrize(
    ("unanswered", "late", "observation"),
    [
        (0, 0, ""),
        (0, 2, ""),  # the computer stood still for a moment
        (0, 3, "0 of 60 queries had no response in 0.5 s, and 3 responses came late"),
        (1, 0, "1 of 60 queries had no response in 0.5 s"),
        (1, 1, "1 of 60 queries had no response in 0.5 s, and 1 response came late"),
    ],
)
def test_a_few_late_responses_count_only_beside_missing_ones(unanswered: int, late: int, observation: str) -> None:
    line = LineCounts(900, 0, REQUESTS, unanswered, late, (0.001,) * REQUESTS)
    assert [finding.observation for finding in check_line(line)] == [observation] * bool(observation)
