"""Conversion of an event loop's monotonic clock to wall time without steps back."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime

BILLION = 1_000_000_000


class Clock:
    """Wall time at the start of a recording, plus the monotonic time since."""

    def __init__(
        self,
        now: Callable[[], float] = time.monotonic,
        *,
        wall: int | None = None,
        monotonic: float | None = None,
    ) -> None:
        """Start now, or as another clock started at `monotonic` seconds, `wall` nanoseconds since 1970."""
        self.now = now
        """Function that returns the monotonic time in seconds."""
        self.monotonic = now() if monotonic is None else monotonic
        """Monotonic time of the start, in seconds."""
        self._wall = time.time_ns() if wall is None else wall

    def wall(self, seconds: float) -> int:
        """Return monotonic time as nanoseconds since 1970."""
        return self._wall + round((seconds - self.monotonic) * BILLION)

    def iso(self, seconds: float) -> str:
        """Return monotonic time as text: ISO 8601, UTC."""
        return datetime.fromtimestamp(self.wall(seconds) // BILLION, UTC).isoformat().replace("+00:00", "Z")

    @property
    def started(self) -> str:
        """Start in ISO 8601 format, UTC."""
        return self.iso(self.monotonic)
