"""Taps: who hears every byte of a connection, and what became of its requests, without being part of it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from servolink.protocol.packet import Packet, Query

T = TypeVar("T")


class Tap:
    """Hears what passes. A kind of tap overrides what it wants to hear; no method may block, or raise."""

    def sent(self, data: bytes) -> None:
        """Hear bytes that are about to be sent to the board."""

    def received(self, data: bytes) -> None:
        """Hear bytes that have come from the board."""

    def ended(self, packet: Packet, outcome: object, seconds: float) -> None:
        """Hear of a request that is over, but not of a query with a response.

        `outcome` is its response, True for one that the board does not answer, or the exception that its caller gets.
        """


class Taps:
    """The taps of one board, across all connections to it."""

    def __init__(self) -> None:
        """Start without any."""
        self.heard_by: tuple[Tap, ...] = ()
        """Empty as long as nobody listens: callers look at it themselves, and then nothing more is done."""

    def add(self, tap: Tap) -> Callable[[], None]:
        """Begin to tell `tap`. Return what ends that, and may be called again."""
        self.heard_by = (*self.heard_by, tap)

        def end() -> None:
            self.heard_by = tuple(each for each in self.heard_by if each is not tap)

        return end

    def sent(self, data: bytes) -> None:
        """Pass on bytes that are about to be sent."""
        for tap in self.heard_by:
            tap.sent(data)

    def received(self, data: bytes) -> None:
        """Pass on bytes that have come."""
        for tap in self.heard_by:
            tap.received(data)

    async def follow(self, packet: Packet, asking: Coroutine[Any, Any, T]) -> T:
        """Return what `asking` returns, and pass on what became of it."""
        now = asyncio.get_running_loop().time
        begun = now()
        outcome: object = None
        try:
            outcome = answer = await asking
        except BaseException as error:
            outcome = error
            raise
        else:
            return answer
        finally:
            if not isinstance(packet, Query) or isinstance(outcome, BaseException):
                for tap in self.heard_by:
                    tap.ended(packet, outcome, now() - begun)
