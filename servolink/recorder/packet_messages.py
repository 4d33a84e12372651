"""Messages about packets: packets found in the passing bytes, and commands with their outcome."""

from __future__ import annotations

import asyncio
from typing import Any

from servolink.errors import ConnectionLost, DecodeError, OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    OVERHEAD,
    ButtonEventResponse,
    Codec,
    Frame,
    FrameParser,
    Packet,
    Query,
    Result,
    packet_to_json,
)
from servolink.recorder.channels import CommandDone, Direction, Event, Outcome, PacketSeen, Wire

_SILENCE = 1.0
"""Seconds after which the rest of half a frame is not expected any more."""
_MOST_NOISE = 64  # bytes of noise shown in a message; /wire has all bytes
_LONGEST_REASON = 300  # characters


class PacketStream:
    """Decoder for the bytes of both directions."""

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        self._parsers: dict[Direction, FrameParser] = {}
        self._heard_at: dict[Direction, float] = {}
        self.start_over()

    def start_over(self) -> None:
        """Forget incomplete frames, because bytes are missing."""
        for direction in ("sent", "received"):
            self._parsers[direction] = FrameParser(self._codec.byte_order, keep_skipped=True)

    def feed(self, wire: Wire) -> list[PacketSeen | Event]:
        """Return the packets completed by these bytes, the noise before, and button events."""
        direction, parser = wire.direction, self._parsers[wire.direction]
        frames = list[Frame]()
        found = list[PacketSeen | Event]()
        before = self._heard_at.get(direction, wire.monotonic)
        self._heard_at[direction] = wire.monotonic
        while parser.partial_frame is not None and wire.monotonic - before >= _SILENCE:
            frames += parser.abandon_frame()
        frames += parser.feed(wire.data)
        for _, data, reason in parser.take_skipped():
            if reason != FrameParser.PADDING:
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
    """Return the fields of a packet for encoding: the packet itself if possible, as that costs nothing now."""
    return packet if "data" not in packet.__struct_fields__ else packet_to_json(packet)["fields"]


def command_done(
    packet: Packet, outcome: object, seconds: float, *, who: str = "", session: str = "", lease: str = ""
) -> CommandDone:
    """Return the message about an ended request.

    `outcome` is the response, True for a sent packet without a response, False for an unsent packet, a text with the
    reason for not sending, or an error.
    """
    word = outcome_of(packet, outcome)
    reason = str(outcome)[:_LONGEST_REASON] if isinstance(outcome, Exception | str) else ""
    return CommandDone(
        type(packet).__name__,
        fields_of(packet),
        word,
        max(seconds, 0.0),
        who=who,
        session=session,
        lease=lease,
        reason=reason,
    )


def outcome_of(packet: Packet, outcome: object) -> Outcome:
    """Return the outcome of a request as a word."""
    match outcome:
        case Result():
            return "answered" if outcome.result else "rejected"
        case Packet():
            return "answered"
        case True:
            return "sent"
        case ConnectionLost():
            return "failed"
        case OutcomeUnknown():
            return "unknown"
        case RequestTimeout() | DecodeError():
            return "unanswered" if isinstance(packet, Query) else "unknown"
        case asyncio.CancelledError():
            return "unanswered" if isinstance(packet, Query) else "unknown"
        case _:
            return "refused"
