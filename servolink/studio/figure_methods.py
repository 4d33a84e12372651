"""Figure of each board's robot: fitted by hand, kept on this computer, shared by all pages of a studio."""

from __future__ import annotations

import asyncio
import json
import logging
from pathlib import Path
from typing import Any

from msgspec import Struct

from servolink.control.messages import NoParams
from servolink.control.roles import Role
from servolink.errors import EncodeError, ProjectError
from servolink.escaping import escape
from servolink.files import read_file, reason, user_folder, write_atomically
from servolink.json_text import MAX_SIZE, read_json
from servolink.project.figure import Figure, checked_figure, figure_from_json, figure_to_json
from servolink.studio.drafts import file_name
from servolink.studio.studio_methods import METHODS, PageCaller

_logger = logging.getLogger(__name__)


def read_figure(board: str) -> Figure | None:
    """Return the figure of a board by name; None for a missing or unreadable figure."""
    try:
        path = _path(board)
        return figure_from_json(read_json(read_file(path, MAX_SIZE)))
    except FileNotFoundError:
        return None
    except (OSError, EncodeError, ValueError) as error:
        _logger.warning("the figure of %s cannot be read: %s", escape(board), escape(str(error)))
        return None


def write_figure(board: str, figure: Figure | None) -> None:
    """Keep the figure of a board, None for none. Raise ProjectError if saving fails."""
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


class FigureNow(Struct, frozen=True):
    """Figure of the robot; also the notification `studio.figure`, after another page has saved a figure."""

    figure: dict[str, Any] | None
    """Figure in the form of project files; null if nobody has fitted or opened a figure."""


class FigureSave(Struct, forbid_unknown_fields=True):
    """Figure of the robot, to be saved."""

    figure: Figure | None
    """None for a template of the page."""


@METHODS.add("studio.figure.get", Role.WATCH)
async def figure_get(caller: PageCaller, params: NoParams) -> FigureNow:
    """Return the figure of the robot, null for none."""
    return _now(await asyncio.to_thread(read_figure, caller.hub))


@METHODS.add("studio.figure.save", Role.EDIT, in_order=True)
async def figure_save(caller: PageCaller, params: FigureSave) -> FigureNow:
    """Keep the figure of the robot. EncodeError names the faulty place in the figure."""
    figure = None if params.figure is None else checked_figure(params.figure)
    await asyncio.to_thread(write_figure, caller.hub, figure)
    caller.tell_others("studio.figure", _now(figure))
    return _now(figure)


def _now(figure: Figure | None) -> FigureNow:
    return FigureNow(None if figure is None else figure_to_json(figure))
