"""Data that the studio keeps on this computer for each board, in a file by the name of the board."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from servolink.errors import EncodeError, ProjectError, escape
from servolink.studio.drafts import file_name
from servolink.support import MAX_SIZE, read_file, read_json, reason, user_folder, write_atomically

T = TypeVar("T")
_logger = logging.getLogger(__name__)


def read_kept(kind: str, board: str, convert: Callable[[Any], T]) -> T | None:
    """Return what is kept of a kind, such as `figures`, for a board; None for a missing or unreadable file."""
    try:
        return convert(read_json(read_file(_path(kind, board), MAX_SIZE)))
    except FileNotFoundError:
        return None
    except (OSError, EncodeError, ValueError) as error:
        _logger.warning("the file of %s in %s cannot be read: %s", escape(board), kind, escape(str(error)))
        return None


def write_kept(kind: str, board: str, value: Any) -> None:
    """Keep a value in the form of JSON for a board, None for none. Raise ProjectError if saving fails."""
    try:
        path = _path(kind, board)
        if value is None:
            path.unlink(missing_ok=True)
            return
        write_atomically(path, json.dumps(value).encode(), private=True)
    except OSError as error:
        raise ProjectError(f"the {kind} of a board cannot be kept: {reason(error)}") from error


def _path(kind: str, board: str) -> Path:
    return user_folder("data") / kind / f"{file_name(board)}.json"
