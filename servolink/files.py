"""Files that are there whole or not at all, whenever the program is killed or the power fails."""

from __future__ import annotations

import errno
import os
import secrets
import stat
from contextlib import suppress
from pathlib import Path

_NO_SYNC = {errno.EINVAL, errno.ENOTSUP}
"""What network file systems say that cannot write a folder to the disk at will."""


def write_atomically(path: Path, content: bytes) -> None:
    """Let `path` hold `content`, replacing what it held; on any failure it is as it was. OSError says why.

    A link stays one, and a file keeps its permissions; a new one gets the usual ones. What is no file, such as a
    device or a pipe, is left alone.
    """
    if path.is_symlink():
        path = Path(os.path.realpath(path))
    if path.exists() and not (path.is_file() or path.is_dir()):  # a folder is refused by the system, in clear words
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    temporary = path.with_name(f".servolink-{secrets.token_hex(8)}")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        with suppress(FileNotFoundError):
            temporary.chmod(stat.S_IMODE(path.stat().st_mode))
        temporary.replace(path)
    except BaseException:
        with suppress(OSError):  # what went wrong first is what is told
            temporary.unlink()
        raise
    _keep_name(path.parent)


def _keep_name(folder: Path) -> None:
    """Write the folder itself to the disk, without which the new name can be lost; Windows has no such thing."""
    with suppress(PermissionError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        except OSError as error:
            if error.errno not in _NO_SYNC:
                raise
        finally:
            os.close(descriptor)


def read_file(path: Path) -> bytes:
    """Return what a file holds; OSError says why not, also for a pipe or a device, which may never come to an end."""
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "it is no regular file", str(path))
    return path.read_bytes()
