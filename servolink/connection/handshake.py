"""Handshake: queries whose responses cannot come from queries of earlier programs.

A program that was killed, or an earlier connection, may have left questions with the board, and their responses look
like responses to ours. So a connection begins with a random word of cheap queries, one at a time. The board answers in
order, so whatever it owes comes first. The last kind of query occurs nowhere else in the word, so the word can be
complete early only if a whole copy of it was owed: never for fewer responses than the word has queries, and rarely for
more (`docs/design/opening.md` has the figures).

A board that may answer twice gets words without equal neighbours, and equal responses in a row count once.

This file knows no clock, no event loop and no bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Iterable, Sequence
from random import Random
from typing import Generic, TypeVar

K = TypeVar("K", bound=Hashable)

FIRST_LENGTH, SECOND_LENGTH, THIRD_LENGTH = 6, 12, 16
"""Queries in the word: at first, once something was owed, and if it is drawn from fewer kinds."""
MOST_SILENT = 4
"""Queries of a kind in a row without a response, with later queries answered, that show that it is not supported."""
ANOTHER_AFTER = 2
"""Silent queries of a kind after which others are sent in turn: their responses show that the board is not busy."""
LEAST_KINDS = 3
"""With fewer kinds a word says little: earlier programs, which had the same few kinds, may have sent the same."""
_MANY_KINDS = 4  # with fewer, words are longer


class Handshake(Generic[K]):
    """State of one handshake."""

    def __init__(
        self,
        kinds: Sequence[K],
        random: Random,
        unsupported: Iterable[K] = (),
        *,
        spare: Sequence[K] = (),
        is_quiet: bool = False,
        twice: bool = False,
    ) -> None:
        """Draw a word from `kinds`, which stand for queries with different responses.

        Kinds that are `unsupported` are not used. `spare` kinds are in no word; their responses show that the board is
        not busy. `is_quiet`: the line was quiet for so long that nothing is owed, so that one kind is enough. `twice`:
        the board may answer each query twice.
        """
        self._kinds = list(kinds)
        self._spare = list(spare)
        self._random = random
        self.is_quiet = is_quiet
        """Whether a silence before the handshake says that nothing is owed, not the word."""
        self._twice = twice
        self._silent: Counter[K] = Counter()  # times in a row
        self.unsupported = set(unsupported)
        """Kinds without a response so far; a late response removes the kind."""
        self._unanswered: Counter[K] = Counter()  # sendings
        self._on_its_way: K | None = None
        self._latest: K | None = None  # kind of the latest response
        self._heard: set[K] = set()
        self._sent: list[K] = []
        self._word: list[K] = []
        self._matched = 0
        self._draw(FIRST_LENGTH)

    @property
    def is_open(self) -> bool:
        """Whether the whole word was answered, so that all further responses are to this connection."""
        return bool(self._word) and self._matched == len(self._word)

    @property
    def is_provable(self) -> bool:
        """Whether the board answers enough kinds; it need not answer more than one after a long silence."""
        return len(self.kinds) >= (1 if self.is_quiet else LEAST_KINDS)

    @property
    def kinds(self) -> list[K]:
        """Kinds that the board is not known to leave unanswered."""
        return [kind for kind in self._kinds if kind not in self.unsupported]

    @property
    def sendings(self) -> int:
        """How many queries were sent so far."""
        return len(self._sent)

    def query(self) -> K | None:
        """Return the kind to send now; None while a query is under way, and after the last query.

        With several on their way, each response would cause another query, and they could go round for ever.
        """
        if self.is_open or self._on_its_way is not None:
            return None
        return self._send(self._word[self._matched])

    def repeat(self) -> K:
        """Return the kind to send now, after the latest query was not answered in time."""
        kind = self._word[self._matched]
        self._silent[kind if self._on_its_way is None else self._on_its_way] += 1
        if self._silent[kind] % ANOTHER_AFTER:
            return self._send(kind)
        kinds = [kind, *self._spare, *(each for each in self.kinds if each != kind)]
        return self._send(min(kinds, key=lambda each: (self._silent[each], each not in self._heard)))

    def heard(self, kind: K) -> None:
        """Take a response to a query of `kind`, or to any other request, into account."""
        is_second = self._twice and kind == self._latest
        self._latest = kind
        if self.is_open or not self._word:
            return
        expected = self._word[self._matched]
        self._silent[kind] = 0
        self._heard.add(kind)
        self.unsupported.discard(kind)
        is_latest = kind == self._on_its_way
        if is_latest:
            self._on_its_way = None
        is_answer = self._unanswered[kind] > 0  # or apparently: a slow board answers both of two sendings
        self._unanswered[kind] -= is_answer
        # Before the last query is sent, a response to the last query belongs to another program.
        if kind == expected and not is_second and (kind != self._word[-1] or kind in self._sent):
            self._matched += 1
        elif is_latest and self._silent[expected] >= MOST_SILENT:
            self.unsupported.add(expected)
            self._draw(SECOND_LENGTH)
            self._fall_back(kind)
        elif not is_second and (
            not is_answer or not (is_latest or len(self._word) > FIRST_LENGTH or self._was_just_matched(kind))
        ):
            if len(self._word) == FIRST_LENGTH:
                self._draw(SECOND_LENGTH)
            self._fall_back(kind)
        # Otherwise it was sent again, or between others: it proves nothing, and undoes nothing. Passing over it makes
        # it likelier that owed responses complete a word, so the first word, the shortest one, passes over repeats of
        # the query answered last only.

    def leftover(self) -> list[K]:
        """Return the kinds with outstanding responses after the whole word. Everything older is over."""
        return self._sent[self._sent.index(self._word[-1]) + (not self._twice) :]

    def _was_just_matched(self, kind: K) -> bool:
        return self._matched > 0 and self._word[self._matched - 1] == kind

    def _send(self, kind: K) -> K:
        self._on_its_way = kind
        self._unanswered[kind] += 1
        self._sent.append(kind)
        return kind

    def _draw(self, length: int) -> None:
        """Draw a word from the answered kinds: fewer kinds need a longer word, unless nothing is owed."""
        self._word, self._matched = [], 0
        if not (kinds := self.kinds):
            return
        last = self._random.choice(kinds)
        others = [kind for kind in kinds if kind != last]
        if not others:
            length = 1
        elif not self.is_quiet and len(kinds) < _MANY_KINDS:
            length = THIRD_LENGTH
        word = [*(self._unequal_neighbours(others, length - 1) if self._twice else []), last]
        if not self._twice:
            word[:0] = self._random.choices(others, k=length - 1) if others else []
        self._word = word

    def _unequal_neighbours(self, kinds: Sequence[K], length: int) -> list[K]:
        """Return `length` of `kinds` without equal neighbours; a single kind gives a single query."""
        word: list[K] = []
        while len(word) < length and (following := [kind for kind in kinds if not word or kind != word[-1]]):
            word.append(self._random.choice(following))
        return word

    def _fall_back(self, kind: K) -> None:
        """Keep the longest prefix of the word among the suffixes of the responses so far."""
        kinds = [*self._word[: self._matched], kind]
        lengths = range(len(kinds), -1, -1)
        self._matched = next(length for length in lengths if kinds[len(kinds) - length :] == self._word[:length])
