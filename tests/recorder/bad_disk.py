"""Disks that are full, slow or fail, for tests."""

from __future__ import annotations

import errno
import os
import threading


class BadDisk:
    """A disk with so many bytes of room, which writes in pieces and may stand still."""

    def __init__(self, room: int = 10**9, piece: int = 10**9) -> None:
        self.room = room
        self.piece = piece
        self.may_write = threading.Event()
        """Writing waits until it is set."""
        self.may_write.set()
        self.is_waiting = threading.Event()
        """Set while somebody waits."""

    def write(self, descriptor: int, data: memoryview, /) -> int:
        if not self.may_write.is_set():
            self.is_waiting.set()
            self.may_write.wait(60)
        size = min(len(data), self.piece, self.room)
        if not size:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.room -= size
        return os.write(descriptor, data[:size])

    def fsync(self, descriptor: int, /) -> None:
        os.fsync(descriptor)

    def ftruncate(self, descriptor: int, length: int, /) -> None:
        self.room += os.fstat(descriptor).st_size - length
        os.ftruncate(descriptor, length)
