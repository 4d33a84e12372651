"""Handshake: queries whose responses cannot come from queries of earlier programs.

A program that was killed, or an earlier connection, may have left questions with the board, and their responses look
like responses to ours. So a connection begins with a random word of cheap queries, one at a time. The board answers in
order, so whatever it owes comes first. The last kind of query occurs nowhere else in the word, so the word can be
complete early only if a whole copy of it was owed: never for fewer responses than the word has queries, and rarely for
more (`docs/design/matching.md` has the figures).

This file knows no clock, no event loop and no bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from random import Random

FIRST_LENGTH, SECOND_LENGTH, THIRD_LENGTH = 6, 12, 16
"""Queries in the word: at first, once something was owed, and if it is drawn from fewer kinds."""
MOST_SILENT = 4
"""A kind that is not answered so many times in a row, but what was asked after it is, is not supported."""
ANOTHER_AFTER = 2
"""After so many silent queries of a kind the others are sent in turn: their responses show that it is not busy."""


class Handshake:
    """State of one handshake."""

    def __init__(self, kinds: Sequence[int], random: Random, unsupported: Iterable[int] = ()) -> None:
        """Draw a word from `kinds`, the packet ids of the queries to use.

        If that leaves two of them, those that are `unsupported` are not used.
        """
        self._kinds = list(kinds)
        self._random = random
        self._silent: Counter[int] = Counter()  # times in a row
        self.unsupported = set(unsupported)
        """Kinds without a response so far; a late response removes the kind."""
        if not self.is_provable:  # to be found out again
            self.unsupported.clear()
        self._unanswered: Counter[int] = Counter()  # sendings
        self._on_its_way: int | None = None
        self._sent: list[int] = []
        self._draw(FIRST_LENGTH)

    @property
    def is_open(self) -> bool:
        """Whether the whole word was answered, so that all further responses are to this connection."""
        return self._matched == len(self._word)

    @property
    def is_provable(self) -> bool:
        """Whether the board answers enough kinds: a single kind could always answer an earlier query."""
        return len(self.unsupported) < len(self._kinds) - 1

    @property
    def sendings(self) -> int:
        """How many queries were sent so far."""
        return len(self._sent)

    def query(self) -> int | None:
        """Return the kind to send now; None while a query is under way, and after the last query.

        With several on their way, each response would cause another query, and they could go round for ever.
        """
        if self.is_open or self._on_its_way is not None:
            return None
        return self._send(self._word[self._matched])

    def repeat(self) -> int:
        """Return the kind to send now, after the latest query was not answered in time."""
        kind = self._word[self._matched]
        self._silent[kind if self._on_its_way is None else self._on_its_way] += 1
        if self._silent[kind] % ANOTHER_AFTER:
            return self._send(kind)
        kinds = [kind, *(each for each in self._kinds if each != kind and each not in self.unsupported)]
        return self._send(min(kinds, key=self._silent.__getitem__))

    def heard(self, kind: int) -> None:
        """Take a response to a query of `kind`, or to any other request, into account."""
        if self.is_open:
            return
        expected = self._word[self._matched]
        self._silent[kind] = 0
        self.unsupported.discard(kind)
        is_latest = kind == self._on_its_way
        if is_latest:
            self._on_its_way = None
        is_answer = self._unanswered[kind] > 0  # or apparently: a slow board answers both of two sendings
        self._unanswered[kind] -= is_answer
        # Before the last query is sent, a response to the last query belongs to another program.
        if kind == expected and (kind != self._word[-1] or kind in self._sent):
            self._matched += 1
        elif is_latest and self._silent[expected] >= MOST_SILENT:
            self.unsupported.add(expected)
            self._draw(SECOND_LENGTH)
        elif not is_answer or not (is_latest or len(self._word) > FIRST_LENGTH or self._was_just_matched(kind)):
            if len(self._word) == FIRST_LENGTH:
                self._draw(SECOND_LENGTH)
            self._fall_back(kind)
        # Otherwise it was sent again, or between others: it proves nothing, and undoes nothing. Passing over it makes
        # it likelier that owed responses complete a word, so the first word, the shortest one, passes over repeats of
        # the query answered last only.

    def leftover(self) -> list[int]:
        """Return the kinds with outstanding responses after the whole word. Everything older is over."""
        return self._sent[self._sent.index(self._word[-1]) + 1 :]

    def _was_just_matched(self, kind: int) -> bool:
        return self._matched > 0 and self._word[self._matched - 1] == kind

    def _send(self, kind: int) -> int:
        self._on_its_way = kind
        self._unanswered[kind] += 1
        self._sent.append(kind)
        return kind

    def _draw(self, length: int) -> None:
        """Draw a word from the answered kinds: fewer kinds need a longer word."""
        kinds = [kind for kind in self._kinds if kind not in self.unsupported]
        last = self._random.choice(kinds)
        others = [kind for kind in kinds if kind != last] or [last]
        length = length if len(kinds) == len(self._kinds) else THIRD_LENGTH
        self._word = [*self._random.choices(others, k=length - 1), last]
        self._matched = 0

    def _fall_back(self, kind: int) -> None:
        """Keep the longest prefix of the word among the suffixes of the responses so far."""
        kinds = [*self._word[: self._matched], kind]
        lengths = range(len(kinds), -1, -1)
        self._matched = next(length for length in lengths if kinds[len(kinds) - length :] == self._word[:length])
