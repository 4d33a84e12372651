"""Clocks of boards, compared by echoes: names one moment in the time of each board."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable

from msgspec import Struct


class Bounds(Struct):
    """Bounds of the difference between a clock and the clock here, in seconds."""

    low: float = -math.inf
    high: float = math.inf

    def narrow(self, low: float, high: float) -> None:
        """Take further bounds into account."""
        self.low, self.high = max(self.low, low), min(self.high, high)

    @property
    def middle(self) -> float:
        """Difference that is wrong by half the distance of the bounds at most."""
        return (self.low + self.high) / 2


class BoardClocks:
    """Differences between the clocks of boards and the clock here.

    An echo was received after it was sent and before its answer came, whatever the network did in between. Boards of
    one machine have one clock, so that the quickest ways to and from any of them bound it. Two machines of the same
    name contradict each other: then each board counts alone.
    """

    def __init__(self, host_of: Callable[[str], str]) -> None:
        """Start without echoes; `host_of` returns the name of the machine of a board."""
        self.delays: defaultdict[str, float] = defaultdict(lambda: math.inf)
        """Half the shortest round trip to each board, in seconds; infinite without an echo."""
        self._host_of = host_of
        self._boards: defaultdict[str, Bounds] = defaultdict(Bounds)
        self._hosts: defaultdict[str, Bounds] = defaultdict(Bounds)

    def heard(self, board: str, sent: float, received: float, came: float) -> None:
        """Take an echo: sent and answered at `sent` and `came` by the clock here, received by the clock of `board`."""
        self.delays[board] = min(self.delays[board], (came - sent) / 2)
        for bounds in (self._boards[board], self._hosts[self._host_of(board)]):
            bounds.narrow(received - came, received - sent)

    def moments(self, at: float) -> dict[str, float]:
        """Return the moment `at` of the clock here, by the clock of each board that has sent an echo."""
        found = {}
        for board, own in self._boards.items():
            shared = self._hosts[self._host_of(board)]
            found[board] = at + (shared if shared.low <= shared.high else own).middle
        return found
