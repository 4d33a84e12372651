"""Fleet: many boards through a broker, with the verbs of `servolink fleet`."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Iterable, Mapping
from pathlib import Path
from typing import Any, Self

from servolink.control import Applied
from servolink.errors import NotFound, ServolinkError, quote
from servolink.fleet import stop_boards, together
from servolink.fleet.access import BrokerAccess
from servolink.fleet.broker_messages import Publication
from servolink.fleet.checks import Check, examine_fleet
from servolink.fleet.controller import Controller
from servolink.fleet.each import Outcomes
from servolink.fleet.groups import Groups, chosen_boards, load_groups, named_boards
from servolink.fleet.roster import BoardSeen
from servolink.fleet.stop_boards import Stopped
from servolink.fleet.together import Kind, RanTogether
from servolink.fleet.topics import PREFIX, BoardTopic, Topics
from servolink.fleet.transfer import PARALLEL, BoardPlan, Transfer
from servolink.project import Project
from servolink.support import ALL

On = str | Iterable[str]
"""Selection of boards: `all`, or names of boards and groups, as a text with commas or as several texts."""


_KEPT: tuple[BoardTopic, ...] = ("state", "vitals", "pulse", "available")  # by the last, others forget the board, too


class Fleet:
    """Boards known to a broker. Use `connect`.

    `on` is "all" for the connected boards, or names of boards and groups, with commas between them or in a list. What
    fails on single boards is in the result.

    Raises:
        OpenError: The broker cannot be reached. From `async with`.
        ConnectionLost: The connection with the broker was lost.
        NotFound: A name is neither a board nor a group, or no board is connected.
        ServolinkError: The file of groups cannot be used; the text names file and line.
    """

    def __init__(
        self,
        access: BrokerAccess,
        prefix: str,
        groups: Groups | Path | None,
        *,
        with_servos: bool = False,
        may_move: bool = True,
    ) -> None:
        """Enter the fleet with `async with` to connect."""
        self._groups = groups
        self.controller = Controller(access, Topics(prefix), with_servos=with_servos, may_move=may_move)

    async def __aenter__(self) -> Self:
        """Connect with the broker, and learn the names of the boards. Raise OpenError on failure."""
        await self.controller.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        """Disconnect."""
        await self.controller.__aexit__()

    @property
    def groups(self) -> Groups:
        """Names of boards by group; a file is read again each time. Raise ServolinkError for an unusable file."""
        return load_groups(self._groups) if self._groups is None or isinstance(self._groups, Path) else self._groups

    def boards(self, on: On = ALL) -> tuple[str, ...]:
        """Return the board names for `on`. Raise NotFound for any name that is neither board nor group."""
        roster = self.controller.roster
        return chosen_boards(on, roster.online, self.groups, (board.name for board in roster))

    async def list(self) -> tuple[BoardSeen, ...]:
        """Return the known state of every board, offline boards included."""
        await self.controller.settle()
        return tuple(self.controller.roster)

    async def watch(self, hz: float = 1.0) -> AsyncGenerator[tuple[BoardSeen, ...], None]:
        """Yield the known state of every board, `hz` times a second."""
        await self.controller.settle()
        while True:
            yield tuple(self.controller.roster)
            await asyncio.sleep(1 / hz)

    async def call(
        self, board: str, method: str, params: Mapping[str, Any] | None = None, *, patience: float | None = None
    ) -> Any:
        """Return the result of a method of the control interface. Raise the library's error for a reported failure.

        Without an answer in `patience` seconds, 10 unless given, raise OutcomeUnknown if the method moves or changes
        something, else RequestTimeout.
        """
        return await self.controller.call(board, method, params, patience=patience)

    async def run(
        self,
        name: int | str,
        on: On = ALL,
        *,
        kind: Kind | None = None,
        anyway: bool = False,
        start: bool = False,
    ) -> RanTogether:
        """Start an action or a macro, by caption or id, on several boards at the same moment.

        All prepare first, and with `start`, start and hold servos of the run that are stopped or released. If one
        cannot, nobody starts, unless `anyway`: then the others do.
        """
        await self.controller.settle()
        boards = self.boards(on)
        return await together.run_by_name(self.controller, boards, name, kind, anyway=anyway, start=start)

    async def stop(self, on: On = ALL, *, patience: float = stop_boards.PATIENCE) -> Stopped:
        """Stop all servos of all boards, or of those of `on`: names of groups, and of boards whether known or not.

        Boards that do not answer within `patience` seconds are named. The file of groups is read only for `on`.
        """
        chosen = None if on == ALL else named_boards(on, self.groups)
        return await stop_boards.stop_all(self.controller, chosen, patience=patience)

    async def plan(
        self,
        project: Project,
        on: On = ALL,
        *,
        replace: bool = False,
        unchecked: bool = False,
        parallel: int = PARALLEL,
    ) -> Outcomes[BoardPlan]:
        """Return what `apply` would change on each board. Nothing is changed."""
        await self.controller.settle()
        boards = Transfer(self.controller, self.boards(on), parallel=parallel)
        return await boards.plan(project, replace=replace, unchecked=unchecked)

    async def apply(
        self,
        project: Project,
        on: On = ALL,
        *,
        replace: bool = False,
        unchecked: bool = False,
        backup: bool = True,
        parallel: int = PARALLEL,
        fail_fast: bool = False,
    ) -> Outcomes[Applied]:
        """Make each board hold `project`; the options are those of `Board.apply_project`.

        A failure of one ends nothing on the others; with `fail_fast`, no further board is begun after one. Call it
        again to go on: what is done is not done again.
        """
        await self.controller.settle()
        boards = Transfer(self.controller, self.boards(on), parallel=parallel, fail_fast=fail_fast)
        return await boards.apply(project, replace=replace, unchecked=unchecked, backup=backup)

    async def export(self, folder: str | Path, on: On = ALL, *, parallel: int = PARALLEL) -> Outcomes[Path]:
        """Write the content of each board to `BOARD.servolink.json` in `folder`, created if missing."""
        await self.controller.settle()
        path = Path(folder)
        await asyncio.to_thread(path.mkdir, parents=True, exist_ok=True)
        return await Transfer(self.controller, self.boards(on), parallel=parallel).export(path)

    async def forget(self, *boards: str) -> None:
        """Remove retained messages of boards that have left for good. A board that joins again becomes known again.

        Raise NotFound for a board that is unknown, ServolinkError for one that is connected: then none is removed.
        Raise OpenError if the broker does not allow it.
        """
        names = tuple(dict.fromkeys(boards))
        controller = self.controller
        await controller.settle()
        for name in names:
            _check_away(controller, name)
        for name in names:
            for topic in _KEPT:
                if controller.roster.get(name) is not None:
                    _check_away(controller, name)  # the board may have joined meanwhile
                await controller.broker.send(Publication(controller.topics.board(name, topic), b"", 1, retain=True))

    async def doctor(self) -> tuple[Check, ...]:
        """Return the problems of the broker, the network and the boards; empty if there are none."""
        return await examine_fleet(self.controller)


def connect(
    broker: str | BrokerAccess = "mqtt://localhost",
    *,
    prefix: str = PREFIX,
    groups: Groups | str | Path | None = None,
    servos: bool = False,
    may_move: bool = True,
) -> Fleet:
    """Return the fleet at `broker` under `prefix`, to be used with `async with`.

    `broker` is its address, or what `servolink.fleet.BrokerAccess.of` returns, with certificates and a password.
    `groups` are names by group, or the file they are in: the user's `fleet.toml` unless given. `servos` subscribes to
    the states of all servos too. Without `may_move` the program can watch and stop, but not move or write, and is sent
    half as many messages when a fleet stops, and none while it rests. Raise InvalidAddress for an impossible address.
    """
    access = BrokerAccess.of(broker) if isinstance(broker, str) else broker
    file = Path(groups) if isinstance(groups, str) else groups
    return Fleet(access, prefix, file, with_servos=servos, may_move=may_move)


def _check_away(controller: Controller, name: str) -> None:
    """Raise NotFound for an unknown board, ServolinkError for a connected board."""
    seen = controller.roster.get(name)
    if seen is None:
        raise NotFound(f"{quote(name)} is unknown to the broker; nothing was forgotten")
    if seen.is_online:
        raise ServolinkError(
            f"{name} is connected, and cannot be forgotten: end `servolink fleet join` on its machine first"
        )
