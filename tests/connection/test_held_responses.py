"""Responses that are held until the next query comes."""

from __future__ import annotations

import pytest

from servolink.connection.deadlines import HeldResponses


@pytest.mark.parametrize(
    ("events", "is_sure"),
    [
        ("A1 A2 B:A C:B", True),  # nothing comes before the next query
        ("A:a B:A C:B", True),  # the first one may be owed to an earlier program
        ("A B:A C:C", False),
        ("A A:A B:B", False),
        ("A B:A", False),
    ],
)
def test_responses_that_come_behind_the_next_query_only_are_held(events: str, is_sure: bool) -> None:
    held = HeldResponses()
    for event in events.split():
        query, _, answer = event.partition(":")
        held.sent(query[0])
        if answer:
            held.heard(answer)
    assert held.is_sure == is_sure
