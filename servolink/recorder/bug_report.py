"""File for a bug report: a zip of findings and a blanked recording. Reports are read as files of strangers.

Captions, names, paths and serial numbers are blanked; sizes, times and numbers stay. Bytes on the wire keep length
and pieces, and each frame gets the right checksum, so that the blanked recording can be read and replayed like the
original. Bytes outside of intact frames may be part of a caption, and are all blanked.
"""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, get_args, get_type_hints

import msgspec
from msgspec import Struct

from servolink.errors import PacketError, RecordingError
from servolink.protocol import MAGIC, PACKETS, ByteOrder, Codec, FrameAt, Packet, layout
from servolink.recorder.channels import (
    TOPICS,
    CommandDone,
    Direction,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    Recorded,
    ServosRead,
    Wire,
    encode,
)
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.new_file import new_file
from servolink.recorder.private_text import PrivateText
from servolink.recorder.reading import Entry, Recording, Selection
from servolink.support import MIB, open_file, read_file, read_json, reason

LAST_SECONDS = 300.0
"""Length of the recording in a report, in seconds up to the end."""
_MOST_MESSAGES = 200_000
_CHUNK = 256 * 1024
_LARGEST_ZIP = 80 * MIB
_UNREADABLE = (OSError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error)
_DATE = (1980, 1, 1, 0, 0, 0)
_BLANK = "x"
_NOISE = b"?"
_BYTE_FOR_BYTE = "latin-1"  # reads every caption, and writes the same number of bytes
_DEEPEST = 6  # levels of fields within fields


