"""The methods for the figure of the robot, which all pages of a studio share."""

from __future__ import annotations

import asyncio
from typing import Any

from msgspec import Struct

from servolink.control.messages import NoParams
from servolink.control.roles import Role
from servolink.project.figure import Figure, checked_figure, figure_to_json
from servolink.studio.figures import read_figure, write_figure
from servolink.studio.methods import METHODS, Caller


class FigureNow(Struct, frozen=True):
    """The figure of the robot; also the notification `studio.figure`, after another page has saved one."""

    figure: dict[str, Any] | None
    """In the form of project files; null if nobody has fitted one, or has opened a file with one."""


class FigureSave(Struct, forbid_unknown_fields=True):
    """What the robot looks like."""

    figure: Figure | None
    """None for a template."""


@METHODS.add("studio.figure.get", Role.WATCH)
async def figure_get(caller: Caller, params: NoParams) -> FigureNow:
    """Return what the robot looks like, if that is known."""
    return _now(await asyncio.to_thread(read_figure, caller.studio.hub))


@METHODS.add("studio.figure.save", Role.EDIT, in_order=True)
async def figure_save(caller: Caller, params: FigureSave) -> FigureNow:
    """Keep what the robot looks like. EncodeError names what is wrong with the figure, and where."""
    figure = None if params.figure is None else checked_figure(params.figure)
    await asyncio.to_thread(write_figure, caller.studio.hub, figure)
    for page in caller.studio.pages - {caller.page}:
        page.notify("studio.figure", _now(figure))
    return _now(figure)


def _now(figure: Figure | None) -> FigureNow:
    return FigureNow(None if figure is None else figure_to_json(figure))
