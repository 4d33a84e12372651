"""Window: how many requests may be under way, and how long their responses may take on the line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from servolink.connection.climb import DepthClimb
from servolink.protocol.packet import Command, Query, Request

MOST_OWED = 0.045
"""Seconds of the line for responses that are owed. A stop comes to the board within 50 ms: fences need some of them."""
MOST_OWED_IN_BULK = 0.09
"""The same during an import, where it is 100 ms."""

_MEMORY = 64  # responses after which older ones count half in the pace of the line
_UNMEASURED = 2  # requests at once until the pace of the line is known


class Window:
    """The room on a line: the depth that was found to pay for queries, another one as soon as something is changed.

    A board that queues queries may still lose what comes while it writes its memory. So their depths are found apart,
    and while a change is under way, that for changes holds for queries too.
    """

    def __init__(
        self, depth: int = 1, write_depth: int = 1, *, learn: bool = True, bytes_per_second: float = 0.0
    ) -> None:
        """Allow at most `depth` requests, `write_depth` with a change among them.

        Without `learn` all of that from the first request on, however long their responses take. The line is known to
        carry `bytes_per_second`, or more.
        """
        self.queries = DepthClimb(depth)
        self.writes = DepthClimb(write_depth)
        self.learns = learn and max(depth, write_depth) > 1
        """Whether there is anything to learn."""
        if not learn:
            self.queries.depth, self.writes.depth = depth, write_depth
        self.pace = self._known_pace = bytes_per_second
        """Bytes per second of the line, 0 if they are unknown."""
        self._bytes = self._seconds = 0.0  # of responses that came one behind the other
        self._responses = 0
        self._bulks = 0

    @property
    def depth(self) -> int:
        """How many requests may be under way now, at most."""
        return max(self.queries.depth, self.writes.depth)

    @contextmanager
    def bulk(self) -> Iterator[None]:
        """Allow the responses that are owed to take longer, and try the bounds at once, while much is transferred."""
        self._bulks += 1
        if self.learns:
            self.queries.leap()
            self.writes.leap()
        try:
            yield
        finally:
            self._bulks -= 1

    def climb(self, packet: Request[Any] | Command, writes: int) -> DepthClimb:
        """Return whose depth holds for `packet` beside `writes` changes."""
        return self.queries if not writes and isinstance(packet, Query) else self.writes

    def fits(self, owed: int, under_way: int) -> bool:
        """Return whether a stop may wait for `owed` bytes: those of `under_way` requests and of one more."""
        pace = self.pace
        return owed <= pace * (MOST_OWED_IN_BULK if self._bulks else MOST_OWED) if pace else under_way < _UNMEASURED

    def heard(self, size: int, seconds: float) -> None:
        """Count a response of `size` bytes that came `seconds` behind another one, when it was already due."""
        self._responses += 1
        if self._responses == _MEMORY:
            self._responses, self._bytes, self._seconds = _MEMORY // 2, self._bytes / 2, self._seconds / 2
        self._bytes += size
        self._seconds += seconds
        self.pace = max(self._known_pace, self._bytes / max(self._seconds, 1e-9))
