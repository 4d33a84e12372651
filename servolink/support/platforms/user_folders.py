"""Folders of the user: settings, data, and files that live as long as the session; and what is private in them."""

from __future__ import annotations

import errno
import os
import stat
import sys
import warnings
from pathlib import Path
from typing import Literal

import platformdirs

Kind = Literal["config", "data", "runtime"]
_PRIVATE = 0o700


def user_folder(kind: Kind) -> Path:
    """Return the folder of the user for one kind of files. Raise OSError for a user without a home."""
    find = {
        "config": platformdirs.user_config_path,
        "data": platformdirs.user_data_path,
        "runtime": platformdirs.user_runtime_path,
    }[kind]
    with warnings.catch_warnings():  # without a runtime folder, platformdirs warns and takes a folder in /tmp
        warnings.simplefilter("ignore")
        try:
            return find("servolink", appauthor=False)
        except RuntimeError as error:
            raise OSError(errno.ENOENT, f"{error}; set HOME") from error


def private_folder(*, create: bool = True) -> Path:
    """Return the runtime folder of the user, with `create` made if necessary.

    Raise OSError if others can write to the folder.
    """
    folder = user_folder("runtime")
    if create:
        folder.mkdir(mode=_PRIVATE, parents=True, exist_ok=True)
    refuse_foreign(folder, folder.lstat())  # a foreign folder or a link could redirect all writing
    return folder


def others_can_read(file: Path) -> bool:
    """Return whether other users can read a file; on Windows, the folder of the user decides. Raise OSError."""
    return sys.platform != "win32" and bool(file.stat().st_mode & 0o077)


def refuse_foreign(folder: Path, status: os.stat_result) -> None:
    """Raise PermissionError unless `status` describes a private folder of the user."""
    if not _is_own(status):
        raise PermissionError(
            errno.EPERM,
            f"{folder} belongs to another user, or is writable for others; correct or remove the folder",
        )


def _is_own(status: os.stat_result) -> bool:
    """Return whether `status` describes a folder, not a link, where only the user can create files."""
    if sys.platform == "win32" or sys.platform == "emscripten":
        return stat.S_ISDIR(status.st_mode)  # inside the user's profile, or of the only program
    else:
        return stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & 0o022
