"""A hub on a fake board with records, and what it reports."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

from msgspec import Struct

from servolink.boards import BoardProfile, SafetyLimits
from servolink.control import LeaseNotice
from servolink.hub.hub import Hub, share
from servolink.project import Project
from servolink.protocol import (
    ALL_SERVOS,
    Action,
    ExecuteActionRequest,
    Macro,
    MacroCommand,
    Packet,
    SetServoParameterRequest,
    Step,
)
from tests.client.piped_board import PipedBoard, opened
from tests.hub.raw_program import RawProgram
from tests.project.pulled import contents_of
from tests.virtual_time import run

STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
START = SetServoParameterRequest(1, 1, 1)
MOVE = ExecuteActionRequest((Step(1, 30, 200),))
STORED = Project(
    actions=(Action(1, "near", (Step(1, 30, 300),)), Action(2, "far", (Step(1, 90, 300),))),
    macros=(
        Macro(1, "near", (MacroCommand(1), MacroCommand(1000, 1))),
        Macro(2, "far", (MacroCommand(2),)),
        Macro(3, "endless", (MacroCommand(1), MacroCommand(3, 2))),
    ),
)


class World:
    """A hub on a fake board, and what the hub reported."""

    def __init__(self, hub: Hub, fake: PipedBoard) -> None:
        self.hub, self.fake = hub, fake
        self.notices: list[Struct] = []
        self.sessions: list[str] = []
        """The sessions that caused the notices."""
        hub.listen(self._hear)

    def join(self, who: str, **options: Any) -> RawProgram:
        return RawProgram(self.hub, who, **options)

    def of(self, kind: type[Any]) -> list[Any]:
        """Return the notices of one kind."""
        return [notice for notice in self.notices if isinstance(notice, kind)]

    def sessions_of(self, kind: type[Any]) -> list[str]:
        """Return the sessions that caused the notices of one kind."""
        pairs = zip(self.notices, self.sessions, strict=True)
        return [session for notice, session in pairs if isinstance(notice, kind)]

    def _hear(self, notice: Struct, session: str) -> None:
        self.notices.append(notice)
        self.sessions.append(session)

    @property
    def lease_events(self) -> list[str]:
        return [change.event for change in self.of(LeaseNotice)]

    @property
    def motions(self) -> list[Packet]:
        """Return the motions that the board got."""
        return [packet for _, packet in self.fake.executed if packet.is_motion]

    async def move(self, program: RawProgram, packet: Packet = MOVE) -> bool:
        """Return whether the board got a motion of a program."""
        before = len(self.motions)
        program.send(packet)
        await asyncio.sleep(0.2)
        return len(self.motions) > before


@asynccontextmanager
async def world(limits: SafetyLimits | None = None, **options: Any) -> AsyncIterator[World]:
    fake = PipedBoard()
    fake.storage.contents = contents_of(STORED)
    for servo in fake.servos.values():
        servo.angle = 0.0
    profile = BoardProfile(limits=limits or SafetyLimits())
    async with (
        opened(fake, angle_unit=None, profile=profile, **options) as board,
        share(board, name="rex") as hub,
    ):
        yield World(hub, fake)


def on_hub(use: Callable[[World], Awaitable[None]], limits: SafetyLimits | None = None, **options: Any) -> None:
    async def main() -> None:
        async with world(limits, **options) as there:
            await use(there)

    run(main())
