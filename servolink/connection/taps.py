"""Listeners to a connection: taps for bytes and requests, the log of frames, and the log of text between them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

from servolink.errors import DecodeError, escape
from servolink.protocol import ByteOrder, Codec, Frame, FrameAt, FrameParser, Packet, Query

T = TypeVar("T")

frame_logger = logging.getLogger("servolink.frames")
is_logged = frame_logger.isEnabledFor
text_logger = logging.getLogger("servolink.text")

_LONGEST = 1000  # characters of one packet in the log: an action can have thousands of steps
_LEAST_TEXT, _LONGEST_TEXT = 4, 200  # characters of a line of text


class Tap:
    """Listener to bytes and requests. Subclasses override methods of interest; no method may block, or raise."""

    def sent(self, data: bytes) -> None:
        """Hear bytes on their way to the board."""

    def received(self, data: bytes) -> None:
        """Hear bytes from the board."""

    def ended(self, packet: Packet, outcome: object, seconds: float) -> None:
        """Hear the outcome of a request, except of a query with a response.

        `outcome` is its response, True for one that the board does not answer, or the exception that its caller gets.
        """


class Taps:
    """Taps of one board, across all connections to the board."""

    def __init__(self) -> None:
        """Start without any."""
        self.members: tuple[Tap, ...] = ()
        """Taps in order of joining. Callers test for an empty tuple first, to save a call for each frame."""

    def add(self, tap: Tap) -> Callable[[], None]:
        """Add a tap. Return a function to remove the tap, which may be called again."""
        self.members = (*self.members, tap)

        def end() -> None:
            self.members = tuple(each for each in self.members if each is not tap)

        return end

    def log_text(self, url: str, byte_order: ByteOrder) -> None:
        """Log the lines of text that the board at `url` sends between its frames, if anybody reads that log."""
        if text_logger.isEnabledFor(logging.INFO):
            self.add(TextLog(url, byte_order))

    def sent(self, data: bytes) -> None:
        """Pass bytes for the board on to all taps."""
        for tap in self.members:
            tap.sent(data)

    def received(self, data: bytes) -> None:
        """Pass bytes from the board on to all taps."""
        for tap in self.members:
            tap.received(data)

    async def follow(self, packet: Packet, asking: Coroutine[Any, Any, T]) -> T:
        """Return the result of `asking`, and pass the outcome on to all taps."""
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
                for tap in self.members:
                    tap.ended(packet, outcome, now() - begun)


class FrameLog:
    """Log of every frame sent and received, decoded, with its time, at debug level of `servolink.frames`.

    Callers check `is_logged(DEBUG)` themselves: nothing else is done while nobody reads the log, and it
    can be switched on while a connection is open.
    """

    def __init__(self, url: str, codec: Codec, now: Callable[[], float]) -> None:
        """Log frames of `url` with the seconds since now, by the clock `now`."""
        self._url = escape(url)
        self._codec = codec
        self._now = now
        self._start = now()
        self.is_on = False
        """Whether the log is written, as found when the latest chunk came."""

    def sent(self, frame: bytes) -> None:
        """Log a whole frame on its way to the board."""
        if (whole := FrameAt.read(frame, 0, self._codec.byte_order)) is not None:
            self._log("->", whole.packet_id, whole.content)

    def received(self, frame: Frame) -> None:
        """Log an intact frame from the board."""
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


class TextLog(Tap):
    """Log of the lines of text that a board sends between its frames, at info level of `servolink.text`."""

    def __init__(self, url: str, byte_order: ByteOrder) -> None:
        """Log text from `url`, between frames in `byte_order`."""
        self._url = escape(url)
        self._parser = FrameParser(byte_order, keep_skipped=True)
        self._line = b""

    def received(self, data: bytes) -> None:
        """Log the lines of text that are complete now; control characters are escaped."""
        self._parser.feed(data)
        *lines, rest = (self._line + b"".join(span for _, span, _ in self._parser.take_skipped())).split(b"\n")
        while len(rest) > _LONGEST_TEXT:
            lines.append(rest[:_LONGEST_TEXT])
            rest = rest[_LONGEST_TEXT:]
        self._line = rest
        for line in lines:
            text = line.decode("utf-8", "replace").strip()
            readable = sum(character.isprintable() and character != "\ufffd" for character in text)
            if len(text) >= _LEAST_TEXT and 4 * readable >= 3 * len(text):  # noise is hardly ever
                text_logger.info("%s sends text: %s", self._url, escape(text[:_LONGEST_TEXT]))
