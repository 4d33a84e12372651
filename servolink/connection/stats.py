"""What the link has seen: counters instead of exceptions in callbacks."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from servolink.protocol.parser import REASONS


@dataclass(slots=True)
class Stats:
    """Counters since the connection was opened."""

    bytes_sent: int = 0
    bytes_received: int = 0
    frames_sent: int = 0
    frames_received: int = 0
    skipped: dict[str, int] = field(default_factory=lambda: dict.fromkeys(REASONS, 0))
    """Bytes that were part of no frame, by reason (see `servolink.protocol.parser`)."""
    undecodable: int = 0
    """Intact frames whose content contradicts itself."""
    hidden: int = 0
    """Frames that were inside another one, as in a caption, and were not believed."""
    unsolicited: int = 0
    """Frames that nobody asked for."""
    mismatched: int = 0
    """Answers about another servo, action, macro or table than the one asked for."""
    late_responses: int = 0
    """Answers that came after their request had ended, and were kept from the next one."""
    rescued: int = 0
    """Late answers that came while the same query was about to be repeated, and were used."""
    timeouts: int = 0
    """Sendings that were not answered in time."""
    retries: int = 0
    """Queries sent again."""
    reconnects: int = 0
    fences: int = 0
    """Queries sent to prove that no late answer is still to come."""
    events_received: int = 0
    events_dropped: int = 0
    """Button events lost because their reader was too slow."""
    round_trips: deque[float] = field(default_factory=lambda: deque(maxlen=4096))
    """The latest times from sending to answer, seconds."""

    def round_trip(self, percent: float) -> float | None:
        """Return the time, in seconds, that `percent` (0..100) of the latest answers kept; None before the first."""
        ordered = sorted(self.round_trips)
        return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100))] if ordered else None

    def as_dict(self) -> dict[str, Any]:
        """Return all of it as plain numbers, round trips as percentiles in milliseconds."""
        counters = {
            name: getattr(self, name) for name in self.__dataclass_fields__ if name not in ("skipped", "round_trips")
        }
        percentiles = {f"p{percent}": self.round_trip(percent) for percent in (50, 90, 99)}
        return {
            **counters,
            "skipped": {reason: count for reason, count in self.skipped.items() if count},
            "round_trip_ms": {name: value and round(value * 1000, 3) for name, value in percentiles.items()},
        }
