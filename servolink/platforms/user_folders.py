"""Folders of the user: settings, data, and files that live as long as the session."""

from __future__ import annotations

import errno
import os
import sys
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from pathlib import Path

Kind = Literal["config", "data", "runtime"]

_NAME = "servolink"
_LINUX = {"config": ("XDG_CONFIG_HOME", ".config"), "data": ("XDG_DATA_HOME", ".local/share")}
"""Variable with the folder of one kind, and the usual place below the home of the user."""


def user_folder(kind: Kind) -> Path:
    """Return the folder of the user for one kind of files. Raise OSError for a user without a home."""
    from pathlib import Path  # late, as below: most commands need no more than the name

    return Path(user_folder_name(kind))


def user_folder_name(kind: Kind) -> str:
    """Return the path of `user_folder` as text.

    Every connection looks for profiles, and platformdirs takes 6 ms to load: on Linux, the usual cases are answered
    without it.
    """
    if sys.platform == "linux" and kind in _LINUX:
        variable, below_home = _LINUX[kind]
        base, home = os.environ.get(variable, ""), os.environ.get("HOME", "")
        if base.startswith("/"):
            return os.path.join(base, _NAME)  # noqa: PTH118 - loading `pathlib` takes 3 ms
        if home.startswith("/"):
            return os.path.join(home, below_home, _NAME)  # noqa: PTH118 - loading `pathlib` takes 3 ms
    return _ask_platformdirs(kind)


def _ask_platformdirs(kind: Kind) -> str:
    import warnings

    import platformdirs

    find = {
        "config": platformdirs.user_config_dir,
        "data": platformdirs.user_data_dir,
        "runtime": platformdirs.user_runtime_dir,
    }[kind]
    with warnings.catch_warnings():  # without a runtime folder, platformdirs warns and takes a folder in /tmp
        warnings.simplefilter("ignore")
        try:
            return find(_NAME, appauthor=False)
        except RuntimeError as error:
            raise OSError(errno.ENOENT, f"{error}; set HOME") from error
