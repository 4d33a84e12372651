"""Twin of a studio's robot: verdicts made in the background, and runs shown on the page; no board is touched."""

from __future__ import annotations

import asyncio
import hashlib
import json
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Final
from weakref import WeakKeyDictionary

from servolink.errors import ProjectError
from servolink.project import Figure, Project, dependency_order, project_of
from servolink.protocol import ACTION, MACRO, Action, Macro, RecordType
from servolink.support import computed
from servolink.twin import Fall, Frame, Judged, PhysicsProcess, Reached, Vector

MOST_VERDICTS: Final = 4096
"""Verdicts that are kept, the latest."""


@dataclass(frozen=True)
class Robot:
    """Project with the figure of its robot."""

    project: Project
    figure: bytes
    """JSON text of the figure."""

    @classmethod
    def of(cls, project: Project, figure: Figure) -> Robot:
        """Return the robot of a figure. Raise EncodeError for a figure that cannot be drawn."""
        return cls(project, json.dumps(figure.checked().to_json()).encode())

    def key(self, record: Action | Macro) -> bytes:
        """Return a key that changes with the figure, a record of the project, and each record run by it.

        Raise ProjectError for a duplicate id in the project.
        """
        kind = RecordType.of(record)
        return self._keys[kind.field, kind.id_of(record)]

    @cached_property
    def _keys(self) -> dict[tuple[str, int], bytes]:
        """Keys of all actions and macros; that of a macro is made from the keys of the records that it runs."""
        shelves = self.project.by_type()
        macros: dict[int, Macro] = shelves[MACRO.field]
        of_figure = hashlib.sha256(self.figure)

        def digest(record: Action | Macro, used: object) -> bytes:
            made = of_figure.copy()
            made.update(repr((record, used)).encode("utf-8", "surrogatepass"))
            return made.digest()

        found = {(ACTION.field, number): digest(action, ()) for number, action in shelves[ACTION.field].items()}
        for number in dependency_order(macros):
            used = [found.get((kind.field, called)) for kind, called in MACRO.references(macros[number])]
            found[MACRO.field, number] = digest(macros[number], used)
        endless = {number for number in macros if (MACRO.field, number) not in found}
        return found | {(MACRO.field, number): digest(macros[number], "endless") for number in endless}


class Twin:
    """Twin of the robots that pages of a studio show."""

    def __init__(self) -> None:
        """Know no verdicts yet."""
        self._worker = PhysicsProcess()
        self._verdicts = dict[bytes, Judged | None]()
        self._turn = asyncio.Lock()
        self._latest = WeakKeyDictionary[object, dict[str, object]]()

    def begin(self, page: object, purpose: str) -> Callable[[], bool]:
        """Return a function that returns whether no other work of this purpose was begun for the page since."""
        mark = object()
        self._latest.setdefault(page, {})[purpose] = mark
        return lambda: self._latest[page][purpose] is mark

    def known(self, robot: Robot, record: Action | Macro) -> bool:
        """Return whether the verdict about a record was made."""
        return robot.key(record) in self._verdicts

    async def verdict(self, robot: Robot, record: Action | Macro) -> Judged | None:
        """Return the verdict about a record, made in the background; None for a macro that no board could play.

        Raise TwinError for a figure without a possible body, or without MuJoCo.
        """
        key = await computed(robot.key)(record)
        if key not in self._verdicts:
            async with self._turn:  # the process has one body for all verdicts about a figure
                if key not in self._verdicts:
                    self._verdicts[key] = await self._judge(robot, record)
        verdict = self._verdicts.pop(key)
        self._verdicts[key] = verdict  # the oldest are forgotten first
        if len(self._verdicts) > MOST_VERDICTS:
            del self._verdicts[next(iter(self._verdicts))]
        return verdict

    async def _judge(self, robot: Robot, record: Action | Macro) -> Judged | None:
        project = await computed(project_of)(robot.project, record)  # all records take long to pass to the process
        work = self._worker.judge(robot.figure, project, record)
        with suppress(ProjectError):
            async with aclosing(work) as pieces:
                async for piece in pieces:
                    if isinstance(piece, Judged):
                        return piece
        return None

    async def play(self, robot: Robot, record: Action | Macro) -> AsyncGenerator[tuple[Frame, Fall | None], None]:
        """Yield the frames of a run, each at its time, with the fall once the robot has fallen.

        Raises:
            ProjectError: No board could play the macro.
            TwinError: The figure has no possible body, or MuJoCo is missing.
        """
        now = asyncio.get_running_loop().time
        due = now()
        project = await computed(project_of)(robot.project, record)
        async with aclosing(self._worker.play(robot.figure, project, record)) as pieces:
            async for piece in pieces:
                due = max(due, now())  # a slow computer shows the run slowly, and leaves nothing out
                for frame in piece.frames:
                    await asyncio.sleep(due - now())
                    due += Frame.SECONDS
                    yield frame, piece.fall

    async def pull(self, figure: bytes, joint: str, move: Vector, start: dict[int, float]) -> Reached:
        """Return the pose after the tip of a joint was pulled, as `servolink.twin.jobs.pull` does."""
        return await self._worker.pull(figure, joint, move, start)

    async def close(self) -> None:
        """End the process with the physics."""
        await self._worker.close()