class BugReport:
    """Files of a report, by name."""

    FACTS: ClassVar[str] = "report.json"
    RECORDING: ClassVar[str] = "recording.mcap"
    PROJECT: ClassVar[str] = "project.servolink.json"
    _LARGEST: ClassVar[dict[str, int]] = {FACTS: MIB, RECORDING: 64 * MIB, PROJECT: 16 * MIB}

    def __init__(self, facts: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Hold `facts`, and other files."""
        self.facts = facts
        self.files = {self.FACTS: json.dumps(facts, indent=1).encode(), **files}
        """All files, the one with the facts first."""

    @classmethod
    def read(cls, path: Path) -> BugReport:
        """Return the report in a file. Raise RecordingError if not a report, or too large."""
        files: dict[str, bytes] = {}
        try:
            with zipfile.ZipFile(io.BytesIO(read_file(path, _LARGEST_ZIP))) as archive:
                for name, largest in cls._LARGEST.items():
                    if name in archive.namelist():
                        files[name] = _member(archive, name, largest)
            facts = read_json(files[cls.FACTS])
        except KeyError as error:
            raise RecordingError(
                f"{path} is not a report: {cls.FACTS} is missing; `servolink report` writes one"
            ) from error
        except _UNREADABLE as error:
            raise RecordingError(f"{path} cannot be read as a report: {reason(error)}") from error
        if not isinstance(facts, dict):
            raise RecordingError(f"{path} is not a report: {cls.FACTS} holds no object")
        return cls(facts, files)

    @staticmethod
    def is_in(path: Path) -> bool:
        """Return whether a file begins as a zip; False for an unreadable file."""
        try:
            with open_file(path) as file:
                return file.read(4) == b"PK\x03\x04"
        except (OSError, ValueError):
            return False

    @cached_property
    def packed(self) -> bytes:
        """Zip of the files, without times and owners."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in self.files.items():
                info = zipfile.ZipInfo(name, _DATE)
                info.compress_type = zipfile.ZIP_DEFLATED
                archive.writestr(info, content)
        return packed.getvalue()

    def write(self, path: Path, *, replace: bool) -> None:
        """Write the report. Raise RecordingError if the file exists and `replace` is not set, or cannot be written."""
        with new_file(path, replace=replace, private=True) as file:
            file.write(self.packed)


def blanked(
    entries: Iterable[Entry[Message]], private: PrivateText, byte_order: ByteOrder
) -> list[tuple[int, Message]]:
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
    """Return a message other than bytes, blanked."""
    match message:
        case PacketSeen():
            name = message.packet if message.packet in PACKETS.by_name else ""
            error = private.blank(message.error)
            data = _NOISE * len(message.data)
            return msgspec.structs.replace(message, packet=name, fields=_fields(message.fields), error=error, data=data)
        case ServosRead():
            servos = tuple(msgspec.structs.replace(each, caption=_BLANK * len(each.caption)) for each in message.servos)
            return ServosRead(servos, message.missed)
        case CommandDone():
            return msgspec.structs.replace(
                message,
                packet=message.packet if message.packet in PACKETS.by_name else "",
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
    raise TypeError(f"{type(message).__name__} is blanked as part of a stream")


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
    """Return the fields of a packet in a message: only numbers, with names known to the protocol."""
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
    """Yield the names of the fields of a packet and of the records inside."""
    hints = get_type_hints(declared)
    for name in declared.__struct_fields__:
        yield name
        for inner in get_args(hints[name]):
            if isinstance(inner, type) and issubclass(inner, Struct):
                yield from _names(inner)


_KNOWN = {name for declared in PACKETS.values() for name in _names(declared)}


@dataclass
class _BlankWire:
    """Bytes of a direction, in pieces as passed."""

    byte_order: ByteOrder
    _data: bytearray = field(default_factory=bytearray)
    _ends: list[tuple[int, int]] = field(default_factory=list)

    def take(self, number: int, data: bytes) -> None:
        """Take the next piece, with the number of the message."""
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
    """Return a stream of frames and noise with all possible text blanked, in the same length."""
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
    """Return the blanked frame at `at`, or only the magic if the frame is not intact."""
    frame = FrameAt.read(data, at, codec.byte_order)
    if frame is None:
        return MAGIC[: len(data) - at]
    declared = PACKETS.get(frame.packet_id)
    if declared is None or not layout(declared, codec.byte_order).rule.admits(frame.length) or not frame.is_intact:
        return MAGIC
    try:
        blank = codec.encode(blank_packet(codec.decode(frame.packet_id, frame.content)), unchecked=True)
    except PacketError:
        return MAGIC
    return blank if len(blank) == frame.size else MAGIC


def blank_recording(path: Path, private: PrivateText) -> bytes:
    """Return the last minutes of a recording as a file, blanked; `private` learns private texts of the recording.

    Raise RecordingError if the recording cannot be read.
    """
    end, count = 0.0, 0
    recording = Recording(path)
    about, byte_order = recording.about, recording.codec.byte_order
    for entry in recording.entries():
        private.learn([entry.message])
        end, count = max(end, entry.seconds), count + 1
    if count > _MOST_MESSAGES:
        raise RecordingError(f"{path} has {count:,} messages: too many for a report; record a shorter time")
    messages = blanked(recording.entries(Selection(since=end - LAST_SECONDS)), private, byte_order)
    stream = McapStream(_blank_about(about, private))
    parts = [stream.head()]
    for time, message in messages:
        stream.add(TOPICS[type(message)], time, encode(message))
        if stream.waiting > _CHUNK:
            parts.append(stream.chunk())
    return b"".join([*parts, stream.chunk(), stream.end()])


def _blank_about(about: Recorded | None, private: PrivateText) -> Recorded:
    if about is None:
        return Recorded(version="", started="", board="", through="board")
    return Recorded(
        version=private.blank(about.version),
        started=private.blank(about.started) if len(about.started) > 40 else about.started,
        board="blanked",
        through=about.through,
        byte_order=about.byte_order if about.byte_order == "big" else "little",
        caption_encoding="utf-8",
        hz=private.blank(about.hz),
        channels="all",
    )


def _member(archive: zipfile.ZipFile, name: str, largest: int) -> bytes:
    """Return a file; the size stated in the zip may be a lie, so the unpacked size is limited."""
    if archive.getinfo(name).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{name} is compressed in a way not used in reports")
    with archive.open(name) as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise ValueError(f"{name} is larger than {largest // MIB} MiB")
    return content
