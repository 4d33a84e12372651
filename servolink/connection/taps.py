"""Listeners to a connection that are no part of it: taps for its bytes and requests, and the log of its frames."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from servolink.errors import DecodeError
from servolink.escaping import escape
from servolink.protocol.codec import Codec
from servolink.protocol.frame import HEADER, HEADER_SIZE, Frame
from servolink.protocol.packet import Packet, Query

T = TypeVar("T")

frame_logger = logging.getLogger("servolink.frames")

_LONGEST = 1000  # characters of one packet in the log: an action can have thousands of steps


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


class FrameLog:
    """Log of every frame sent and received, decoded, with its time, at debug level of `servolink.frames`.

    Callers check `frame_logger.isEnabledFor(DEBUG)` themselves: nothing else is done while nobody reads the log, and it
    can be switched on while a connection is open.
    """

    def __init__(self, url: str, codec: Codec, now: Callable[[], float]) -> None:
        """Log frames of `url`, with the seconds by `now` since this moment."""
        self._url = escape(url)
        self._codec = codec
        self._now = now
        self._start = now()

    def sent(self, frame: bytes) -> None:
        """Log a whole frame that is about to be sent."""
        _, packet_id, _ = HEADER[self._codec.byte_order].unpack_from(frame)
        self._log("->", packet_id, frame[HEADER_SIZE:-1])

    def received(self, frame: Frame) -> None:
        """Log an intact frame that has come."""
        self._log("<-", *frame)

    def _log(self, direction: str, packet_id: int, content: bytes) -> None:
        try:
            text = str(self._codec.decode(packet_id, content))
        except DecodeError as error:
            text = f"packet {packet_id}: {error}: {content.hex(' ')}"
        if len(text) > _LONGEST:
            text = f"{text[:_LONGEST]}... ({len(text)} characters)"
        seconds = self._now() - self._start
        frame_logger.debug("%s %.4f s %s %s", self._url, seconds, direction, escape(text))
