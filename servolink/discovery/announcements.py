"""The virtual boards served on this machine: each server keeps a locked file in the user's runtime folder.

The lock ends with the process, however that ends: a file that can be locked is left over, and is removed.
"""

from __future__ import annotations

import json
import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import BinaryIO

import msgspec

from servolink.files import user_folder
from servolink.transports.device_info import DeviceInfo

_SUFFIX = ".board"
_PRIVATE = stat.S_IRWXU
_MOST_BYTES = 65536

if sys.platform == "win32":
    import msvcrt

    _FAR = 2**30  # a lock keeps others from reading the bytes it covers, so it covers one that is never written

    def _lock(file: BinaryIO, *, wait: bool) -> bool:
        file.seek(_FAR)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            file.seek(0)
        return True
else:
    import fcntl

    def _lock(file: BinaryIO, *, wait: bool) -> bool:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError:
            return False
        return True


@contextmanager
def announced(board: DeviceInfo) -> Iterator[None]:
    """Make `candidates` find `board` within this context; it is not found where no private file can be kept."""
    with ExitStack() as stack:
        with suppress(OSError):
            folder = user_folder("runtime")
            folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
            if _is_ours(folder):  # another user's folder, or a link, could make us write anywhere
                _write(board, folder, stack)
        yield


def candidates() -> list[DeviceInfo]:
    """Return the virtual boards that are being served by this user on this machine."""
    try:
        folder = user_folder("runtime")
        names = sorted(folder.glob(f"*{_SUFFIX}")) if _is_ours(folder) else []
    except OSError:
        return []
    return [board for name in names if (board := _read(name)) is not None]


def _is_ours(folder: Path) -> bool:
    """Return whether only this user can put files into `folder`, which otherwise could name a board of theirs."""
    if sys.platform == "win32":
        return True  # it lies in the user's profile
    status = folder.lstat()
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & 0o022


def _write(board: DeviceInfo, folder: Path, stack: ExitStack) -> None:
    """Write an announcement that `stack` removes."""
    number, name = tempfile.mkstemp(_SUFFIX, dir=folder)
    stack.callback(Path(name).unlink, missing_ok=True)
    file = stack.enter_context(os.fdopen(number, "wb", buffering=0))
    _lock(file, wait=True)  # before writing: a file with content and no lock counts as left over
    file.write(json.dumps(asdict(board)).encode())


def _read(path: Path) -> DeviceInfo | None:
    """Return the board announced in `path`, None if it cannot be read; remove the file if its server is gone."""
    try:
        with path.open("r+b", buffering=0) as file:
            content = file.read(_MOST_BYTES)
            left_over = bool(content) and _lock(file, wait=False)  # an empty file is about to be written
        if left_over:
            path.unlink(missing_ok=True)
            return None
        return msgspec.json.decode(content, type=DeviceInfo)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return None
