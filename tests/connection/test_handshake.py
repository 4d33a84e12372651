"""Handshake: no response to an earlier program is taken for one of ours, short of a whole copy of the word."""

from __future__ import annotations

import itertools
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from random import Random
from typing import cast

import pytest

from servolink.connection import handshake
from servolink.connection.handshake import (
    FIRST_LENGTH,
    LEAST_KINDS,
    MOST_SILENT,
    SECOND_LENGTH,
    THIRD_LENGTH,
    Handshake,
)
from servolink.connection.opening import Opening
from tests.proofs.reliability.reopening import Owed, open_often
from tests.tables import over

KINDS: Sequence[int] = (1, 2, 3, 4)
NEVER: Iterator[bool] = iter(())


class Board:
    """Answers in order. What it owes to others is negative, so that nobody but a test can tell it from the rest."""

    def __init__(self, owed: Sequence[int] = (), unsupported: Sequence[int] = ()) -> None:
        self.coming = deque(-kind for kind in owed)
        self.unsupported = unsupported

    def ask(self, kind: int | None) -> None:
        if kind is not None and kind not in self.unsupported:
            self.coming.append(kind)


def shake(hands: Handshake[int], board: Board, lost: Iterator[bool] = NEVER) -> bool:
    """Shake hands until it is open; return whether all that still comes then is known to be on its way."""
    while not hands.is_open and hands.is_provable:
        board.ask(hands.query())
        if not board.coming:
            board.ask(hands.repeat())
        elif not next(lost, False):
            hands.heard(abs(board.coming.popleft()))
        else:
            board.coming.popleft()
        assert hands.sendings < 1000
    leftover = iter(hands.leftover() if hands.is_open else ())
    return all(kind in leftover for kind in board.coming)


def of_length(monkeypatch: pytest.MonkeyPatch, first: int, second: int) -> None:
    monkeypatch.setattr(handshake, "FIRST_LENGTH", first)
    monkeypatch.setattr(handshake, "SECOND_LENGTH", second)


def test_a_board_that_owes_nothing_is_asked_each_query_of_the_word_once() -> None:
    hands, board = Handshake(KINDS, Random(1)), Board()
    assert shake(hands, board)
    assert hands.sendings == FIRST_LENGTH
    assert hands.leftover() == []
    assert hands.query() is None
    hands.heard(1)  # nothing changes that any more
    assert hands.is_open


def test_one_query_is_under_way_at_a_time() -> None:
    hands = Handshake(KINDS, Random(1))
    first = hands.query()
    assert first is not None
    assert hands.query() is None
    hands.heard(first)
    assert hands.query() is not None
    assert hands.query() is None


@over("seed", range(20))
def test_the_last_kind_occurs_nowhere_else_in_the_word(seed: int) -> None:
    hands, board = Handshake(KINDS, Random(seed)), Board()
    asked = []
    while (kind := hands.query()) is not None:
        asked.append(kind)
        hands.heard(kind)
    assert len(asked) == FIRST_LENGTH
    assert asked.count(asked[-1]) == 1
    assert not board.coming


class Words:
    """Draws the words that it was given, in place of a random one."""

    def __init__(self, words: Sequence[Sequence[int]]) -> None:
        self._words = itertools.chain(words, itertools.repeat(words[-1]))
        self._word: Sequence[int] = ()

    def choice(self, kinds: Sequence[int]) -> int:
        self._word = next(self._words)
        return self._word[-1]

    def choices(self, kinds: Sequence[int], *, k: int) -> Sequence[int]:
        return self._word[:k]


