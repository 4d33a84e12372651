"""Which response belongs to which request, as far as a recording shows it, and how long it took."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from math import exp, log
from types import MappingProxyType
from typing import Any, NamedTuple

from servolink.protocol.codec import PACKETS_BY_NAME
from servolink.recorder.channels import PacketSeen

_PATIENCE = 3.0  # seconds; a response that takes longer is taken for that to a later request
_MOST = 1024  # requests of a kind that may wait
_STEP = 0.01  # of the logarithm: times are counted to 1 %
_SHORTEST = 1e-6  # seconds


class RoundTrip(NamedTuple):
    """A request, its response or both."""

    seconds: float
    """Time of the request, or of a response without a request."""
    packet: str
    """Empty if nobody asked."""
    fields: dict[str, Any]
    response: str | None = None
    """None if none came."""
    answer: Mapping[str, Any] = MappingProxyType({})
    took: float | None = None


class RoundTrips:
    """Matches packets in their order. Boards answer in order, so the oldest request is the one that is answered."""

    def __init__(self) -> None:
        """Start without requests under way."""
        self._waiting: dict[str, deque[tuple[float, PacketSeen]]] = {}  # by the response

    def take(self, seconds: float, message: PacketSeen) -> Iterator[RoundTrip]:
        """Take the next packet; yield what is over by now."""
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
        """Return what was never answered, in order."""
        left = sorted((each for waiting in self._waiting.values() for each in waiting), key=lambda each: each[0])
        self._waiting.clear()
        return [_unanswered(*each) for each in left]


def response_name(packet: str) -> str | None:
    """Return the name of the response to a packet; None if boards do not answer it, or it is unknown."""
    name = f"{packet.removesuffix('Request')}Response"
    return name if packet.endswith("Request") and name in PACKETS_BY_NAME else None


def _unanswered(seconds: float, request: PacketSeen) -> RoundTrip:
    return RoundTrip(seconds, request.packet, request.fields)


class Times:
    """How long something took, each time: percentiles to 1 %, in bounded memory."""

    def __init__(self) -> None:
        """Start without any."""
        self.count = 0
        self.longest = 0.0
        self._counts: Counter[int] = Counter()

    def add(self, seconds: float) -> None:
        """Add one time."""
        self.count += 1
        self.longest = max(self.longest, seconds)
        self._counts[round(log(max(seconds, _SHORTEST)) / _STEP)] += 1

    def percentile(self, percent: float) -> float | None:
        """Return a percentile in seconds; None without any time."""
        left = self.count * percent / 100
        for place in sorted(self._counts):
            left -= self._counts[place]
            if left <= 0:
                return min(exp(place * _STEP), self.longest)
        return None
