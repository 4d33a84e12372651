"""Matching of responses with requests, as far as a recording allows, and the response times."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from math import exp, log
from types import MappingProxyType
from typing import Any, NamedTuple

from servolink.protocol import PACKETS
from servolink.recorder.channels import PacketSeen

_PATIENCE = 3.0  # seconds; a later response is matched with a later request
_MOST = 1024  # waiting requests of a kind
_STEP = 0.01  # of the logarithm: times are counted to 1 %
_SHORTEST = 1e-6  # seconds


class RoundTrip(NamedTuple):
    """Request, response, or both together."""

    seconds: float
    """Time of the request, or of a response without a request."""
    packet: str
    """Name of the request; empty without a request."""
    fields: dict[str, Any]
    response: str | None = None
    """Name of the response; None without a response."""
    answer: Mapping[str, Any] = MappingProxyType({})
    took: float | None = None


class RoundTrips:
    """Matches packets in order. Boards answer in order, so a response belongs to the oldest request."""

    def __init__(self) -> None:
        self._waiting: dict[str, deque[tuple[float, PacketSeen]]] = {}  # by the name of the response

    def take(self, seconds: float, message: PacketSeen) -> Iterator[RoundTrip]:
        """Take the next packet, and yield all exchanges completed by now."""
        if message.direction == "sent":
            response = response_name(message.packet)
            if response is None:
                yield RoundTrip(seconds, message.packet, message.fields)
                return
            waiting = self._waiting.setdefault(response, deque())
            if len(waiting) == _MOST:
                yield _unanswered(*waiting.popleft())
            waiting.append((seconds, message))
            return
        waiting = self._waiting.get(message.packet, deque())
        while waiting:
            sent_at, request = waiting.popleft()
            if seconds - sent_at <= _PATIENCE:
                yield RoundTrip(
                    sent_at, request.packet, request.fields, message.packet, message.fields, seconds - sent_at
                )
                return
            yield _unanswered(sent_at, request)
        yield RoundTrip(seconds, "", {}, message.packet, message.fields)

    def finish(self) -> list[RoundTrip]:
        """Return all unanswered requests, in order."""
        left = sorted((each for waiting in self._waiting.values() for each in waiting), key=lambda each: each[0])
        self._waiting.clear()
        return [_unanswered(*each) for each in left]


def response_name(packet: str) -> str | None:
    """Return the name of the response to a packet; None for a packet without a response, or an unknown packet."""
    name = f"{packet.removesuffix('Request')}Response"
    return name if packet.endswith("Request") and name in PACKETS.by_name else None


def _unanswered(seconds: float, request: PacketSeen) -> RoundTrip:
    return RoundTrip(seconds, request.packet, request.fields)


class Times:
    """Durations counted in bounded memory, with percentiles to 1 %."""

    def __init__(self) -> None:
        self.count = 0
        self.longest = 0.0
        self._counts: Counter[int] = Counter()

    def add(self, seconds: float) -> None:
        """Add a duration in seconds."""
        self.count += 1
        self.longest = max(self.longest, seconds)
        self._counts[round(log(max(seconds, _SHORTEST)) / _STEP)] += 1

    def percentile(self, percent: float) -> float | None:
        """Return a percentile in seconds; None without durations."""
        left = self.count * percent / 100
        for place in sorted(self._counts):
            left -= self._counts[place]
            if left <= 0:
                return min(exp(place * _STEP), self.longest)
        return None
