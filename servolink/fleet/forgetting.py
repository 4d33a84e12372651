"""Forget boards that have left for good: the broker keeps their last words until somebody removes them."""

from __future__ import annotations

from collections.abc import Iterable

from servolink.errors import NotFound, ServolinkError
from servolink.escaping import quote
from servolink.fleet.controller import Controller
from servolink.fleet.mqtt_client import Publication
from servolink.fleet.topics import BoardTopic

_KEPT: tuple[BoardTopic, ...] = ("state", "vitals", "pulse", "available")  # by the last, others forget the board, too


async def forget_all(controller: Controller, boards: Iterable[str]) -> None:
    """Remove what the broker keeps of boards. One that joins again is known again.

    Raise NotFound for a board that is unknown, ServolinkError for one that is connected (then none is removed), and
    OpenError or ConnectionLost if the broker does not allow it or is gone.
    """
    names = tuple(dict.fromkeys(boards))
    await controller.settle()
    for name in names:
        _check_away(controller, name)
    for name in names:
        for topic in _KEPT:
            if controller.roster.get(name) is not None:
                _check_away(controller, name)  # it may have joined meanwhile
            await controller.broker.send(Publication(controller.topics.board(name, topic), b"", 1, retain=True))


def _check_away(controller: Controller, name: str) -> None:
    """Raise NotFound for a board that is unknown, ServolinkError for one that is connected."""
    seen = controller.roster.get(name)
    if seen is None:
        raise NotFound(f"{quote(name)} is not known to the broker, so there is nothing to forget")
    if seen.is_online:
        raise ServolinkError(
            f"{name} is connected, and cannot be forgotten: end `servolink fleet join` on its machine first"
        )
