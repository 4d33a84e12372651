"""Files read and written whole."""

from __future__ import annotations

import errno
import os
import re
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import IO, BinaryIO, Literal

MIB = 1024 * 1024

_NO_SYNC = {errno.EINVAL, errno.ENOTSUP}
"""Errors of network file systems without a way to write a folder to the disk on demand."""
_TEMPORARY = re.compile(r"\.servolink-[0-9a-f]{16}")
_ABANDONED = 3600
"""Age of an abandoned temporary file, in seconds: no program writes a file for so long."""
_PRIVATE = 0o600
_NAME = re.compile(r"(?!com\d+$)[a-z0-9][a-z0-9_-]{0,63}", re.IGNORECASE | re.ASCII)


ALL = "all"
"""Name for every board of a fleet, and therefore not allowed as the name of a single board."""


def is_name(text: str) -> bool:
    """Return whether `text` can be a board's name: letters, digits, - and _; nothing like an address or a path."""
    return _NAME.fullmatch(text) is not None


def read_file(path: Path, limit: int) -> bytes:
    """Return the content of a regular file of at most `limit` bytes.

    Raise OSError for a larger file, and without waiting for a pipe or a device, whose content may never end.
    Raise ValueError for a name invalid on every system, such as a name with NUL.
    """
    with open_file(path) as file:
        status = os.fstat(file.fileno())
        content = _read_up_to(file, limit + 1) if status.st_size <= limit else b""
    if max(status.st_size, len(content)) > limit:
        raise OSError(errno.EFBIG, f"is larger than {_size(limit)}, the limit", str(path))
    return content


def read_text(path: Path, limit: int) -> str:
    """Return the text of a file as `read_file` does, without the mark that some editors put in front.

    Raise UnicodeDecodeError, which `reason` explains, for a file in another encoding than UTF-8.
    """
    return read_file(path, limit).decode("utf-8-sig")


def open_file(path: Path, *, writable: bool = False) -> FileIO:
    """Open a regular file for reading, with `writable` also for writing, without a buffer.

    Raise OSError, without waiting, for a pipe or a device. Raise ValueError for a name invalid on every system.
    """
    _refuse_irregular(path, path.stat())  # a device must not even be opened: opening can change its state
    mode: Literal["rb", "r+b"] = "r+b" if writable else "rb"
    file = open(path, mode, buffering=0, opener=open_without_waiting)  # noqa: SIM115 - the caller closes it
    try:
        _refuse_irregular(path, os.fstat(file.fileno()))  # the file may have been replaced since the first check
    except BaseException:
        file.close()
        raise
    return file


def write_atomically(path: Path, content: bytes, *, private: bool = False) -> None:
    """Replace the content of `path` as `atomic_file` does. Raise OSError for a failure.

    With `private`, missing folders are made, for their owner only.
    """
    for folder in reversed((path.parent, *path.parent.parents) if private else ()):
        if not folder.exists():
            folder.mkdir(mode=0o700, exist_ok=True)
    with atomic_file(path, private=private) as file:
        file.write(content)


@contextmanager
def atomic_file(path: Path, *, private: bool = False) -> Iterator[BinaryIO]:
    """Yield a file that replaces `path` when the context ends, whole or, on any failure, not at all.

    A link stays a link, and an existing file keeps its permissions. A new file gets the usual permissions, or with
    `private` can be read by its owner only. Nothing but a regular file is replaced, no device or pipe, and no file
    without write permission for this user. Temporary files of killed programs in the folder are removed.

    Raises:
        OSError: The file cannot or must not be written.

    """
    if path.is_symlink():
        path = path.parent / os.path.realpath(path)  # absolute, so the folder in front has no effect
    if path.exists():
        _refuse_irregular(path, path.stat())
        if not os.access(path, os.W_OK):  # replacing the file would ignore its write protection
            raise PermissionError(errno.EACCES, "is write-protected; allow writing first", str(path))
    temporary = path.with_name(f".servolink-{os.urandom(8).hex()}")
    try:
        with open(temporary, "xb", opener=_create_private if private else None) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        with suppress(FileNotFoundError):
            temporary.chmod(stat.S_IMODE(path.stat().st_mode))
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):  # the first failure is the one to report
            temporary.unlink()
        raise
    _keep_name(path.parent)
    _remove_abandoned(path.parent)


def reason(error: Exception) -> str:
    """Return the text of an error of this module; of an error of the system, without number and path."""
    if isinstance(error, UnicodeDecodeError):
        return f"is not text in UTF-8 (byte {error.start}); save the file as UTF-8"
    if isinstance(error, NotADirectoryError):
        return f"{error.strerror}: a file stands where a folder is needed; set HOME, or the path, to a folder"
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def open_without_waiting(path: str, flags: int) -> int:
    """Open a file or device without waiting for the other end of a pipe; usable as `opener` of `open`."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))


def _refuse_irregular(path: Path, status: os.stat_result) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is not a regular file", str(path))


def _create_private(path: str, flags: int) -> int:
    return os.open(path, flags, _PRIVATE)


def _read_up_to(file: IO[bytes], most: int) -> bytes:
    parts: list[bytes] = []
    while most > 0 and (part := file.read(min(most, MIB))):
        parts.append(part)
        most -= len(part)
    return b"".join(parts)


def _size(limit: int) -> str:
    return f"{limit // MIB} MiB" if limit >= MIB and limit % MIB == 0 else f"{limit:,} bytes"


def _keep_name(folder: Path) -> None:
    """Write the folder to the disk, except on Windows, so that a power failure cannot lose a new name."""
    with suppress(PermissionError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            if error.errno not in _NO_SYNC:
                raise
        finally:
            os.close(descriptor)


def _remove_abandoned(folder: Path) -> None:
    """Remove old temporary files of `write_atomically`, and ignore failures."""
    oldest = time.time() - _ABANDONED
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _TEMPORARY.fullmatch(entry.name):
                status = entry.stat(follow_symlinks=False)
                if stat.S_ISREG(status.st_mode) and status.st_mtime < oldest:
                    (folder / entry.name).unlink()
