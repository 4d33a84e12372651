"""Counters of a connection: faults without effect on a request are counted, not raised."""

from __future__ import annotations

from collections import deque
from typing import Any

from servolink.protocol import FrameParser


class Stats:
    """Counters since the connection was opened."""

    def __init__(self) -> None:
        """Start at 0."""
        self.bytes_sent = 0
        """Bytes passed to the transport."""
        self.bytes_received = 0
        """Bytes from the transport, noise included."""
        self.frames_sent = 0
        """Frames of requests, commands and stops, repeats and fences included."""
        self.frames_received = 0
        """Intact frames, except hidden ones."""
        self.skipped: dict[str, int] = dict.fromkeys(FrameParser.REASONS, 0)
        """Bytes outside any frame, by reason (see `servolink.protocol.parser`)."""
        self.undecodable = 0
        """Intact frames whose content contradicts itself."""
        self.hidden = 0
        """Rejected frames inside another frame, such as in a caption."""
        self.unsolicited = 0
        """Frames without a request, other than events."""
        self.mismatched = 0
        """Responses about another servo, action, macro or table than requested."""
        self.repeated = 0
        """Second responses to a request, or responses that may be one, of a board that is known to answer twice."""
        self.late_copies = 0
        """Responses that came again, unchanged, after the end of their request."""
        self.late_responses = 0
        """Responses after the end of their request, not mistaken for the response to a later request."""
        self.timeouts = 0
        """Sendings not answered in time."""
        self.retries = 0
        """Requests sent again after a missing response."""
        self.reopenings = 0
        """Openings because of a stray response."""
        self.reconnects = 0
        """Connections after a loss."""
        self.fences = 0
        """Queries sent to prove the end of everything older."""
        self.events_received = 0
        """Button events from the board."""
        self.events_dropped = 0
        """Button events lost because their reader was too slow."""
        self.round_trips: deque[float] = deque(maxlen=4096)
        """The latest 4096 times from request to response, in seconds."""

    @property
    def noise(self) -> int:
        """Bytes outside any frame, except the zeros after a frame in the reports of a HID board."""
        return sum(self.skipped.values()) - self.skipped.get(FrameParser.PADDING, 0)

    def round_trip(self, percent: float) -> float | None:
        """Return a percentile (0..100) of the latest round trips in seconds, None before the first."""
        ordered = sorted(self.round_trips)
        return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100))] if ordered else None

    def __repr__(self) -> str:
        """Return the counters other than 0, with a summary of the round trips."""
        counters = self.as_dict()
        skipped, _ = counters.pop("skipped"), counters.pop("round_trip_ms")
        texts = [f"{name}={value}" for name, value in counters.items() if value]
        texts += [f"skipped={skipped}"] if skipped else []
        median, late = self.round_trip(50), self.round_trip(95)
        if median is not None and late is not None:
            count = len(self.round_trips)
            texts.append(f"round_trips=<{count}, median {median * 1000:.3g} ms, 95 % within {late * 1000:.3g} ms>")
        return f"Stats({', '.join(texts)})"

    def as_dict(self) -> dict[str, Any]:
        """Return all counters as plain numbers, and percentiles of the round trips in milliseconds."""
        counters = {name: value for name, value in vars(self).items() if isinstance(value, int)}
        percentiles = {f"p{percent}": self.round_trip(percent) for percent in (50, 90, 99)}
        return {
            **counters,
            "skipped": {reason: count for reason, count in self.skipped.items() if count},
            "round_trip_ms": {name: value and round(value * 1000, 3) for name, value in percentiles.items()},
        }
