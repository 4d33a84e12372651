"""The file for a bug report: a zip with what was found, and a blanked recording. It is read as a stranger's file."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from servolink.errors import RecordingError
from servolink.files import MIB, open_file, read_file, reason
from servolink.json_text import read_json
from servolink.recorder.blanking import blanked
from servolink.recorder.channels import TOPICS, Recorded, encode
from servolink.recorder.mcap_stream import McapStream
from servolink.recorder.new_file import new_file
from servolink.recorder.private_text import PrivateText
from servolink.recorder.reading import Recording, Selection

FACTS, RECORDING, PROJECT = "report.json", "recording.mcap", "project.servolink.json"
"""The files in a report."""
LAST_SECONDS = 300.0
"""How much of a recording goes into a report, from its end."""
_MOST_MESSAGES = 200_000
_CHUNK = 256 * 1024
_LARGEST = {FACTS: MIB, RECORDING: 64 * MIB, PROJECT: 16 * MIB}
_LARGEST_ZIP = 80 * MIB
_DATE = (1980, 1, 1, 0, 0, 0)


def blank_recording(path: Path, private: PrivateText) -> bytes:
    """Return the last minutes of a recording as a file, blanked; `private` learns what is private in it.

    Raise RecordingError if the recording cannot be read.
    """
    end, count = 0.0, 0
    with Recording(path) as recording:
        about, byte_order = recording.about, recording.codec.byte_order
        for entry in recording.entries():
            private.learn([entry.message])
            end, count = max(end, entry.seconds), count + 1
    if count > _MOST_MESSAGES:
        raise RecordingError(f"{path} has {count:,} messages: too many for a report; record a shorter time")
    with Recording(path) as recording:
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


def pack(files: Mapping[str, bytes]) -> bytes:
    """Return a zip of files; their times and owners are not in it."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, content)
    return packed.getvalue()


def write_report(path: Path, packed: bytes, *, replace: bool) -> None:
    """Write a report. Raise RecordingError if the file exists and `replace` is not set, or cannot be written."""
    with new_file(path, replace=replace, private=True) as file:
        file.write(packed)


def facts_text(facts: Mapping[str, Any]) -> bytes:
    """Return the content of the file with the facts."""
    return json.dumps(facts, indent=1).encode()


def is_zip(path: Path) -> bool:
    """Return whether a file begins as a zip does; False if it cannot be read."""
    try:
        with open_file(path) as file:
            return file.read(4) == b"PK\x03\x04"
    except (OSError, ValueError):
        return False


def read_report(path: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the facts and the files of a report. Raise RecordingError if it is not a report, or too large."""
    files: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(read_file(path, _LARGEST_ZIP))) as archive:
            for name, largest in _LARGEST.items():
                if name in archive.namelist():
                    files[name] = _member(archive, name, largest)
        facts = read_json(files[FACTS])
    except KeyError as error:
        raise RecordingError(f"{path} is not a report: it has no {FACTS}; `servolink report` writes one") from error
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, zlib.error) as error:
        raise RecordingError(f"{path} cannot be read as a report: {reason(error)}") from error
    if not isinstance(facts, dict):
        raise RecordingError(f"{path} is not a report: {FACTS} holds no object")
    return facts, files


def _member(archive: zipfile.ZipFile, name: str, largest: int) -> bytes:
    """Return a file; the size that the zip names may be a lie, so that only so much is unpacked."""
    if archive.getinfo(name).compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{name} is compressed in a way that reports are not")
    with archive.open(name) as file:
        content = file.read(largest + 1)
    if len(content) > largest:
        raise ValueError(f"{name} is larger than {largest // MIB} MiB")
    return content
