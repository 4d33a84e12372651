"""Files read and written whole, and the user's folders."""

from __future__ import annotations

import errno
import os
import re
import stat
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import IO, BinaryIO, Literal

MIB = 1024 * 1024

_NO_SYNC = {errno.EINVAL, errno.ENOTSUP}
"""The errors of network file systems that cannot write a folder to the disk on demand."""
_TEMPORARY = re.compile(r"\.servolink-[0-9a-f]{16}")
_ABANDONED = 3600
"""The age in seconds at which a temporary file is certainly not being written any more."""
_PRIVATE = 0o600
_NAME = re.compile(r"(?!com\d+$)[a-z0-9][a-z0-9_-]{0,63}", re.IGNORECASE | re.ASCII)


ALL = "all"
"""Stands for every board of a fleet, so no board may be called so."""


def is_name(text: str) -> bool:
    """Return whether `text` can be a board's name: letters, digits, - and _; nothing like an address or a path."""
    return _NAME.fullmatch(text) is not None


def read_file(path: Path, limit: int) -> bytes:
    """Return the content of a regular file of at most `limit` bytes.

    Raise OSError, without waiting, for a pipe or a device, which may never come to an end, and for a larger file.
    Raise ValueError for a name that no system has, such as one with NUL.
    """
    with open_file(path) as file:
        status = os.fstat(file.fileno())
        content = _read_up_to(file, limit + 1) if status.st_size <= limit else b""
    if max(status.st_size, len(content)) > limit:
        raise OSError(errno.EFBIG, f"is larger than {_size(limit)}, the most that is read", str(path))
    return content


def open_file(path: Path, *, writable: bool = False) -> FileIO:
    """Open a regular file for reading, and for writing if it is to be `writable`, without a buffer.

    Raise OSError, without waiting, for a pipe or a device. Raise ValueError for a name that no system has.
    """
    _refuse_irregular(path, path.stat())  # a device must not even be opened: that alone can change its state
    mode: Literal["rb", "r+b"] = "r+b" if writable else "rb"
    file = open(path, mode, buffering=0, opener=open_without_waiting)  # noqa: SIM115 - the caller closes it
    try:
        _refuse_irregular(path, os.fstat(file.fileno()))  # it may be another file by now
    except BaseException:
        file.close()
        raise
    return file


def write_atomically(path: Path, content: bytes, *, private: bool = False) -> None:
    """Replace the content of `path` as `atomic_file` does. Raise OSError for a failure."""
    with atomic_file(path, private=private) as file:
        file.write(content)


@contextmanager
def atomic_file(path: Path, *, private: bool = False) -> Iterator[BinaryIO]:
    """Yield a file that replaces `path` when the context ends, whole or, on any failure, not at all.

    A link stays a link, and an existing file keeps its permissions. A new file gets the usual ones, or, if `private`,
    only its owner can read it. Anything but a regular file, such as a device or a pipe, is left alone, and so is a file
    that this user may not write. Temporary files left here by a program that was killed are removed. Raise OSError for
    a failure.
    """
    if path.is_symlink():
        path = Path(os.path.realpath(path))
    if path.exists():
        _refuse_irregular(path, path.stat())
        if not os.access(path, os.W_OK):  # of which replacing it would take no notice
            raise PermissionError(errno.EACCES, "is write-protected; allow writing to it first", str(path))
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
    """Return the text of an error from here, without number and path where it is the system's."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def user_folder(kind: Literal["config", "data", "runtime"]) -> Path:
    """Return this user's folder for servolink's files of this kind. Raise OSError for a user without a home."""
    import platformdirs  # most programs start without it

    find = {
        "config": platformdirs.user_config_path,
        "data": platformdirs.user_data_path,
        "runtime": platformdirs.user_runtime_path,
    }[kind]
    with warnings.catch_warnings():  # where the system has no runtime folder, platformdirs warns and takes one in /tmp
        warnings.simplefilter("ignore")
        try:
            return find("servolink", appauthor=False)
        except RuntimeError as error:
            raise OSError(errno.ENOENT, f"{error}; set HOME") from error


def open_without_waiting(path: str, flags: int) -> int:
    """Open a device, or a file that may have become a pipe, whose other end may never come; an `opener` for `open`."""
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
    """Write the folder itself to the disk, or a power failure can lose the new name. Windows has nothing like it."""
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
    """Remove old temporary files of `write_atomically`; failing to do so is not worth an error."""
    oldest = time.time() - _ABANDONED
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _TEMPORARY.fullmatch(entry.name):
                status = entry.stat(follow_symlinks=False)
                if stat.S_ISREG(status.st_mode) and status.st_mtime < oldest:
                    Path(entry.path).unlink()
