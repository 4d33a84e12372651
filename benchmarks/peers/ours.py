"""servolink's parser, alone and with the decoder, and the textbook's parser of the same format."""

from __future__ import annotations

from typing import Any

from benchmarks.peers.peer import Peer
from benchmarks.textbook import TextbookParser
from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryActionListResponse
from servolink.protocol.frame import Frame, encode_frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.records import ActionEntry
from servolink.protocol.servos import QueryServoResponse, ServoState


def typical(size: int, number: int) -> bytes:
    """Return the frame of a button event, the state of 16 servos, or a list of 100 actions."""
    packet: Packet
    if size == 14:
        packet = ButtonEventResponse(number, number & 1)
    elif size == 186:
        packet = QueryServoResponse(tuple(ServoState(at, number, 120, 400 + at, 1, 1, 1) for at in range(16)))
    else:
        packet = QueryActionListResponse(tuple(ActionEntry(number, f"action {at}") for at in range(100)))
    return Codec().encode(packet)


class Ours(Peer):
    """The parser alone."""

    name = "servolink"
    work = "id, length rule, checksum; (id, bytes)"
    fairness = "-"
    resync = "inside the damaged frame"
    frame = staticmethod(typical)

    def __init__(self) -> None:
        """Begin a stream."""
        self._feed = FrameParser().feed

    def feed(self, chunk: bytes) -> list[Frame]:
        """Parse."""
        return self._feed(chunk)

    def content(self, frame: Frame) -> bytes:
        """Return the whole frame."""
        return encode_frame(*frame, "little")


class OursTyped(Peer):
    """Parser and decoder."""

    name = "servolink, typed objects"
    work = "the same, and a packet object with all fields"
    fairness = "-"
    resync = Ours.resync
    builds = True
    frame = staticmethod(typical)

    def __init__(self) -> None:
        """Begin a stream."""
        self._feed = FrameParser().feed
        self._codec = Codec()

    def feed(self, chunk: bytes) -> list[Packet]:
        """Parse and decode."""
        decode = self._codec.decode
        return [decode(packet_id, content) for packet_id, content in self._feed(chunk)]

    def content(self, frame: Packet) -> bytes:
        """Return the whole frame."""
        return self._codec.encode(frame, unchecked=True)


class Textbook(Peer):
    """What most projects would write for this format."""

    name = "textbook parser"
    work = "find, sum, del; (id, bytes)"
    fairness = "ours: `sum` is slower than adler32; theirs: no ids or lengths to check"
    resync = "one byte further"
    frame = staticmethod(typical)

    def __init__(self) -> None:
        """Begin a stream."""
        self._feed = TextbookParser().feed

    def feed(self, chunk: bytes) -> list[Any]:
        """Parse."""
        return self._feed(chunk)

    def content(self, frame: Frame) -> bytes:
        """Return the whole frame."""
        return encode_frame(*frame, "little")
