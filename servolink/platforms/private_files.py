"""Private files and folders of the user of the process."""

from __future__ import annotations

import errno
import os
import stat
import sys
from pathlib import Path

from servolink.platforms.user_folders import user_folder

_PRIVATE = 0o700


def private_folder() -> Path:
    """Return the runtime folder of the user, created if necessary. Raise OSError if others can write to the folder."""
    folder = user_folder("runtime")
    folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
    refuse_foreign(folder, folder.lstat())  # a foreign folder or a link could redirect all writing
    return folder


def others_can_read(file: Path) -> bool:
    """Return whether other users can read a file; on Windows, the folder of the user decides. Raise OSError."""
    return sys.platform != "win32" and bool(file.stat().st_mode & 0o077)


def refuse_foreign(folder: Path, status: os.stat_result) -> None:
    """Raise PermissionError unless `status` describes a private folder of the user."""
    if not is_own(status):
        raise PermissionError(
            errno.EPERM,
            f"{folder} belongs to another user, or is writable for others; correct or remove the folder",
        )


def is_own(status: os.stat_result) -> bool:
    """Return whether `status` describes a folder, not a link, where only the user can create files."""
    if sys.platform == "win32":
        return stat.S_ISDIR(status.st_mode)  # inside the user's profile
    else:
        return stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & 0o022
