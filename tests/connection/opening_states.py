"""All that can happen while a connection is opened: owed responses, losses, second responses and repeats.

A perfect oracle stands for the board, as in `tests.proofs.reliability.model`. It owes responses to an earlier program,
answers the queries of the handshake behind them, and may lose each response, or each copy of one. Whenever a handshake
is open, whatever still comes must be known to it.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import product
from random import Random
from typing import TypeVar, cast

from servolink.connection import handshake
from servolink.connection.handshake import Handshake

T = TypeVar("T")

_LENGTHS = {"FIRST_LENGTH": 3, "SECOND_LENGTH": 4, "THIRD_LENGTH": 4, "MOST_SILENT": 2}
"""Words are shorter than those in use, so that all owed responses can be tried, and kinds are given up sooner."""


@dataclass(frozen=True, slots=True)
class OpeningCase:
    """What a board answers, and what it owes."""

    name: str
    kinds: int
    owed: int
    """Owed responses, at most: fewer than the shortest word has queries."""
    unsupported: int = 0
    copies: int = 1
    is_quiet: bool = False
    words: int = 4
    """How many first words are tried."""
    sendings: int = 6


SHORT = (
    OpeningCase("four kinds", 4, owed=2, words=1),
    OpeningCase("three kinds", 3, owed=2),
    OpeningCase("four kinds, one of them unanswered", 4, owed=1, unsupported=1, words=1, sendings=7),
    OpeningCase("two kinds, behind a silence", 2, owed=0, is_quiet=True),
    OpeningCase("one kind, behind a silence", 1, owed=0, is_quiet=True),
    OpeningCase("three kinds, answered twice", 3, owed=2, copies=2),
    OpeningCase("one kind, answered twice, behind a silence", 1, owed=0, copies=2, is_quiet=True),
)


class Words:
    """Draws words in place of `Random`, from a number that is easily compared and copied."""

    def __init__(self, first: int) -> None:
        """Begin with a number for each first word."""
        self.drawn = first

    def __repr__(self) -> str:
        """Return the number, which decides about all further words."""
        return str(self.drawn)

    def choice(self, kinds: Sequence[T]) -> T:
        """Return one of `kinds`."""
        self.drawn += 1
        return kinds[Random(self.drawn).randrange(len(kinds))]

    def choices(self, kinds: Sequence[T], *, k: int) -> list[T]:
        """Return `k` of `kinds`."""
        return [self.choice(kinds) for _ in range(k)]


@dataclass(slots=True)
class OpeningState:
    """One state of an opening; negative kinds are owed to an earlier program."""

    hands: Handshake[int]
    coming: tuple[int, ...]
    trace: tuple[str, ...] = ()

    def copy(self, event: str) -> OpeningState:
        """Return the same state, to be changed by `event`."""
        hands = copy(self.hands)
        for name, value in vars(self.hands).items():
            if isinstance(value, (list, set, Counter, Words)):
                setattr(hands, name, copy(value))
        return OpeningState(hands, self.coming, (*self.trace, event))

    def key(self) -> object:
        """Return what tells this state from others."""
        return self.coming, repr(vars(self.hands))


def walk(case: OpeningCase) -> tuple[int, list[str]]:
    """Return the number of states of a case, and what went wrong in them."""
    before = {name: getattr(handshake, name) for name in _LENGTHS}
    try:
        handshake.__dict__.update(_LENGTHS)
        return _walk(case)
    finally:
        handshake.__dict__.update(before)


def _walk(case: OpeningCase) -> tuple[int, list[str]]:
    kinds = range(1, case.kinds + 1)
    wrong: list[str] = []
    seen: set[object] = set()
    owed = [each for number in range(case.owed + 1) for each in product(kinds, repeat=number)]
    for word, each in product(range(case.words), owed):
        hands = Handshake(kinds, cast("Random", Words(1000 * word)), is_quiet=case.is_quiet, twice=case.copies == 2)
        coming = tuple(-kind for kind in each for _ in range(case.copies))
        waiting = deque([OpeningState(hands, coming, (f"owed {each}",))])
        while waiting:
            for following in _steps(case, waiting.popleft()):
                if following.hands.is_open:
                    if not _is_right(case, following):
                        wrong.append(f"{case.name}: {'; '.join(following.trace)}")
                elif (key := following.key()) not in seen and following.hands.sendings < case.sendings:
                    seen.add(key)
                    waiting.append(following)
    return len(seen), wrong


def _steps(case: OpeningCase, state: OpeningState) -> Iterator[OpeningState]:
    if not state.hands.is_provable:
        return
    for at, kind in enumerate(state.coming):  # those before it are lost
        after = state.copy(f"{kind} comes")
        after.coming = state.coming[at + 1 :]
        after.hands.heard(abs(kind))
        yield after
    after = state.copy("")
    query = after.hands.query()
    if query is None:
        query = after.hands.repeat()
    after.trace = (*state.trace, f"{query} is sent")
    if query > case.unsupported:
        after.coming = (*state.coming, *[query] * case.copies)
    yield after


def _is_right(case: OpeningCase, state: OpeningState) -> bool:
    """Return whether the handshake knows of everything that still comes."""
    leftover = Counter(state.hands.leftover())
    coming = Counter(state.coming)
    return all(kind > 0 and count <= case.copies * leftover[kind] for kind, count in coming.items())
