"""Reading of a recording: metadata, messages in order, and faults of the file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Generator, Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, Self

import msgspec

from servolink.errors import DecodeError
from servolink.protocol.codec import Codec
from servolink.recorder.channels import (
    CHANNELS,
    MESSAGE_ENCODING,
    METADATA,
    CommandDone,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    Recorded,
    ServosRead,
    decode,
)
from servolink.recorder.mcap_reader import McapReader, Metadata
from servolink.recorder.round_trips import RoundTrips

ALL_SERVOS = 255
GOOD = {"answered", "sent"}
"""Outcomes of commands without a problem."""


class Entry(NamedTuple):
    """Message of a recording, with the time."""

    seconds: float
    """Seconds since the first message."""
    time: int
    """Time in nanoseconds since 1970."""
    topic: str
    message: Message


class Selection(msgspec.Struct, frozen=True):
    """Filter of messages. A response is selected with its request, so that failures stay visible."""

    since: float | None = None
    """Seconds since the first message."""
    until: float | None = None
    topics: frozenset[str] = frozenset()
    """Topics to select; empty for all."""
    packet: str = ""
    """Name of a packet, with or without Request or Response; empty for all messages."""
    servo_id: int | None = None
    only_problems: bool = False

    def takes(self, entry: Entry) -> bool:
        """Return whether the filter selects the message."""
        return (
            (self.since is None or entry.seconds >= self.since)
            and (self.until is None or entry.seconds <= self.until)
            and (not self.topics or entry.topic in self.topics)
            and (not self.packet or base_name(getattr(entry.message, "packet", "")) == base_name(self.packet))
            and (self.servo_id is None or _is_about(entry.message, self.servo_id))
            and (not self.only_problems or is_problem(entry.message))
        )


class Recording:
    """Recording in a file; use in `with`. The messages can be read once."""

    def __init__(self, path: str | Path) -> None:
        """Open the file at `path`. Raise RecordingError if unreadable or not an MCAP file."""
        self.path = Path(path)
        self.about: Recorded | None = None
        """Metadata of the recording; None if the file has none."""
        self._reader = McapReader(self.path)
        self._unreadable: Counter[str] = Counter()
        self._all = self._read()
        self._first = next(self._all, None)  # reading the first message also reads the metadata in front

    def __enter__(self) -> Self:
        """Return the recording."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file of the recording."""
        self._all.close()
        self._reader.close()

    def entries(self, selection: Selection | None = None) -> Iterator[Entry]:
        """Yield all readable messages. Raise RecordingError for a fault of the disk."""
        wanted, trips = selection or Selection(), RoundTrips()
        for entry in chain((self._first,) if self._first else (), self._all):
            if wanted.takes(_request_of(entry, trips)):
                yield entry

    @property
    def started(self) -> int:
        """Time of the first message, in nanoseconds since 1970; 0 without messages."""
        return self._first.time if self._first else 0

    @property
    def codec(self) -> Codec:
        """Byte order and caption encoding of the recorded board; the defaults for a file without metadata."""
        about = self.about
        try:
            # Codec checks the values of the file.
            return Codec(about.byte_order, about.caption_encoding) if about else Codec()  # type: ignore[arg-type]
        except ValueError:
            return Codec()

    @property
    def remarks(self) -> list[str]:
        """Faults of the file, for people; complete after the last message."""
        found = [f"{text} ({count})" for text, count in (self._reader.remarks + self._unreadable).items()]
        if self._reader.is_cut:
            found.append(f"the file is cut, and its end is missing: `servolink record --repair {self.path}` mends it")
        return found

    def _read(self) -> Generator[Entry]:
        start: int | None = None
        for record in self._reader.records():
            if isinstance(record, Metadata):
                self._take_about(record)
            elif record.topic not in CHANNELS or record.encoding != MESSAGE_ENCODING:
                self._unreadable["messages of foreign channels were left out"] += 1
            else:
                start = record.time if start is None else start
                try:
                    message = decode(record.topic, record.data)
                except DecodeError:
                    self._unreadable[f"unreadable messages of {record.topic} were left out"] += 1
                else:
                    yield Entry((record.time - start) / 1e9, record.time, record.topic, message)

    def _take_about(self, record: Metadata) -> None:
        if record.name == METADATA:
            try:
                self.about = msgspec.convert(record.texts, Recorded)
            except msgspec.ValidationError:
                self._unreadable["unreadable descriptions of the recording were left out"] += 1


def base_name(packet: str) -> str:
    """Return the name of a packet without Request or Response, in small letters."""
    return packet.lower().removesuffix("request").removesuffix("response")


def is_problem(message: Message) -> bool:
    """Return whether a message reports a problem."""
    if isinstance(message, CommandDone):
        return message.outcome not in GOOD
    if isinstance(message, PacketSeen):
        return bool(message.error or message.noise)
    if isinstance(message, Event):
        return message.kind == "alarm" or message.what == "lost"
    return isinstance(message, ProblemFound)


def _request_of(entry: Entry, trips: RoundTrips) -> Entry:
    """Return the request answered by `entry`; `entry` itself if not a response."""
    message = entry.message
    if not isinstance(message, PacketSeen) or message.noise or message.error:
        return entry
    for trip in trips.take(entry.seconds, message):
        if trip.packet and trip.response:
            return Entry(trip.seconds, 0, entry.topic, PacketSeen("sent", packet=trip.packet, fields=trip.fields))
    return entry


def _is_about(message: Message, servo_id: int) -> bool:
    if isinstance(message, ServosRead):
        return any(servo.servo_id == servo_id for servo in message.servos)
    return isinstance(message, (CommandDone, PacketSeen)) and _names(message.fields, servo_id)


def _names(fields: Any, servo_id: int) -> bool:
    """Return whether fields of a packet name this servo, at any depth; 255 stands for all servos."""
    waiting = [fields]
    while waiting:
        value = waiting.pop()
        if isinstance(value, Mapping):
            if value.get("servo_id") in (servo_id, ALL_SERVOS) and type(value.get("servo_id")) is int:
                return True
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
    return False
