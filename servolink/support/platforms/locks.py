"""Locks of files and devices for exclusive use by one program. The system releases each lock with the process."""

from __future__ import annotations

import os
import sys
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import BinaryIO, Self
from weakref import WeakValueDictionary

from servolink.support.files import open_without_waiting

_FLAGS = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
_PRIVATE = 0o600

if sys.platform == "win32":
    import msvcrt
elif sys.platform != "emscripten":
    import fcntl

_locked: WeakValueDictionary[tuple[int, int], BinaryIO] = WeakValueDictionary()
"""Files that are locked in Pyodide, where there is no other program and no lock of the system, by device and inode."""
_BEYOND_CONTENT = (
    2**30
)  # position of the locked byte, beyond all content: on Windows other programs cannot read locked bytes


def lock(file: BinaryIO, *, wait: bool) -> bool:
    """Lock a file until the file is closed. Return whether the lock was acquired."""
    try:
        if sys.platform == "win32":
            file.seek(_BEYOND_CONTENT)
            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
        elif sys.platform != "emscripten":
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        else:
            status = os.fstat(file.fileno())
            owner = _locked.setdefault((status.st_dev, status.st_ino), file)
            if owner.closed:
                owner = _locked[status.st_dev, status.st_ino] = file
            if owner is not file:
                return False
    except OSError:
        return False
    finally:
        if sys.platform == "win32":
            file.seek(0)
    return True


class LockedFile:
    """File that this program has locked."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        """Hold the locked `file` at `path`."""
        self.path = path
        self.file = file

    @classmethod
    def open(cls, path: Path) -> Self | None:
        """Open or create the file at `path`, and lock the file. Return None if another lock exists.

        A file must be removed while it is locked. Raise OSError if the file cannot be opened.
        """
        while True:
            file = os.fdopen(os.open(path, _FLAGS, _PRIVATE), "r+b", buffering=0)
            try:
                is_locked = lock(file, wait=False)
                if is_locked and _is_at(path, file):
                    return cls(path, file)
            except BaseException:
                file.close()
                raise
            file.close()
            if not is_locked:
                return None

    @staticmethod
    def is_left_over(file: BinaryIO) -> bool:
        """Return whether the program that had locked a file has ended; lock the file then.

        False in a page of a browser, which has the files of its only program in memory.
        """
        return sys.platform != "emscripten" and lock(file, wait=False)

    def remove(self) -> None:
        """Remove and close the file. Raise OSError if the file cannot be removed.

        The lock is held until the file is removed: another program could create a file of this name before. Windows,
        which removes no open file, refuses to remove a file that another program has opened.
        """
        try:
            if sys.platform == "win32":
                self.file.close()
            self.path.unlink(missing_ok=True)
        finally:
            self.file.close()


def claim_device(path: str) -> AbstractContextManager[object]:
    """Keep other servolinks from a device file until the context ends; on Linux, where any program can open the device.

    Raise OSError if the device cannot be opened, BlockingIOError if another servolink uses it.
    """
    if sys.platform != "linux":
        return nullcontext()
    else:
        file = open(path, "r+b", buffering=0, opener=open_without_waiting)  # noqa: SIM115 - the caller closes it
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BaseException:
            file.close()
            raise
        return file


def _is_at(path: Path, file: BinaryIO) -> bool:
    """Return whether `path` still leads to the file: the previous owner of the lock may have removed the file."""
    try:
        return os.path.samestat(os.fstat(file.fileno()), path.lstat())
    except FileNotFoundError:
        return False
