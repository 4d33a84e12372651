"""Every frame sent and received, decoded, with its time, at debug level of the logger `servolink.frames`."""

from __future__ import annotations

import logging
from collections.abc import Callable

from servolink.errors import DecodeError
from servolink.escaping import escape
from servolink.protocol.codec import Codec
from servolink.protocol.frame import HEADER, HEADER_SIZE, Frame

frame_logger = logging.getLogger("servolink.frames")

_LONGEST = 1000  # characters of one packet: an action can have thousands of steps


class FrameLog:
    """The log of one connection.

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
