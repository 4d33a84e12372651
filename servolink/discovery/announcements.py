"""Virtual boards that are served on this machine: each server keeps a locked file in the user's runtime folder.

The lock ends with the process, however that ends, so a file that can be locked is left over and is removed.
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

if sys.platform == "win32":
    import msvcrt

    _FAR = 2**30  # the lock keeps others from reading what it covers, so it covers what is never written

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
    """Let `candidates` find `board` from now to the end; where no file can be kept it is served all the same."""
    with ExitStack() as stack:
        with suppress(OSError):
            folder = user_folder("runtime")
            folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
            number, name = tempfile.mkstemp(_SUFFIX, dir=folder)
            stack.callback(Path(name).unlink, missing_ok=True)
            file = stack.enter_context(open(number, "wb", buffering=0))
            _lock(file, wait=True)
            file.write(json.dumps(asdict(board)).encode())
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
    """Tell whether nobody else can have put a file into `folder`, and so lead us to a board of theirs."""
    if sys.platform == "win32":
        return True  # it lies in the user's profile
    status = folder.lstat()
    return stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & 0o022


def _read(path: Path) -> DeviceInfo | None:
    """Return the board announced in `path`, or None; remove the file if its server is gone."""
    try:
        with path.open("r+b", buffering=0) as file:
            content = file.read(65536)
            left_over = bool(content) and _lock(file, wait=False)  # one without content is about to get it
        if left_over:
            path.unlink(missing_ok=True)
            return None
        return msgspec.json.decode(content, type=DeviceInfo)
    except (OSError, msgspec.MsgspecError, UnicodeDecodeError):
        return None
