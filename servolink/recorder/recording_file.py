"""RecordingFile: a file that always ends with a whole block, whatever the disk does.

The file is locked during the writing, to prevent a repair of an unfinished file. The lock ends with the process.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from servolink.errors import RecordingError
from servolink.support import lock, open_file, reason


class Disk(Protocol):
    """System calls needed by a recording, so that tests can replace the disk."""

    def write(self, descriptor: int, data: memoryview, /) -> int:
        """Write some bytes and return how many."""
        ...

    def fsync(self, descriptor: int, /) -> None:
        """Return when everything is on the disk."""

    def ftruncate(self, descriptor: int, length: int, /) -> None:
        """Cut the file to a length in bytes."""


class RecordingFile:
    """Writes blocks in order; a block that the disk refuses waits for the next attempt."""

    def __init__(self, path: Path, *, disk: Disk = os) -> None:
        """Create the file. Raise RecordingError for an existing file, or an error of the system."""
        self.path = path
        self.size = 0
        """Bytes on the disk, all of whole blocks."""
        self.problem = ""
        """Reason why the waiting block cannot be written; empty without a waiting block."""
        self._disk = disk
        self._waiting = b""
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
        try:
            self._descriptor = os.open(path, flags, 0o666)
        except FileExistsError as error:
            raise RecordingError(f"{path} exists already; remove it or record to another file") from error
        except (OSError, ValueError) as error:
            raise RecordingError(f"cannot record to {path}: {reason(error)}; choose another file") from error

        with os.fdopen(self._descriptor, "wb", buffering=0, closefd=False) as file:
            lock(file, wait=False)  # until the descriptor is closed; some file systems have no locks

    def put(self, block: bytes) -> bool:
        """Write a block after the waiting block, if any. Return whether all bytes are on the disk."""
        self._waiting = self._waiting + block if self._waiting else block
        return self.retry()

    def retry(self) -> bool:
        """Write the waiting block. Return whether no block waits any more."""
        if not self._waiting:
            return True
        try:
            left = memoryview(self._waiting)
            while left:
                left = left[self._disk.write(self._descriptor, left) :]
            self._disk.fsync(self._descriptor)
        except OSError as error:
            self.problem = reason(error)
            with suppress(OSError):  # otherwise the file ends with a partial block, skipped by readers
                self._disk.ftruncate(self._descriptor, self.size)
                os.lseek(self._descriptor, self.size, os.SEEK_SET)
            return False
        self.size += len(self._waiting)
        self._waiting, self.problem = b"", ""
        return True

    def close(self) -> None:
        """Close the file. A waiting block is lost."""
        if self._descriptor >= 0:
            descriptor, self._descriptor = self._descriptor, -1
            with suppress(OSError):
                os.close(descriptor)


def is_being_written(path: Path) -> bool:
    """Return whether a recorder is writing this file; True also on a file system without locks.

    Raise OSError for a missing file, or a file impossible to open.
    """
    try:
        with open_file(path, writable=True) as file:
            return not lock(file, wait=False)
    except PermissionError:  # a file protected after the recording
        return False
