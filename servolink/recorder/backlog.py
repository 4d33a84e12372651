"""Backlog: messages not yet written, in bounded memory."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from typing import NamedTuple

from servolink.recorder.channels import TOPICS, Message, ProblemFound, ServosRead, Wire
from servolink.support import MIB

TELEMETRY_BYTES = 4 * MIB
"""Bound in bytes at which readings of servos are dropped: new readings follow anyway."""
MOST_BYTES = 32 * MIB
"""Bound in bytes at which all messages are dropped, wire bytes too."""

_OVERHEAD = 200  # approximate bytes of a message in memory


class Timed(NamedTuple):
    """Message with its time: seconds on the monotonic clock."""

    seconds: float
    message: Message


class Backlog:
    """Queue from the listening thread to the writing thread, without any waiting on either side.

    Each counter is changed by a single thread only, and a deque needs no lock.
    """

    def __init__(
        self, telemetry_bytes: int = TELEMETRY_BYTES, most_bytes: int = MOST_BYTES, *, why: str = "the disk is too slow"
    ) -> None:
        """Start empty. The bounds are on the sum of message sizes; `why` is the reason given for missing messages."""
        self._why = why
        self._telemetry_bytes = telemetry_bytes
        self._most_bytes = most_bytes
        self._waiting: deque[tuple[float, Message, int]] = deque()
        self._put = self._taken = 0  # bytes so far
        self._is_late = self._is_full = False  # dropping telemetry, or everything, until half of the bound is left
        self._dropped: Counter[str] = Counter()  # counts by topic since the last report
        self.dropped = 0
        """Number of messages dropped so far."""

    @property
    def size(self) -> int:
        """Approximate bytes of all waiting messages."""
        return self._put - self._taken

    def put(self, seconds: float, message: Message) -> None:
        """Append a message, or drop the message if the backlog is full."""
        if self._put - self._taken < self._telemetry_bytes and not self._is_late and not self._dropped:
            # Most calls, for each piece of bytes: few steps, because the recorded program pays for the time.
            size = _OVERHEAD + len(message.data) if type(message) is Wire else size_of(message)
            self._put += size
            self._waiting.append((seconds, message, size))
        else:
            self._put_late(seconds, message)

    def _put_late(self, seconds: float, message: Message) -> None:
        size = self.size
        self._is_late = size >= (self._telemetry_bytes // 2 if self._is_late else self._telemetry_bytes)
        self._is_full = size >= (self._most_bytes // 2 if self._is_full else self._most_bytes)
        if self._is_full or (self._is_late and isinstance(message, ServosRead)):
            self._dropped[TOPICS[type(message)]] += 1
            self.dropped += 1
            return
        if self._dropped and (not self._is_late or "/wire" in self._dropped):
            self.tell_dropped(seconds)
        self._append(seconds, message)

    def take(self) -> Timed | None:
        """Remove and return the oldest message; None for an empty backlog."""
        if not self._waiting:
            return None
        seconds, message, size = self._waiting.popleft()
        self._taken += size
        return Timed(seconds, message)

    def take_some(self, most: int) -> Iterator[tuple[float, Message]]:
        """Remove up to `most` of the oldest messages, and yield each with its time in seconds."""
        waiting, taken = self._waiting, 0
        for _ in range(min(most, len(waiting))):
            seconds, message, size = waiting.popleft()
            taken += size
            yield seconds, message
        self._taken += taken

    def tell_dropped(self, seconds: float) -> None:
        """Append the number of missing messages, if any."""
        dropped, self._dropped = self._dropped, Counter()
        for topic, count in dropped.items():
            text = f"{_MISSING.get(topic, 'messages')} are missing here: {self._why}"
            self._append(seconds, ProblemFound("dropped", text, channel=topic, count=count))

    def _append(self, seconds: float, message: Message) -> None:
        size = size_of(message)
        self._put += size
        self._waiting.append((seconds, message, size))


_MISSING = {"/wire": "bytes of the line, and the packets in them,", "/servos": "readings of the servos"}


def size_of(message: Message) -> int:
    """Return the approximate bytes of a message in memory."""
    if isinstance(message, Wire):
        return _OVERHEAD + len(message.data)
    if isinstance(message, ServosRead):
        return _OVERHEAD * (1 + len(message.servos))
    return 2 * _OVERHEAD
