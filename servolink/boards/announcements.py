"""Announcements of virtual boards: each server keeps a locked file in the runtime folder of the user.

The system releases the lock with the process: a file without a lock is left over from a killed process, and is removed.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

import msgspec

from servolink.support import LockedFile, lock, open_file, private_folder
from servolink.transports import DeviceInfo

_SUFFIX = ".board"
_MOST_BYTES = 65536


@contextmanager
def announced(board: DeviceInfo) -> Iterator[None]:
    """Announce `board` to `candidates` inside the context; do nothing if the system keeps no private files."""
    with ExitStack() as stack:
        with suppress(OSError):
            _write(board, private_folder(), stack)
        yield


def candidates() -> list[DeviceInfo]:
    """Return the virtual boards served by the user on the local machine."""
    return read_all(_SUFFIX)


def read_all(suffix: str) -> list[DeviceInfo]:
    """Return the boards announced in files with `suffix`; remove files of ended programs."""
    try:
        names = sorted(private_folder(create=False).glob(f"*{suffix}"))
    except OSError:
        return []
    return [board for name in names if (board := _read(name)) is not None]


def write(board: DeviceInfo, file: BinaryIO) -> None:
    """Announce `board` in an already locked file."""
    file.seek(0)
    file.truncate()
    file.write(msgspec.json.encode(board))


def _write(board: DeviceInfo, folder: Path, stack: ExitStack) -> None:
    """Write an announcement, to be removed by `stack`."""
    number, name = tempfile.mkstemp(_SUFFIX, dir=folder)
    stack.callback(Path(name).unlink, missing_ok=True)
    file = stack.enter_context(os.fdopen(number, "wb", buffering=0))
    lock(file, wait=True)  # before writing: a file with content and no lock counts as left over
    write(board, file)


def _read(path: Path) -> DeviceInfo | None:
    """Return the board announced in `path`, None for an unreadable file; remove the file of an ended program."""
    try:
        with open_file(path, writable=True) as file:  # some file systems lock only files opened for writing
            content = file.read(_MOST_BYTES)
            is_stale = bool(content) and LockedFile.is_left_over(file)  # an empty file is about to be written
            if is_stale:
                LockedFile(path, file).remove()
                return None
        return msgspec.json.decode(content, type=DeviceInfo)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return None
