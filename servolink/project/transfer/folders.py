"""Folder of backups and journals."""

from __future__ import annotations

from pathlib import Path

from servolink.errors import ProjectError
from servolink.support import user_folder

IMPORTS = "imports"
"""Folder of the journals."""


def data_folder() -> Path:
    """Return the user's folder of data. Raise ProjectError if it is unknown."""
    try:
        return Path(user_folder("data"))
    except OSError as error:
        raise ProjectError(f"backups of boards cannot be kept: {error.strerror}") from error
