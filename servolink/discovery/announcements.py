"""The virtual boards served on this machine: each server keeps a locked file in the user's runtime folder.

The lock ends with the process, however that ends: a file that can be locked is left over, and is removed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import BinaryIO

import msgspec

from servolink.files import open_file, user_folder
from servolink.platforms.locks import lock, remove_locked
from servolink.platforms.private_files import is_ours, private_folder
from servolink.transports.device_info import DeviceInfo

_SUFFIX = ".board"
_MOST_BYTES = 65536


@contextmanager
def announced(board: DeviceInfo) -> Iterator[None]:
    """Make `candidates` find `board` within this context; it is not found where no private file can be kept."""
    with ExitStack() as stack:
        with suppress(OSError):
            _write(board, private_folder(), stack)
        yield


def candidates() -> list[DeviceInfo]:
    """Return the virtual boards that are being served by this user on this machine."""
    return read_all(_SUFFIX)


def read_all(suffix: str) -> list[DeviceInfo]:
    """Return what the files with this suffix announce; remove those whose program is gone."""
    try:
        folder = user_folder("runtime")
        names = sorted(folder.glob(f"*{suffix}")) if is_ours(folder.lstat()) else []
    except OSError:
        return []
    return [board for name in names if (board := _read(name)) is not None]


def write(board: DeviceInfo, file: BinaryIO) -> None:
    """Announce `board` in a file that is locked."""
    file.seek(0)
    file.truncate()
    file.write(json.dumps(asdict(board)).encode())


def _write(board: DeviceInfo, folder: Path, stack: ExitStack) -> None:
    """Write an announcement that `stack` removes."""
    import tempfile  # late, as it takes long to load: the search for boards does not need it

    number, name = tempfile.mkstemp(_SUFFIX, dir=folder)
    stack.callback(Path(name).unlink, missing_ok=True)
    file = stack.enter_context(os.fdopen(number, "wb", buffering=0))
    lock(file, wait=True)  # before writing: a file with content and no lock counts as left over
    write(board, file)


def _read(path: Path) -> DeviceInfo | None:
    """Return the board announced in `path`, None if it cannot be read; remove the file if its program is gone."""
    try:
        with open_file(path, writable=True) as file:  # some file systems lock no file that is only read
            content = file.read(_MOST_BYTES)
            left_over = bool(content) and lock(file, wait=False)  # an empty file is about to be written
            if left_over:
                remove_locked(path, file)
                return None
        return msgspec.json.decode(content, type=DeviceInfo)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return None
