"""Repair of a cut recording: a file of all whole chunks, with a proper end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
from itertools import chain
from pathlib import Path

import msgspec
from msgspec import Struct

from servolink.errors import RecordingError
from servolink.recorder.channels import CHANNELS, MESSAGE_ENCODING, METADATA, Recorded
from servolink.recorder.mcap_check import has_sound_index
from servolink.recorder.mcap_reader import McapReader, Message, Metadata
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.recording_file import RecordingFile, is_being_written
from servolink.recorder.writer import CHUNK_BYTES
from servolink.support import reason

_UNKNOWN = Recorded("", "", "", "board")
_FOREIGN = "messages of foreign channels were left out"
_NEW_INDEX = "the index, by which other programs find messages, was damaged; it was made anew"
_NEW, _OLD = ".repairing", ".cut"


class Repaired(Struct, frozen=True):
    """Result of a repair."""

    messages: int
    """Number of recovered messages."""
    original: str
    """Path of the damaged original; empty if nothing needed repair."""
    remarks: tuple[str, ...] = ()
    """Omissions and their numbers, for people."""


def repair(path: Path) -> Repaired:
    """Replace a cut recording by a file of the whole chunks, and keep the original under another name.

    Raise RecordingError, without any change, if the recording is still under way, if nothing is from a recorder of
    servolink, or if the new file cannot be written.
    """
    with closing(McapReader(path)) as reader:
        try:
            return _repair(path, Mending(reader))
        except OSError as error:
            raise RecordingError(f"cannot repair {path}: {reason(error)}") from error


def _repair(path: Path, mending: Mending) -> Repaired:
    if is_being_written(path):
        raise RecordingError(f"{path} is still being recorded; end the recorder first, or repair a copy of the file")
    new, old = Path(f"{path}{_NEW}"), Path(f"{path}{_OLD}")
    with suppress(FileNotFoundError):  # left behind by a killed repair
        if is_being_written(new):
            raise RecordingError(f"{path} is being repaired already, to {new}; wait for the end")
        new.unlink()
    file = RecordingFile(new)
    try:
        for block in mending.blocks():
            if not file.put(block):
                raise RecordingError(f"cannot write {new}: {file.problem}")
        file.close()
        remarks = mending.remarks
        if mending.was_whole:
            if not mending.is_ours or has_sound_index(path):
                return Repaired(mending.messages, "")
            remarks = (_NEW_INDEX,)
        if not mending.is_ours:
            raise RecordingError(f"nothing of a recording is left in {path}; the file was not changed")
        if old.exists():
            raise RecordingError(f"{old} exists already, and would be lost; remove or rename the file")
        path.rename(old)
        new.rename(path)
    finally:
        file.close()
        new.unlink(missing_ok=True)
    return Repaired(mending.messages, str(old), remarks)


class Mending:
    """Writes the readable messages of a damaged file to a sound file."""

    def __init__(self, reader: McapReader) -> None:
        self.messages = 0
        """Number of recovered messages; complete after the last block."""
        self.is_ours = False
        """Whether a part is from a recorder of servolink; complete after the last block."""
        self._reader = reader
        self._foreign = 0

    @property
    def was_whole(self) -> bool:
        """Whether everything in the file was readable."""
        return not self._reader.is_cut and not self._reader.remarks

    @property
    def remarks(self) -> tuple[str, ...]:
        """Omissions and their numbers; complete after the last block."""
        found = self._reader.remarks + Counter({_FOREIGN: self._foreign})
        return tuple(f"{text} ({count})" for text, count in found.items())

    def blocks(self) -> Iterator[bytes]:
        """Yield the bytes of the good file."""
        records = self._reader.records()
        first = next(records, None)
        about = _description(first)
        stream = McapStream(about or _UNKNOWN)
        yield stream.head()
        for record in chain((first,), records):
            if not isinstance(record, Message):
                continue
            if record.topic not in CHANNELS or record.encoding != MESSAGE_ENCODING:
                self._foreign += 1
                continue
            stream.add(record.topic, record.time, record.data)
            if stream.waiting >= CHUNK_BYTES:
                yield stream.chunk()
        self.messages = stream.messages
        self.is_ours = about is not None or stream.messages > 0
        yield stream.chunk() + stream.end()


def _description(record: Message | Metadata | None) -> Recorded | None:
    """Return the metadata in the first record of a file; None for any other record."""
    if isinstance(record, Metadata) and record.name == METADATA:
        with suppress(msgspec.ValidationError):
            return msgspec.convert(record.texts, Recorded)
    return None