@pytest.mark.parametrize(
    ("length", "count"),
    [
        *((2, 2), (3, 2), (4, 2), (6, 2), (2, 3), (3, 3), (2, 4)),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in ((4, 3), (3, 4))),
    ],
)
def test_fewer_owed_responses_than_queries_never_open_wrongly(
    length: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each first word and each second one, against all that fewer responses can be."""
    of_length(monkeypatch, length, length)
    kinds = range(1, count + 1)
    words = [word for word in itertools.product(kinds, repeat=length) if word[-1] not in word[:-1]]
    owed = [each for number in range(length) for each in itertools.product(kinds, repeat=number)]
    for drawn in itertools.product(words, repeat=2):
        for each in owed:
            hands = Handshake(kinds, cast("Random", Words(drawn)), is_quiet=count < LEAST_KINDS)  # so that two will do
            assert shake(hands, Board(each)), (drawn, each)


@pytest.mark.parametrize("owed", range(FIRST_LENGTH))
def test_that_holds_with_lost_responses_and_repeats(owed: int) -> None:
    random = Random(owed)
    for _ in range(700):
        board = Board(random.choices(KINDS, k=owed))
        assert shake(Handshake(KINDS, random), board, (random.random() < 0.1 for _ in itertools.count()))


def formula(owed: int, length: int, kinds: int) -> float:
    """Return how likely random owed responses hold a copy of the word: 1 - a(k)/K^k, a(m) = K a(m-1) - a(m-n)."""
    without = [1.0]
    for count in range(1, owed + 1):
        without.append(kinds * without[-1] - (without[count - length] if count >= length else 0))
    return float(1 - without[owed] / kinds**owed)


@pytest.mark.parametrize(("length", "owed"), [(2, 2), (2, 5), (3, 4), (3, 8), (4, 8)])
def test_more_open_wrongly_as_often_as_the_formula_says(
    length: int, owed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_length(monkeypatch, length, length)
    monkeypatch.setattr(handshake.Handshake, "_draw", once(handshake.Handshake._draw))  # else there is a second word
    random, times = Random(5), 2000
    wrong = sum(not shake(Handshake(KINDS, random), Board(random.choices(KINDS, k=owed))) for _ in range(times))
    expected = formula(owed, length, len(KINDS)) * times
    assert abs(wrong - expected) < 4 * expected**0.5


def once(draw: Callable[[Handshake[int], int], None]) -> Callable[[Handshake[int], int], None]:
    def draw_once(self: Handshake[int], length: int) -> None:
        if not self._word:
            draw(self, length)

    return draw_once


def test_a_second_word_makes_that_rarer() -> None:
    """2.5e-4 for eight owed responses, 2.4e-4 for 32: 1 in 4,000, and not 1 in 150 as with the first word alone."""
    random = Random(7)
    for owed in (8, 32):
        wrong = sum(not shake(Handshake(KINDS, random), Board(random.choices(KINDS, k=owed))) for _ in range(2000))
        assert wrong <= 4


def test_the_first_response_that_does_not_fit_draws_a_longer_word() -> None:
    hands, board = Handshake(KINDS, Random(2)), Board()
    first = hands.query()
    assert first is not None
    hands.heard(first % 4 + 1)
    board.ask(first)
    assert shake(hands, board)
    assert hands.sendings in range(SECOND_LENGTH, SECOND_LENGTH + 3)


def test_a_lost_response_is_asked_for_again_and_its_late_twin_only_falls_back() -> None:
    hands = Handshake(KINDS, Random(3))
    first = hands.query()
    assert first is not None
    assert hands.repeat() == first
    hands.heard(first)
    second = hands.query()
    assert second is not None
    hands.heard(first)  # the late one
    assert shake(hands, Board([second]))


def test_what_was_sent_since_the_first_last_query_may_still_be_answered() -> None:
    hands = Handshake(KINDS, Random(4))
    for _ in range(FIRST_LENGTH - 1):
        kind = hands.query()
        assert kind is not None
        hands.heard(kind)
    last = hands.query()
    assert last is not None
    repeats = [hands.repeat(), hands.repeat()]
    assert repeats[0] == last
    hands.heard(last)
    assert hands.is_open
    assert hands.leftover() == repeats


@pytest.mark.parametrize("owed", [3, 8, 32])
def test_no_responses_keep_it_going_for_ever(owed: int) -> None:
    random = Random(owed)
    for _ in range(1000):  # one in a hundred did, with a query sent for each response that came
        hands = Handshake(KINDS, random)
        shake(hands, Board(random.choices(KINDS, k=owed)))
        assert hands.sendings < 20 + 3 * owed


def test_a_word_whose_last_query_was_never_sent_is_not_ours() -> None:
    hands = Handshake((1, 2, 3), cast("Random", Words([(1, 2, 1, 2, 1, 3)])))
    for kind in (1, 2, 1, 2, 1, 3):
        hands.heard(kind)
    assert not hands.is_open


def test_other_responses_are_owed_too() -> None:
    hands = Handshake(KINDS, Random(1))
    kind = hands.query()
    hands.heard(99)
    assert hands.unsupported == set()
    assert kind is not None
    assert shake(hands, Board([kind]))


@over("seed", range(40))
@over("unsupported", [(1,), (4,)])
def test_kinds_that_the_board_does_not_answer_are_left_out(unsupported: tuple[int, ...], seed: int) -> None:
    hands = Handshake(KINDS, Random(seed))
    assert shake(hands, Board(unsupported=unsupported))
    assert hands.is_provable
    assert hands.is_open
    assert hands.unsupported <= set(unsupported)
    assert hands.sendings <= THIRD_LENGTH + SECOND_LENGTH + 6 * MOST_SILENT


def test_with_fewer_kinds_less_owed_than_queries_still_never_opens_wrongly() -> None:
    random = Random(8)
    for _ in range(2000):
        owed = random.choices(KINDS, k=random.randrange(FIRST_LENGTH))
        board = Board(owed, unsupported=random.sample(KINDS, 1))
        assert shake(Handshake(KINDS, random), board)


@pytest.mark.parametrize("missing", [(1, 2), (1, 2, 3)])
def test_fewer_than_three_kinds_prove_nothing(missing: tuple[int, ...]) -> None:
    hands = Handshake(KINDS, Random(1), spare=(5,))
    shake(hands, Board(unsupported=missing))
    assert not hands.is_open
    assert not hands.is_provable
    assert len(hands.kinds) <= 2
    assert not Handshake(KINDS, Random(1), missing).is_provable


@pytest.mark.parametrize("count", [1, 2])
def test_after_a_silence_one_kind_or_two_are_enough(count: int) -> None:
    for seed in range(20):
        hands, board = Handshake(KINDS[:count], Random(seed), is_quiet=True), Board()
        assert shake(hands, board)
        assert hands.sendings == (1 if count == 1 else FIRST_LENGTH)
        assert not Handshake((), Random(1), is_quiet=True).is_open


@pytest.mark.parametrize("missing", [(), (1,)])
def test_a_board_that_may_answer_twice_is_asked_no_kind_twice_in_a_row(missing: tuple[int, ...]) -> None:
    """Each response may come once or twice, or is lost; what is left over is known, the second of the last included."""
    random = Random(3)
    for _ in range(3000):
        owed = [kind for kind in random.choices(KINDS, k=random.randrange(4)) for _ in range(random.choice((1, 2)))]
        hands, board = Handshake(KINDS, random, twice=True), Board(owed, unsupported=missing)
        while not hands.is_open:
            kind = hands.query()
            if kind is None and not board.coming:
                kind = hands.repeat()
            for _ in range(random.choice((1, 2, 2)) if random.random() < 0.95 else 0):
                board.ask(kind)
            if board.coming:
                hands.heard(abs(board.coming.popleft()))
            assert hands.sendings < 1000
        leftover = Counter(hands.leftover())
        assert all(kind > 0 and count <= 2 * leftover[kind] for kind, count in Counter(board.coming).items())


def test_a_board_that_is_silent_for_a_while_loses_no_kind() -> None:
    """It owes something, is busy for long, and then answers everything: nothing is unsupported."""
    for seed in range(40):
        hands, board = Handshake(KINDS, Random(seed)), Board([1])
        board.ask(hands.query())
        hands.heard(abs(board.coming.popleft()))
        board.ask(hands.query())
        asked: Counter[int] = Counter()
        for _ in range(20):
            kind = hands.repeat()
            asked[kind] += 1
            board.ask(kind)
            assert hands.is_provable
        assert len(asked) >= 3
        assert shake(hands, board)
        assert hands.is_open


def test_a_kind_that_is_answered_late_is_supported() -> None:
    hands = Handshake(KINDS, Random(1))
    kind = hands.query()
    assert kind is not None
    asked = [kind]
    while asked.count(kind) <= MOST_SILENT:
        asked.append(hands.repeat())
    while asked[-1] == kind:
        asked.append(hands.repeat())
    assert hands.unsupported == set()  # the board may only be busy
    hands.heard(asked[-1])
    assert hands.unsupported == {kind}
    hands.heard(kind)
    assert hands.unsupported == set()


@over("seed", range(20))
def test_the_response_to_a_repeat_does_not_undo_what_was_answered(seed: int) -> None:
    hands = Handshake(KINDS, Random(seed))
    for _ in range(FIRST_LENGTH):
        if (kind := hands.query()) is not None:
            assert hands.repeat() == kind  # it was only late: both are answered, one after the other
            hands.heard(kind)
            hands.heard(kind)
    assert hands.is_open


def test_kinds_that_are_known_not_to_be_supported_are_never_asked_for() -> None:
    for unsupported in ((), (1,), (3,)):
        hands = Handshake(KINDS, Random(1), unsupported)
        assert hands.unsupported == set(unsupported)
        assert shake(hands, Board(unsupported=unsupported))
        assert hands.sendings == (THIRD_LENGTH if unsupported else FIRST_LENGTH)


def test_shorter_words_open_wrongly_and_the_proof_finds_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handshake, "FIRST_LENGTH", 2)
    monkeypatch.setattr(handshake, "SECOND_LENGTH", 2)
    # The questions of a comparison take what is owed, so that few openings would be wrong even with such words.
    monkeypatch.setattr(Opening, "_is_suspicious", False)
    counts = open_often(Owed(8, 8, "those of the handshake", 1.0), 50, 1)
    assert counts["wrong openings"] > 5
    assert counts["fooled"] > 0
