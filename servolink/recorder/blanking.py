"""Blank what a bug report must not contain: captions, names, paths, serial numbers; sizes, times and numbers stay.

Bytes on the wire keep their length and their pieces, and each frame gets the right checksum, so that the blanked
recording can be read and replayed as the original. What is in no intact frame may be a piece of a caption, and is
blanked whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, get_args, get_type_hints

import msgspec
from msgspec import Struct

from servolink.errors import PacketError
from servolink.protocol.codec import PACKETS, PACKETS_BY_NAME, Codec
from servolink.protocol.frame import HEADER, HEADER_SIZE, MAGIC, OVERHEAD, ByteOrder, checksum
from servolink.protocol.layout import layout
from servolink.protocol.packet import Packet
from servolink.recorder.channels import (
    CommandDone,
    Direction,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    ServosRead,
    Wire,
)
from servolink.recorder.private_text import PrivateText
from servolink.recorder.reading import Entry

_BLANK = "x"
_NOISE = b"?"
_BYTE_FOR_BYTE = "latin-1"  # reads every caption, and writes it in as many bytes
_DEEPEST = 6  # fields in fields


def blanked(entries: Iterable[Entry], private: PrivateText, byte_order: ByteOrder) -> list[tuple[int, Message]]:
    """Return the messages of `entries` with their times in nanoseconds, blanked.

    Take `private` from the same entries before (see `PrivateText.learn`): a name may stand in an earlier text.
    """
    found: list[tuple[int, Message]] = []
    wires: dict[Direction, _BlankWire] = {"sent": _BlankWire(byte_order), "received": _BlankWire(byte_order)}
    for entry in entries:
        message = entry.message
        if isinstance(message, Wire):
            wires[message.direction].take(len(found), message.data)
            found.append((entry.time, message))
        else:
            found.append((entry.time, blank_message(message, private)))
    for blank in wires.values():
        for at, data in blank.pieces():
            time, message = found[at]
            found[at] = time, msgspec.structs.replace(message, data=data)
    return found


def blank_message(message: Message, private: PrivateText) -> Message:
    """Return a message that is not bytes, blanked."""
    match message:
        case PacketSeen():
            name = message.packet if message.packet in PACKETS_BY_NAME else ""
            error = private.blank(message.error)
            data = _NOISE * len(message.data)
            return msgspec.structs.replace(message, packet=name, fields=_fields(message.fields), error=error, data=data)
        case ServosRead():
            servos = tuple(msgspec.structs.replace(each, caption=_BLANK * len(each.caption)) for each in message.servos)
            return ServosRead(servos, message.missed)
        case CommandDone():
            return msgspec.structs.replace(
                message,
                packet=message.packet if message.packet in PACKETS_BY_NAME else "",
                fields=_fields(message.fields),
                who=private.person(message.who),
                session=private.session(message.session),
                lease=private.person(message.lease),
                reason=private.blank(message.reason),
            )
        case Event():
            return msgspec.structs.replace(
                message,
                what="mark" if message.kind == "mark" else private.blank(message.what),
                who=private.person(message.who),
                session=private.session(message.session),
                text="" if message.kind == "mark" else private.blank(message.text),
            )
        case ProblemFound():
            return msgspec.structs.replace(
                message, text=private.blank(message.text), channel=private.blank_name(message.channel)
            )
    raise TypeError(f"{type(message).__name__} is blanked with the stream that it is part of")


def blank_packet(packet: Packet) -> Packet:
    """Return `packet` with captions and other texts blanked, in the same length."""
    found: Packet = _blank(packet)
    return found


def _blank(value: Any) -> Any:
    if isinstance(value, Struct):
        return type(value)(*(_blank(getattr(value, name)) for name in value.__struct_fields__))
    if isinstance(value, tuple):
        return tuple(map(_blank, value))
    if isinstance(value, str):
        return _BLANK * len(value)
    return bytes(len(value)) if isinstance(value, bytes) else value


def _fields(value: Any, depth: int = 0) -> Any:
    """Return the fields of a packet in a message: the numbers, with names that the protocol knows."""
    if isinstance(value, dict):
        if depth > _DEEPEST:
            return {}
        return {name: _fields(one, depth + 1) for name, one in value.items() if name in _KNOWN}
    if isinstance(value, list):
        return [] if depth > _DEEPEST else [_fields(one, depth + 1) for one in value]
    if isinstance(value, str):
        return _BLANK * len(value)
    return value if isinstance(value, (int, float)) else None


def _names(declared: type[Struct]) -> Iterator[str]:
    """Yield the names of the fields of a packet and of the records in it."""
    hints = get_type_hints(declared)
    for name in declared.__struct_fields__:
        yield name
        for inner in get_args(hints[name]):
            if isinstance(inner, type) and issubclass(inner, Struct):
                yield from _names(inner)


_KNOWN = {name for declared in PACKETS.values() for name in _names(declared)}


@dataclass
class _BlankWire:
    """The bytes of one direction, in their pieces."""

    byte_order: ByteOrder
    _data: bytearray = field(default_factory=bytearray)
    _ends: list[tuple[int, int]] = field(default_factory=list)

    def take(self, number: int, data: bytes) -> None:
        """Take the next piece, which has a number."""
        self._data += data
        self._ends.append((number, len(self._data)))

    def pieces(self) -> Iterator[tuple[int, bytes]]:
        """Yield the number and the blanked bytes of each piece."""
        blank = blank_stream(bytes(self._data), self.byte_order)
        start = 0
        for number, end in self._ends:
            yield number, blank[start:end]
            start = end


def blank_stream(data: bytes, byte_order: ByteOrder) -> bytes:
    """Return a stream of frames and noise with everything blanked that may be text, in the same length."""
    codec = Codec(byte_order, _BYTE_FOR_BYTE)
    parts: list[bytes] = []
    at = 0
    while at < len(data):
        start = data.find(MAGIC, at)
        start = len(data) if start < 0 else start
        parts.append(_NOISE * (start - at))
        at = start
        if at < len(data):
            part = _frame(data, at, codec)
            parts.append(part)
            at += len(part)
    return b"".join(parts)


def _frame(data: bytes, at: int, codec: Codec) -> bytes:
    """Return the blanked frame that begins at `at`, or only the magic if the frame is not intact."""
    head = data[at : at + HEADER_SIZE]
    if len(head) < HEADER_SIZE:
        return MAGIC[: len(head)]
    _, packet_id, length = HEADER[codec.byte_order].unpack(head)
    frame = data[at : at + length + OVERHEAD]
    declared = PACKETS.get(packet_id)
    if (
        declared is None
        or not layout(declared, codec.byte_order).rule.admits(length)
        or len(frame) < length + OVERHEAD
        or checksum(frame[:-1]) != frame[-1]
    ):
        return MAGIC
    try:
        blank = codec.encode(blank_packet(codec.decode(packet_id, frame[HEADER_SIZE:-1])), unchecked=True)
    except PacketError:
        return MAGIC
    return blank if len(blank) == len(frame) else MAGIC
