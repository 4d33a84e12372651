"""A disk on which one operation fails."""

from __future__ import annotations

import builtins
import errno
import io
import os
from types import TracebackType
from typing import Any, Self

import pytest

_OPERATIONS = ("chmod", "fsync", "listdir", "mkdir", "open", "rename", "replace", "scandir", "unlink")


class Disk:
    """Counts what the system is asked to do with files, and lets one of it fail."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, failing: int) -> None:
        """Let the operation of this number, counted from 0, fail."""
        self.failed = ""
        """Which one it was."""
        self._left = failing
        for name in _OPERATIONS:
            monkeypatch.setattr(os, name, self._counted(name, getattr(os, name)))
        self._open = io.open
        monkeypatch.setattr(io, "open", self._opened)  # for pathlib
        monkeypatch.setattr(builtins, "open", self._opened)

    def count(self, name: str) -> None:
        """Count one; OSError if it is the one that fails."""
        self._left -= 1
        if self._left == -1:
            self.failed = name
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), name)

    def _counted(self, name: str, operation: Any) -> Any:
        def counted(*args: Any, **options: Any) -> Any:
            self.count(name)
            return operation(*args, **options)

        return counted

    def _opened(self, *args: Any, **options: Any) -> _File:
        self.count("open file")
        return _File(self, self._open(*args, **options))


class _File:
    def __init__(self, disk: Disk, file: Any) -> None:
        self._disk = disk
        self._file = file

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        if name in ("read", "write"):
            self._disk.count(name)
        return getattr(self._file, name)
