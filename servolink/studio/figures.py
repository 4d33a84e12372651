"""Figures: what the robot of each board looks like, fitted by its people and kept on this computer."""

from __future__ import annotations

import json
import logging
from pathlib import Path

from servolink.errors import EncodeError, ProjectError
from servolink.escaping import escape
from servolink.files import read_file, reason, user_folder, write_atomically
from servolink.json_text import MAX_SIZE, read_json
from servolink.project.figure import Figure, figure_from_json, figure_to_json
from servolink.studio.drafts import file_name

_logger = logging.getLogger(__name__)


def read_figure(board: str) -> Figure | None:
    """Return the figure of the board of this name, None if there is none, or none that can be read."""
    try:
        path = _path(board)
        return figure_from_json(read_json(read_file(path, MAX_SIZE)))
    except FileNotFoundError:
        return None
    except (OSError, EncodeError, ValueError) as error:
        _logger.warning("the figure of %s cannot be read: %s", escape(board), escape(str(error)))
        return None


def write_figure(board: str, figure: Figure | None) -> None:
    """Keep the figure of a board, None for none. Raise ProjectError if that fails."""
    try:
        path = _path(board)
        if figure is None:
            path.unlink(missing_ok=True)
            return
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_atomically(path, json.dumps(figure_to_json(figure)).encode(), private=True)
    except OSError as error:
        raise ProjectError(f"the figure cannot be kept: {reason(error)}") from error


def _path(board: str) -> Path:
    return user_folder("data") / "figures" / f"{file_name(board)}.json"
