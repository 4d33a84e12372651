"""Reading of a recording: metadata, messages in order, tables, and faults of the file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import closing
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar, cast

import msgspec

from servolink.errors import DecodeError, RecordingError, quote
from servolink.protocol import Codec
from servolink.recorder.channels import (
    CHANNELS,
    MESSAGE_ENCODING,
    METADATA,
    TOPICS,
    CommandDone,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    Recorded,
    ServosRead,
    columns,
    decode,
    rows,
)
from servolink.recorder.mcap_reader import McapReader, Metadata
from servolink.recorder.round_trips import RoundTrips

ALL_SERVOS = 255
GOOD = {"answered", "sent"}
"""Outcomes of commands without a problem."""


M = TypeVar("M", bound=Message)
M_co = TypeVar("M_co", bound=Message, covariant=True)


class Entry(NamedTuple, Generic[M_co]):
    """Message of a recording, with the time."""

    seconds: float
    """Seconds since the first message."""
    time: int
    """Time in nanoseconds since 1970."""
    topic: str
    """Channel of the message, such as `/servos`."""
    message: M_co


class Selection(msgspec.Struct, frozen=True):
    """Filter of messages. A response is selected with its request, so that failures stay visible.

    With `servo_id`, readings have the state of this servo only.
    """

    since: float | None = None
    """Seconds since the first message."""
    until: float | None = None
    topics: frozenset[str] = frozenset()
    """Topics to select; empty for all."""
    packet: str = ""
    """Name of a packet, with or without Request or Response; empty for all messages."""
    servo_id: int | None = None
    only_problems: bool = False

    def takes(self, entry: Entry[Message]) -> bool:
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
    """Recording in a file, which is open only while messages are read."""

    def __init__(self, path: str | PathLike[str]) -> None:
        """Read the beginning of the file at `path`. Raise RecordingError if unreadable or not an MCAP file."""
        self.path = Path(path)
        self.about: Recorded | None = None
        """Metadata of the recording; None if the file has none."""
        self._reader: McapReader  # of the latest reading
        first = next(self._read(), None)  # reading the first message also reads the metadata in front
        self.started = first.time if first else 0
        """Time of the first message, in nanoseconds since 1970; 0 without messages."""

    def messages(
        self,
        kind: type[M],
        *,
        since: float | None = None,
        until: float | None = None,
        servo_id: int | None = None,
        packet: str = "",
        only_problems: bool = False,
    ) -> SelectedMessages[M]:
        """Return the messages of one kind, such as `ServosRead`, for a `for` loop or as a table.

        Args:
            kind: A class of messages in `servolink.recorder.channels`.
            since: Seconds since the first message of the recording; nothing before.
            until: Seconds since the first message of the recording; nothing after.
            servo_id: Servo named by the messages. Readings have the state of this servo only.
            packet: Name of the packet, with or without Request or Response.
            only_problems: Leave out messages without a problem.

        Raises:
            TypeError: No channel of a recording has messages of this kind.

        """
        if kind not in TOPICS:
            names = ", ".join(each.__name__ for each in TOPICS)
            raise TypeError(f"kind must be a class of messages ({names}), not {quote(kind)}")
        return SelectedMessages(
            self, kind, Selection(since, until, frozenset({TOPICS[kind]}), packet, servo_id, only_problems)
        )

    def entries(self, selection: Selection | None = None) -> Iterator[Entry[Message]]:
        """Yield all readable messages, of every kind. Raise RecordingError for a fault of the disk."""
        selection, trips = selection or Selection(), RoundTrips()
        for entry in self._read():
            if selection.takes(_request_of(entry, trips)):
                yield entry if selection.servo_id is None else _narrowed(entry, selection.servo_id)

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
        """Faults of the file and omissions, for people, by the latest reading; complete after the last message."""
        found = [f"{text} ({count})" for text, count in (+self._reader.remarks).items()]
        if self._reader.is_cut:
            found.append(f"the file is cut, and its end is missing: `servolink record --repair {self.path}` mends it")
        return found

    def _read(self) -> Iterator[Entry[Message]]:
        start: int | None = None
        with closing(McapReader(self.path)) as reader:
            self._reader = reader
            for record in reader.records():
                if isinstance(record, Metadata):
                    self._take_about(record)
                elif record.topic not in CHANNELS or record.encoding != MESSAGE_ENCODING:
                    reader.remarks["messages of foreign channels were left out"] += 1
                else:
                    start = record.time if start is None else start
                    try:
                        message = decode(record.topic, record.data)
                    except DecodeError:
                        reader.remarks[f"unreadable messages of {record.topic} were left out"] += 1
                    else:
                        yield Entry((record.time - start) / 1e9, record.time, record.topic, message)

    def _take_about(self, record: Metadata) -> None:
        if record.name == METADATA:
            try:
                self.about = msgspec.convert(record.texts, Recorded)
            except msgspec.ValidationError:
                self._reader.remarks["unreadable descriptions of the recording were left out"] += 1


def open_recording(path: str | PathLike[str]) -> Recording:
    """Return the recording in the file at `path`, cut or damaged or still being written.

    Raises:
        RecordingError: The file cannot be read, or is not an MCAP file.

    """
    return Recording(path)


_DTYPES = {float: "f8", int: "i8", bool: "?"}
"""Types of NumPy for values of messages; others are Python objects."""


class SelectedMessages(Generic[M]):
    """Messages of one kind in a recording, read from the file for each `for` loop and each table."""

    def __init__(self, recording: Recording, kind: type[M], selection: Selection) -> None:
        self._recording = recording
        self._kind = kind
        self._selection = selection

    def __iter__(self) -> Iterator[Entry[M]]:
        """Yield the readable messages with their times. Raise RecordingError for a fault of the disk."""
        for entry in self._recording.entries(self._selection):
            yield cast("Entry[M]", entry)

    def to_numpy(self) -> Any:
        """Return a structured array of NumPy, with the columns of `servolink convert --csv`.

        There is a row for each message, or for each servo of a reading. `seconds` is the time since the first message
        of the recording, `time_ns` the time in nanoseconds since 1970. Texts, bytes and fields of packets are Python
        objects.

        Raises:
            RecordingError: NumPy is not installed, a number needs more than 64 bits, or the disk has a fault.

        """
        numpy = _library("numpy")
        dtype = [(name, _DTYPES.get(hint, "O")) for name, hint in columns(self._kind).items()]
        try:
            return numpy.fromiter((row for entry in self for row in rows(*entry[:2], entry.message)), dtype)
        except OverflowError as error:
            raise RecordingError(f"{self._recording.path}: a number is too large for a table: {error}") from error

    def to_pandas(self) -> Any:
        """Return a DataFrame of pandas with the columns of `to_numpy`. Raise RecordingError as `to_numpy` does."""
        return _library("pandas").DataFrame(self.to_numpy())


def _library(name: str) -> Any:
    """Return a library of the user. Raise RecordingError if it is not installed."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise RecordingError(f"a table needs {error.name}, which is not installed; run: pip install {name}") from error


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


def _request_of(entry: Entry[Message], trips: RoundTrips) -> Entry[Message]:
    """Return the request answered by `entry`; `entry` itself if not a response."""
    message = entry.message
    if not isinstance(message, PacketSeen) or message.noise or message.error:
        return entry
    for trip in trips.take(entry.seconds, message):
        if trip.packet and trip.response:
            return Entry(trip.seconds, 0, entry.topic, PacketSeen("sent", packet=trip.packet, fields=trip.fields))
    return entry


def _narrowed(entry: Entry[Message], servo_id: int) -> Entry[Message]:
    """Return `entry` without the states of other servos."""
    if not isinstance(entry.message, ServosRead):
        return entry
    states = tuple(state for state in entry.message.servos if state.servo_id == servo_id)
    return entry._replace(message=ServosRead(states, entry.message.missed))


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
