"""Folder of backups and journals, and whether it holds a journal, found without loading transfers."""

from __future__ import annotations

from pathlib import Path

from servolink.errors import ProjectError
from servolink.files import user_folder

IMPORTS = "imports"
"""Folder of the journals."""


def data_folder() -> Path:
    """Return the user's folder of data. Raise ProjectError if it is unknown."""
    try:
        return user_folder("data")
    except OSError as error:
        raise ProjectError(f"backups of boards cannot be kept: {error.strerror}") from error


def may_have_journals(folder: Path | None) -> bool:
    """Return whether there may be journals of imports in `folder`; None stands for the user's folder of data."""
    try:
        return any(((folder or data_folder()) / IMPORTS).iterdir())
    except FileNotFoundError:
        return False
    except (OSError, ValueError):  # raised again, with the remedy, when the journals are read
        return True
