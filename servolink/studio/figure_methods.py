"""Figure of each board's robot: fitted by hand, kept on this computer, shared by all pages of a studio."""

from __future__ import annotations

from typing import Any

from msgspec import Struct

from servolink.control import NoParams, Role, Touches
from servolink.project import Figure
from servolink.studio.kept import read_kept, write_kept
from servolink.studio.studio_methods import METHODS, PageCaller
from servolink.support import computed


def read_figure(board: str) -> Figure | None:
    """Return the figure of a board by name; None for a missing or unreadable figure."""
    return read_kept("figures", board, Figure.from_json)


def write_figure(board: str, figure: Figure | None) -> None:
    """Keep the figure of a board, None for none. Raise ProjectError if saving fails."""
    write_kept("figures", board, None if figure is None else figure.to_json())


class FigureNow(Struct, frozen=True):
    """Figure of the robot; also the notification `studio.figure`, after another page has saved a figure."""

    figure: dict[str, Any] | None
    """Figure in the form of project files; null if nobody has fitted or opened a figure."""


class FigureSave(Struct, forbid_unknown_fields=True):
    """Figure of the robot, to be saved."""

    figure: Figure | None
    """None for a template of the page."""


@METHODS.add("studio.figure.get", Role.WATCH, touches=Touches.NOTHING)
@computed
def figure_get(caller: PageCaller, params: NoParams) -> FigureNow:
    """Return the figure of the robot, null for none."""
    return _now(read_figure(caller.hub))


@METHODS.add("studio.figure.save", Role.EDIT, touches=Touches.HOST, in_order=True, finishes=True)
async def figure_save(caller: PageCaller, params: FigureSave) -> FigureNow:
    """Keep the figure of the robot. EncodeError names the faulty place in the figure."""
    now = await computed(_save)(caller.hub, params.figure)
    caller.tell_others("studio.figure", now)
    return now


def _save(board: str, figure: Figure | None) -> FigureNow:
    figure = None if figure is None else figure.checked()
    write_figure(board, figure)
    return _now(figure)


def _now(figure: Figure | None) -> FigureNow:
    return FigureNow(None if figure is None else figure.to_json())
