"""PacketStream: the packets in the bytes that passed, found by parsers of its own."""

from __future__ import annotations

from typing import Any

from servolink.errors import DecodeError
from servolink.protocol.codec import Codec
from servolink.protocol.frame import OVERHEAD, Frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.json_form import packet_to_json
from servolink.protocol.packet import Packet
from servolink.protocol.parser import PADDING, FrameParser
from servolink.recorder.channels import Direction, Event, PacketSeen, Wire

_SILENCE = 1.0
"""Seconds after which the rest of half a frame is not expected any more."""
_MOST_NOISE = 64  # bytes of it that are shown; all of it is in /wire


class PacketStream:
    """What the bytes of both directions say."""

    def __init__(self, codec: Codec) -> None:
        """Start between two frames."""
        self._codec = codec
        self._parsers: dict[Direction, FrameParser] = {}
        self._heard_at: dict[Direction, float] = {}
        self.start_over()

    def start_over(self) -> None:
        """Forget what is incomplete: bytes are missing."""
        for direction in ("sent", "received"):
            self._parsers[direction] = FrameParser(self._codec.byte_order, keep_skipped=True)

    def feed(self, wire: Wire) -> list[PacketSeen | Event]:
        """Return the packets that are complete with these bytes, the noise before them, and button events."""
        direction, parser = wire.direction, self._parsers[wire.direction]
        frames = list[Frame]()
        found = list[PacketSeen | Event]()
        before = self._heard_at.get(direction, wire.monotonic)
        self._heard_at[direction] = wire.monotonic
        while parser.partial_frame is not None and wire.monotonic - before >= _SILENCE:
            frames += parser.abandon_frame()
        frames += parser.feed(wire.data)
        for _, data, reason in parser.take_skipped():
            if reason != PADDING:
                found.append(PacketSeen(direction, noise=len(data), data=bytes(data[:_MOST_NOISE]), error=reason))
        for frame in frames:
            self._decode(direction, frame, found)
        return found

    def _decode(self, direction: Direction, frame: Frame, found: list[PacketSeen | Event]) -> None:
        packet_id, content = frame
        size = len(content) + OVERHEAD
        try:
            packet = self._codec.decode(packet_id, content)
        except DecodeError as error:
            found.append(PacketSeen(direction, packet_id, size=size, error=str(error)[:200], data=content))
            return
        found.append(PacketSeen(direction, packet_id, type(packet).__name__, fields_of(packet), size))
        if isinstance(packet, ButtonEventResponse) and direction == "received":
            found.append(Event("button", packet.kind, button_id=packet.button_id))


def fields_of(packet: Packet) -> Any:
    """Return what is encoded as the fields of a packet: the packet itself, as that costs nothing now, if it can be."""
    return packet if "data" not in packet.__struct_fields__ else packet_to_json(packet)["fields"]
