"""The channels of a recording: what a message says, and its JSON Schema.

Foxglove and PlotJuggler read these schemas. They know neither `null` nor references between types, so a value that is
missing is left out, and each schema is written out in full.
"""

from __future__ import annotations

import json
from functools import cache
from typing import Annotated, Any, Final, Literal, TypeAlias

import msgspec
from msgspec import Meta, Struct

from servolink.errors import DecodeError
from servolink.escaping import escape

MESSAGE_ENCODING: Final = "json"
SCHEMA_ENCODING: Final = "jsonschema"
METADATA: Final = "servolink"
"""The name of the metadata record, which holds `Recorded` as text by text."""

Direction: TypeAlias = Literal["sent", "received"]
"""As the program sees it that is connected to the board: `sent` goes to the board."""
Outcome: TypeAlias = Literal["answered", "rejected", "sent", "refused", "unanswered", "unknown", "failed"]
"""What became of a request.

answered: the board did, rejected: it did with the result 0, sent: boards do not answer it, or it is a stop, which waits
for nothing, refused: it was not sent, unanswered: it is a query, so nothing was changed, unknown: it was sent, and may
have been carried out or not, failed: the connection was lost, perhaps before it was sent.
"""


def _about(description: str) -> Meta:
    return Meta(description=description)


class Wire(Struct, frozen=True, omit_defaults=True):
    """Bytes as they passed, in whatever pieces."""

    direction: Direction
    data: bytes
    monotonic: Annotated[float, _about("seconds on a clock that is never set; only differences have a meaning")]


class PacketSeen(Struct, frozen=True, omit_defaults=True):
    """A frame on the line, decoded; or bytes that are part of none."""

    direction: Direction
    packet_id: Annotated[int, _about("0 for bytes that are part of no frame")] = 0
    packet: Annotated[str, _about("name in the document; empty if no packet has this id")] = ""
    fields: Annotated[dict[str, Any], _about("raw values; captions as text, other bytes in hex")] = {}
    size: Annotated[int, _about("bytes of the whole frame")] = 0
    error: Annotated[str, _about("why an intact frame cannot be decoded")] = ""
    noise: Annotated[int, _about("how many bytes are part of no frame")] = 0
    data: Annotated[bytes, _about("content of such a frame, or the first of such bytes")] = b""


class ServoState(Struct, frozen=True, omit_defaults=True):
    """A servo as it reports itself."""

    servo_id: int
    angle: float
    angle_unit: Annotated[Literal["", "degree", "adc"], _about("empty if it is unknown")]
    current_raw: int
    temperature_raw: int
    servo_type: int
    is_start: Annotated[bool, _about("whether it may move; a stopped servo ignores movements")]
    is_hold: Annotated[bool, _about("whether it holds its angle; a released servo is limp")]
    caption: Annotated[str, _about("left out if it is unknown")] = ""


class ServosRead(Struct, frozen=True, omit_defaults=True):
    """Reading of all servos."""

    servos: tuple[ServoState, ...]
    missed: Annotated[int, _about("readings left out directly before this one")] = 0


class Event(Struct, frozen=True, omit_defaults=True):
    """Something happened that nobody asked the board for."""

    kind: Literal["button", "connection", "lease", "hold", "program", "mark", "alarm", "recorder"]
    what: Annotated[str, _about("such as press, lost, connected, taken, joined, or the words of a mark")]
    who: Annotated[str, _about("the program or the person concerned")] = ""
    session: Annotated[str, _about("the program's session with the hub")] = ""
    button_id: int = 0
    text: Annotated[str, _about("more, for people")] = ""


class CommandDone(Struct, frozen=True, omit_defaults=True):
    """A request that changes something or moves a servo, or a query that failed, when it was over."""

    packet: str
    fields: Annotated[dict[str, Any], _about("as in /packets")]
    outcome: Outcome
    seconds: Annotated[float, _about("from the request to its outcome")] = 0.0
    who: Annotated[str, _about("the program that asked; empty if there is no hub")] = ""
    session: Annotated[str, _about("its session with the hub")] = ""
    lease: Annotated[str, _about("who had the motion lease then; empty if it was free")] = ""
    reason: Annotated[str, _about("why it was refused, or failed")] = ""


class ProblemFound(Struct, frozen=True, omit_defaults=True):
    """Something is wrong, on the line or with the recording itself."""

    kind: Literal["dropped", "disk", "line", "hub", "servos", "recorder"]
    text: str
    channel: Annotated[str, _about("the channel in which messages are missing")] = ""
    count: Annotated[int, _about("how many messages are missing")] = 0


Message: TypeAlias = Wire | PacketSeen | ServosRead | Event | CommandDone | ProblemFound

CHANNELS: Final[dict[str, type[Message]]] = {
    "/wire": Wire,
    "/packets": PacketSeen,
    "/servos": ServosRead,
    "/events": Event,
    "/commands": CommandDone,
    "/problems": ProblemFound,
}
"""The type of the messages of each channel, by topic."""
TOPICS: Final = {declared: topic for topic, declared in CHANNELS.items()}
SCHEMA_NAMES: Final = {topic: f"servolink.{declared.__name__}" for topic, declared in CHANNELS.items()}

_encoder = msgspec.json.Encoder()
_decoders = {topic: msgspec.json.Decoder(declared) for topic, declared in CHANNELS.items()}


class Recorded(Struct, frozen=True):
    """The metadata of a recording: what was recorded, and how to read it."""

    version: str
    """Of the library."""
    started: str
    """ISO 8601, UTC."""
    board: str
    """Name or address."""
    through: Literal["board", "hub", "spy"]
    """Recorded alone at the board, beside other programs of a hub, or between a program and a board."""
    byte_order: str = "little"
    caption_encoding: str = "utf-8"
    hz: str = "0"
    """Readings of the servos a second, that the recorder itself asked for."""
    channels: str = "all"


def encode(message: Message) -> bytes:
    """Return the JSON of a message. Bytes of a caption that are not text become question marks."""
    try:
        return _encoder.encode(message)
    except UnicodeEncodeError:
        return json.dumps(msgspec.to_builtins(message), ensure_ascii=False).encode(errors="replace")


def decode(topic: str, data: bytes) -> Message:
    """Return the message in `data`. Raise DecodeError, which keeps the data, if it is not one of this channel."""
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
    """Return a part of a schema with the types that it refers to in it."""
    if isinstance(found, list):
        return [_written_out(each, definitions) for each in found]
    if not isinstance(found, dict):
        return found
    if "$ref" in found:
        return _written_out(definitions[found["$ref"]], definitions)
    if "enum" in found:  # of texts, everywhere here
        found = {"type": "string", **found}
    return {key: _written_out(value, definitions) for key, value in found.items()}
