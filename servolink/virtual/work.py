"""The requests of a board: it works on one after the other, each for a time, and others wait meanwhile."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple, Protocol

from servolink.protocol.frame import OVERHEAD


class Requester(Protocol):
    """The host that sent a request, as far as it matters here."""

    waiting: int
    """The bytes of its requests that wait."""

    def respond(self, packet_id: int, content: bytes, now: float) -> tuple[bytes | None, float]:
        """Carry out a request; return the frame to send, if there is one, and the seconds of work before that."""
        ...

    def finish(self, frame: bytes) -> None:
        """Send the response to the request that was carried out last."""


class Received(NamedTuple):
    """A request as it was received."""

    host: Requester
    packet_id: int
    content: bytes

    @property
    def size(self) -> int:
        """The bytes of its frame."""
        return len(self.content) + OVERHEAD


class WorkQueue:
    """The request that a board works on, and at most `most` that wait."""

    def __init__(self, most: int) -> None:
        """Start without work."""
        self._most = most
        self._waiting: deque[Received] = deque()
        self._response: tuple[Requester, bytes] | None = None
        self.received = 0
        """How many requests were received, also those that were lost."""
        self.due: float | None = None
        """When the work on a request ends; None if there is none."""

    def take(self, request: Received, now: float) -> None:
        """Work on a request, now or when those before it are finished; it is lost if too many wait."""
        self.received += 1
        if self.due is None and not self._waiting:  # a host may ask again at once, while others still wait
            self._begin(request, now)
        elif len(self._waiting) < self._most:
            self._waiting.append(request)
            request.host.waiting += request.size

    def end(self, now: float) -> None:
        """End the work on a request, and begin that on the next."""
        response, self._response, self.due = self._response, None, None
        if response is not None:
            host, frame = response
            host.finish(frame)
        while self._waiting and self.due is None:
            request = self._waiting.popleft()
            request.host.waiting -= request.size
            self._begin(request, now)

    def clear(self) -> None:
        """Forget everything: the work has no response, and nothing waits."""
        for request in self._waiting:
            request.host.waiting = 0
        self._waiting.clear()
        self._response = self.due = None

    def _begin(self, request: Received, now: float) -> None:
        frame, seconds = request.host.respond(request.packet_id, request.content, now)
        if seconds:
            self.due = now + seconds
            self._response = None if frame is None else (request.host, frame)
        elif frame is not None:
            request.host.finish(frame)
