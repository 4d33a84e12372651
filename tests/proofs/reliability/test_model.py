"""All interleavings of a few requests: the rules hold in each of them, and each simpler rule breaks in some."""

from __future__ import annotations

from dataclasses import replace

import pytest

from servolink.connection import Content, Handshake, Lane, Settled, Slot, Slots
from servolink.protocol import QueryActionResponse
from tests.connection import opening_states as openings
from tests.proofs.reliability.model import SHORT, A, B, C, Case, D, Model, T, Violation, W


def smaller(case: Case) -> list[Case]:
    """Return the case with one repeat, cancellation or fence less."""
    cases = []
    if case.repeats:
        cases.append(replace(case, name=f"{case.name}, fewer repeats", repeats=case.repeats - 1))
    if case.cancels:
        cases.append(replace(case, name=f"{case.name}, fewer cancellations", cancels=case.cancels - 1))
    if case.fences:
        cases.append(replace(case, name=f"{case.name}, fewer fences", fences=case.fences - 1))
    return cases


LARGE = [case for case in SHORT if case.repeats + case.cancels + case.fences >= 3 or W in case.requests]
"""Cases with thousands of states."""
CASES = [case for case in SHORT if case not in LARGE] + [case for large in LARGE for case in smaller(large)]
COSTLY = {
    "a fence that is asked for as well",
    "a setting, answered twice, fewer repeats",
    "a setting and a fence, fewer fences",
    "a fence that is asked for, answered twice",
    "one servo, fenced by all of them",
    "keyed queries, two of them equal",
    "keyed queries, fewer cancellations",
    "equal queries, fewer cancellations",
    "commands without read-back, fewer cancellations",
}
"""Other cases whose states take as long as those of all the rest together."""


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=pytest.mark.slow if case in LARGE or case.name in COSTLY else ())
        for case in (*CASES, *LARGE)
    ],
    ids=lambda case: case.name,
)
def test_nothing_can_go_wrong(case: Case) -> None:
    model = Model(case)
    model.run()
    assert model.steps > model.states > 50


@pytest.mark.parametrize("case", openings.SHORT, ids=lambda case: case.name)
def test_no_opening_is_wrong(case: openings.OpeningCase) -> None:
    smaller = replace(case, owed=min(case.owed, 1), words=1, sendings=min(case.sendings, 8))
    states, wrong = openings.walk(smaller)
    assert (states > 2, wrong) == (True, [])


def test_openings_that_forget_second_responses_are_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    case = next(case for case in openings.SHORT if case.copies == 2)
    monkeypatch.setattr(openings, "Handshake", lambda *arguments, **options: Handshake(*arguments, is_quiet=False))
    assert openings.walk(replace(case, owed=0, words=1))[1]


def test_the_usual_rules_are_found_out_on_a_board_that_answers_twice() -> None:
    case = next(case for case in SHORT if case.copies == 2)
    with pytest.raises(Violation):
        Model(case, Slots).run()


class Simpler(Slots):
    """Slots with a rule that looks simpler."""

    def _forget(self, slot: Slot) -> None:
        slot.lane.slots.remove(slot)
        slot.lane.slots.appendleft(slot)
        self._close(slot)

    def _fitting(self, lane: Lane, content: Content) -> list[Slot]:
        return [slot for slot in lane.slots if isinstance(content, Exception) or slot.request.accepts(content)]


class Forgetful(Simpler):
    """A slot ends with its timeout; the next response is for the oldest slot on its lane."""

    def expire(self, slot: Slot) -> None:
        super().expire(slot)
        self._forget(slot)

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        lane = self.lanes[response_id]
        return self._settle_oldest(lane.slots[0], content) if lane.slots else []


class InTurn(Simpler):
    """The next response is for the oldest slot on its lane."""

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        lane = self.lanes[response_id]
        return self._settle_oldest(lane.slots[0], content) if lane.slots else []


class ForgetfulWithKeys(Simpler):
    """A slot ends with its timeout."""

    def expire(self, slot: Slot) -> None:
        super().expire(slot)
        self._forget(slot)

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        return super().settle(response_id, content) or []


class NoneToTheOldest(Simpler):
    """A record that does not exist is that of the oldest query."""

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        lane = self.lanes[response_id]
        if isinstance(content, QueryActionResponse) and content.action_id == 0 and lane.slots:
            return self._settle_oldest(lane.slots[0], content)
        return super().settle(response_id, content)


class ResultsToTheOldest(Simpler):
    """A result is that of the oldest command."""

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        lane = self.lanes[response_id]
        if lane.slots and not lane.slots[0].request.repeatable:
            return self._settle_oldest(lane.slots[0], content)
        return super().settle(response_id, content)


class ToTheNewest(Simpler):
    """The newest of equal queries gets the response."""

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        fitting = self._fitting(self.lanes[response_id], content)
        if len(fitting) > 1 and all(slot.request == fitting[0].request for slot in fitting):
            return self._settle_exact(fitting[-1], content)
        return super().settle(response_id, content)


class EqualOnesSettleKeptOnes(Simpler):
    """The oldest of equal queries settles whatever is kept, as an exact response does."""

    def _settle_oldest(self, oldest: Slot, content: Content) -> list[Settled]:
        return self._settle_exact(oldest, content)


class OverdueIsOver(Simpler):
    """Overdue slots are no candidates."""

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        live = [slot for slot in self._fitting(self.lanes[response_id], content) if not slot.overdue]
        return self._settle_exact(live[0], content) if len(live) == 1 else super().settle(response_id, content)


EQUAL = Case("equal", (T, T), repeats=1, cancels=1)
KEYED = Case("keyed", (A, B), repeats=1)
COMMANDS = Case("commands", (C, D), fences=1)


@pytest.mark.parametrize(
    ("rules", "case", "what"),
    [
        (Forgetful, EQUAL, "is said to be over"),
        (InTurn, KEYED, "caller 0 got"),
        (ForgetfulWithKeys, EQUAL, "is said to be over"),
        (NoneToTheOldest, KEYED, "caller 0 got"),
        (ResultsToTheOldest, COMMANDS, "caller 0 got"),
        (ToTheNewest, EQUAL, "is said to be over"),
        (EqualOnesSettleKeptOnes, KEYED, "caller 0 got"),
        (OverdueIsOver, EQUAL, "is said to be over"),
    ],
)
def test_each_simpler_rule_is_found_out(rules: type[Slots], case: Case, what: str) -> None:
    with pytest.raises(Violation, match=what):
        Model(case, rules).run()
