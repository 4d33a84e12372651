"""Channels of a recording: the types of messages, with their JSON Schemas and the columns of their tables.

Foxglove and PlotJuggler read these schemas. Neither `null` nor references between types are known to both, so a
missing value is left out, and each schema is written out in full.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any, Final, Literal, TypeAlias, get_type_hints

import msgspec
from msgspec import Meta, Struct

from servolink.errors import DecodeError, escape

MESSAGE_ENCODING: Final = "json"
SCHEMA_ENCODING: Final = "jsonschema"
METADATA: Final = "servolink"
"""Name of the metadata record with the fields of `Recorded` as texts."""
WIRE_ONLY: Final = "wire"
"""Channels of a recording that has only the bytes, without the packets in them."""

Direction: TypeAlias = Literal["sent", "received"]
"""Direction as seen by the program connected to the board: `sent` goes to the board."""
Outcome: TypeAlias = Literal["answered", "rejected", "sent", "refused", "unanswered", "unknown", "failed"]
"""Outcome of a request.

answered: the board responded. rejected: the board responded with the result 0. sent: the packet has no response, or is
a stop, sent without waiting. refused: not sent. unanswered: a query without a response, so nothing was changed.
unknown: sent, and perhaps carried out. failed: the connection was lost, perhaps before sending.
"""


def _about(description: str) -> Meta:
    return Meta(description=description)


class Wire(Struct, frozen=True, omit_defaults=True):
    """Bytes on the line, in pieces as they passed."""

    direction: Direction
    data: bytes
    monotonic: Annotated[float, _about("seconds on a clock never set; only differences have a meaning")]


class PacketSeen(Struct, frozen=True, omit_defaults=True):
    """Decoded frame on the line, or bytes outside of frames."""

    direction: Direction
    packet_id: Annotated[int, _about("0 for bytes outside of frames")] = 0
    packet: Annotated[str, _about("name in the document; empty for an unknown id")] = ""
    fields: Annotated[dict[str, Any], _about("raw values; captions as text, other bytes in hex")] = {}
    size: Annotated[int, _about("bytes of the whole frame")] = 0
    error: Annotated[str, _about("why an intact frame cannot be decoded")] = ""
    noise: Annotated[int, _about("number of bytes outside of frames")] = 0
    data: Annotated[bytes, _about("content of a frame with an error, or the first bytes outside of frames")] = b""


class RecordedServo(Struct, frozen=True, omit_defaults=True):
    """State of a servo as reported by the board."""

    servo_id: int
    angle: float
    angle_unit: Annotated[Literal["", "degree", "adc"], _about("empty if unknown")]
    current_raw: int
    temperature_raw: int
    servo_type: int
    is_start: Annotated[bool, _about("whether the servo may move; a stopped servo ignores movements")]
    is_hold: Annotated[bool, _about("whether the servo holds an angle; a released servo is limp")]
    caption: Annotated[str, _about("left out if unknown")] = ""
    doubt: Annotated[str, _about("why these values cannot be true; left out for plausible values")] = ""


class ServosRead(Struct, frozen=True, omit_defaults=True):
    """Reading of all servos at a time."""

    servos: tuple[RecordedServo, ...]
    missed: Annotated[int, _about("readings left out directly before")] = 0


class Event(Struct, frozen=True, omit_defaults=True):
    """Event without a request to the board."""

    kind: Literal["button", "connection", "lease", "hold", "program", "mark", "alarm", "recorder"]
    what: Annotated[str, _about("such as press, lost, connected, taken, joined, or the words of a mark")]
    who: Annotated[str, _about("program or person concerned")] = ""
    session: Annotated[str, _about("the program's session with the hub")] = ""
    button_id: int = 0
    text: Annotated[str, _about("details for people")] = ""


class CommandDone(Struct, frozen=True, omit_defaults=True):
    """Ended request: a change of the board, a movement, or a failed query."""

    packet: str
    fields: Annotated[dict[str, Any], _about("as in /packets")]
    outcome: Outcome
    seconds: Annotated[float, _about("from the request to the outcome")] = 0.0
    who: Annotated[str, _about("requesting program; empty without a hub")] = ""
    session: Annotated[str, _about("session of the program with the hub")] = ""
    lease: Annotated[str, _about("program with the motion lease at that time; empty without a lease")] = ""
    reason: Annotated[str, _about("reason of a refusal or failure")] = ""


class ProblemFound(Struct, frozen=True, omit_defaults=True):
    """Problem on the line or with the recording itself."""

    kind: Literal["dropped", "disk", "line", "hub", "servos", "recorder"]
    text: str
    channel: Annotated[str, _about("channel with missing messages")] = ""
    count: Annotated[int, _about("number of missing messages")] = 0


Message: TypeAlias = Wire | PacketSeen | ServosRead | Event | CommandDone | ProblemFound

CHANNELS: Final[dict[str, type[Message]]] = {
    "/wire": Wire,
    "/packets": PacketSeen,
    "/servos": ServosRead,
    "/events": Event,
    "/commands": CommandDone,
    "/problems": ProblemFound,
}
"""Type of the messages in each channel, by topic."""
TOPICS: Final[dict[type, str]] = {declared: topic for topic, declared in CHANNELS.items()}
SCHEMA_NAMES: Final = {topic: f"servolink.{declared.__name__}" for topic, declared in CHANNELS.items()}

_encoder = msgspec.json.Encoder()
_decoders = {topic: msgspec.json.Decoder(declared) for topic, declared in CHANNELS.items()}


class Recorded(Struct, frozen=True):
    """Metadata of a recording: the recorded board, and the settings needed to read the packets."""

    version: str
    """Version of the servolink library."""
    started: str
    """Start in ISO 8601 format, UTC."""
    board: str
    """Name or address of the board."""
    through: Literal["board", "hub", "spy"]
    """Recorded at a board used exclusively, beside other programs of a hub, or between a program and a board."""
    byte_order: str = "little"
    caption_encoding: str = "utf-8"
    hz: str = "0"
    """Readings of the servos per second, requested by the recorder itself."""
    channels: str = "all"
    """`all`, or `wire` for bytes without the packets in them."""


def encode(message: Message) -> bytes:
    """Return the JSON of a message. Bytes of a caption outside the encoding become question marks."""
    try:
        return _encoder.encode(message)
    except UnicodeEncodeError:
        return json.dumps(msgspec.to_builtins(message), ensure_ascii=False).encode(errors="replace")


def decode(topic: str, data: bytes) -> Message:
    """Return the message in `data`. Raise DecodeError, with the data, for anything else than a message of `topic`."""
    decoder = _decoders.get(topic)
    if decoder is None:
        raise DecodeError(f"a recording has no channel {escape(topic)[:100]}", data)
    try:
        return decoder.decode(data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise DecodeError(f"{topic}: {escape(str(error))[:200]}", data) from None


@cache
def schema(topic: str) -> bytes:
    """Return the JSON Schema of a channel, without references."""
    (found,), definitions = msgspec.json.schema_components([CHANNELS[topic]], ref_template="{name}")
    return json.dumps(_written_out(found, definitions)).encode()


def _written_out(found: Any, definitions: dict[str, Any]) -> Any:
    """Return a part of a schema with all referenced types written out."""
    if isinstance(found, list):
        return [_written_out(each, definitions) for each in found]
    if not isinstance(found, dict):
        return found
    if "$ref" in found:
        return _written_out(definitions[found["$ref"]], definitions)
    if "enum" in found:  # of texts, everywhere here
        found = {"type": "string", **found}
    return {key: _written_out(value, definitions) for key, value in found.items()}


_FIRST = {"seconds": float, "time_ns": int}


def columns(kind: type) -> dict[str, Any]:
    """Return the columns of a table with messages of one kind: names, with the types of the values."""
    if kind is ServosRead:  # without captions, as in the file of `servolink watch`
        servo = {name: hint for name, hint in get_type_hints(RecordedServo).items() if name != "caption"}
        return _FIRST | servo | {"missed": int}
    hints = get_type_hints(kind)
    return _FIRST | {"took_seconds" if name in _FIRST else name: hint for name, hint in hints.items()}


def rows(seconds: float, time: int, message: Message) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a message, with a value for each column."""
    if isinstance(message, ServosRead):
        for servo in message.servos:
            values = (getattr(servo, name) for name in servo.__struct_fields__ if name != "caption")
            yield seconds, time, *values, message.missed
    else:
        yield seconds, time, *msgspec.structs.astuple(message)
