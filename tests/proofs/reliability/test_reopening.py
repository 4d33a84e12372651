"""Programs that begin where another one was killed: what is owed is found out, and never taken for an answer."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

import pytest

from tests.proofs.reliability.reopening import Owed, open_often
from tests.proofs.reliability.stage import Stage

KINDS = ("any", "those of the handshake")
STOPPED = Owed(0, 5, "stops and movements", 1.0, stops=True)


def waiting(begin: Callable[[Stage], Awaitable[None]]) -> Callable[[Stage], Awaitable[None]]:
    """Return an opening that goes on until the handshake is over."""

    async def begin_and_shake_hands(stage: Stage) -> None:
        await begin(stage)
        await stage.link.shake_hands()

    return begin_and_shake_hands


@pytest.mark.parametrize("kinds", KINDS)
def test_up_to_five_owed_responses_never_open_wrongly(kinds: str) -> None:
    counts = open_often(Owed(0, 5, kinds, 1.0), 100, 1)
    assert counts["openings"] == 100
    assert counts["not opened"] <= 1
    assert counts["wrong openings"] == counts["fooled"] == 0


def test_a_stop_gets_through_at_once_whatever_a_killed_program_was_doing() -> None:
    counts = open_often(STOPPED, 100, 1)
    assert counts["openings"] == 100
    assert counts["not opened"] + counts["unconfirmed stops"] <= 1
    assert counts["stops that waited"] == counts["wrong openings"] == counts["fooled"] == 0


def test_stops_that_wait_for_the_handshake_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Stage, "begin_opening", waiting(Stage.begin_opening))
    assert open_often(STOPPED, 20, 1)["stops that waited"] == 20


def test_nothing_owed_costs_six_round_trips() -> None:
    counts = open_often(Owed(0, 0, "any", 1.0), 20, 1)
    assert counts["sendings"] == 20 * 6
