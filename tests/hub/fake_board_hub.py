"""A hub of a fake board, for tests of programs that share it."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

from servolink.hub.hub import Hub, share
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionRequest,
    Packet,
    SetServoParameterRequest,
    Step,
)
from tests.client.piped_board import PipedBoard, opened
from tests.virtual_time import run

STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
START = SetServoParameterRequest(ALL_SERVOS, 1, 1)
MOVE = ExecuteActionRequest((Step(1, 30, 100),))


@asynccontextmanager
async def shared(fake: PipedBoard, **options: Any) -> AsyncIterator[Hub]:
    """Share a fake board."""
    async with opened(fake, angle_unit=None, **options) as board, share(board, name="rex") as hub:
        yield hub


def on_hub(use: Callable[[Hub, PipedBoard], Awaitable[None]], **options: Any) -> None:
    """Run `use` with a hub and its board."""

    async def main() -> None:
        fake = PipedBoard()
        async with shared(fake, **options) as hub:
            await use(hub, fake)

    run(main())


def kinds(packets: list[Packet]) -> list[type[Packet]]:
    return [type(packet) for packet in packets]
