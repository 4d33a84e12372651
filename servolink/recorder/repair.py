"""Repair: whole chunks of a recording that was cut, in a file with a proper end."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from itertools import chain
from pathlib import Path

import msgspec
from msgspec import Struct

from servolink.errors import RecordingError
from servolink.files import reason
from servolink.recorder.channels import CHANNELS, MESSAGE_ENCODING, METADATA, Recorded
from servolink.recorder.mcap_reader import MAGIC, McapReader, Message, Metadata
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.recording_file import RecordingFile
from servolink.recorder.writer import CHUNK_BYTES

_UNKNOWN = Recorded("", "", "", "board")
_NEW, _OLD = ".repairing", ".cut"


class Repaired(Struct, frozen=True):
    """What came of a repair."""

    messages: int
    """How many were recovered."""
    original: str
    """Where the file is as it was; empty if there was nothing to repair, and nothing was changed."""


def repair(path: Path) -> Repaired:
    """Replace a recording that was cut by one of its whole chunks, and keep it under another name.

    Raise RecordingError, and leave everything as it was, if it is not a recording, or the new file cannot be written.
    """
    new, old = Path(f"{path}{_NEW}"), Path(f"{path}{_OLD}")
    if old.exists():
        raise RecordingError(f"{old} exists already, and would be lost; remove or rename it")
    reader = McapReader(path)
    mending = Mending(reader)
    file = RecordingFile(new)
    try:
        for block in mending.blocks():
            if not file.put(block):
                raise RecordingError(f"cannot write {new}: {file.problem}")
        file.close()
        if mending.was_whole and _has_end(path):
            return Repaired(mending.messages, "")
        path.rename(old)
        new.rename(path)
    except OSError as error:
        raise RecordingError(f"cannot repair {path}: {reason(error)}") from error
    finally:
        reader.close()
        file.close()
        new.unlink(missing_ok=True)
    return Repaired(mending.messages, str(old))


class Mending:
    """A good file from what can be read of another."""

    def __init__(self, reader: McapReader) -> None:
        """Read with `reader`."""
        self.messages = 0
        """How many were recovered; complete after the last block."""
        self._reader = reader

    @property
    def was_whole(self) -> bool:
        """Whether everything could be read."""
        return not self._reader.is_cut and not self._reader.remarks

    def blocks(self) -> Iterator[bytes]:
        """Yield the bytes of the good file."""
        records = self._reader.records()
        stream, waiting = _begun(next(records, None))
        yield stream.head()
        for record in chain(waiting, records):
            if isinstance(record, Message) and record.topic in CHANNELS and record.encoding == MESSAGE_ENCODING:
                stream.add(record.topic, record.time, record.data)
                if stream.waiting >= CHUNK_BYTES:
                    yield stream.chunk()
        self.messages = stream.messages
        yield stream.chunk() + stream.end()


def _begun(first: Message | Metadata | None) -> tuple[McapStream, list[Message | Metadata]]:
    """Return a stream with the metadata in the first record of a file, and that record if it is something else."""
    if isinstance(first, Metadata) and first.name == METADATA:
        with suppress(msgspec.ValidationError):
            return McapStream(msgspec.convert(first.texts, Recorded)), []
    return McapStream(_UNKNOWN), [] if first is None else [first]


def _has_end(path: Path) -> bool:
    """Return whether the last bytes of a file are those that every whole one has."""
    with path.open("rb") as file:
        file.seek(-len(MAGIC), os.SEEK_END)
        return file.read() == MAGIC
