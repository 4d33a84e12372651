"""Folder of backups and journals, and whether it holds a journal, found without loading transfers."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from servolink.errors import ProjectError
from servolink.platforms.user_folders import user_folder_name

if TYPE_CHECKING:
    from pathlib import Path

IMPORTS = "imports"
"""Folder of the journals."""


def data_folder() -> Path:
    """Return the user's folder of data. Raise ProjectError if it is unknown."""
    from pathlib import Path  # late: commands only look for journals

    return Path(_data_folder_name())


def _data_folder_name() -> str:
    try:
        return user_folder_name("data")
    except OSError as error:
        raise ProjectError(f"backups of boards cannot be kept: {error.strerror}") from error


def may_have_journals(folder: Path | None) -> bool:
    """Return whether there may be journals of imports in `folder`; None stands for the user's folder of data."""
    try:
        return bool(os.listdir(os.path.join(folder or _data_folder_name(), IMPORTS)))  # noqa: PTH118, PTH208 - loading `pathlib` takes 3 ms
    except FileNotFoundError:
        return False
    except (OSError, ValueError):  # raised again, with the remedy, when the journals are read
        return True
