"""A robot behind a hub, and the motions that reach its board."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import msgspec
from msgspec import Raw

from servolink.client import Board, connect
from servolink.connection import Tap
from servolink.control import Greeting, open_channel
from servolink.gateways.supervisor import Supervisor, supervised
from servolink.hub import serve_board
from servolink.protocol import (
    PACKETS,
    Action,
    FrameParser,
    Macro,
    MacroCommand,
    ServoParameter,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
)

GUARD = 240.0
"""Seconds after which a test has failed."""
NOD = Action(1, "Nod", (Step(1, 10, 20), Step(2, 5, 10)))
LONG = Action(2, "Long", (Step(1, 90, 1500),))
AGAIN = Macro(1, "Again", (MacroCommand(1, loop=2),))
STOP = (SetServoParameterRequest.packet_id, b"\xff\x00\x01")
HARMLESS = {packet_id for packet_id, kind in PACKETS.items() if kind.is_query} | {SetAngleUnitRequest.packet_id}
"""Ids of packets that leave the servos and the memory of the board as they are."""


class RobotSeen(Tap):
    """Robot as seen by its board."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self.log: list[str] = []
        """Lines logged by the supervisor."""
        self.motions: list[int] = []
        """Ids of packets on the line that turn, start or release a servo, or change what is stored."""
        self.stops = 0
        self._parser = FrameParser()
        board.connection.taps.add(self)

    def sent(self, data: bytes) -> None:
        for frame in self._parser.feed(data):
            if frame == STOP:
                self.stops += 1
            elif frame[0] not in HARMLESS:
                self.motions.append(frame[0])

    async def until(self, done: Callable[[], bool]) -> None:
        async with asyncio.timeout(GUARD):
            while not done():
                await asyncio.sleep(0.01)


@asynccontextmanager
async def shared_robot() -> AsyncIterator[RobotSeen]:
    """Share a virtual board as `rex`, with an action, a long action and a macro; all servos are at 0."""
    async with serve_board("virtual://?servos=3", name="rex") as (hub, _):
        for action in (NOD, LONG):
            await hub.board.add_action(action)
        await hub.board.add_macro(AGAIN)
        await hub.board.add_servo_parameters([ServoParameter(2, 0, "left knee")])
        async with connect("share://rex") as board:
            await board.move({1: 0, 2: 0, 3: 0}, duration=0.02, wait=True)
        yield RobotSeen(hub.board)


@asynccontextmanager
async def page_that_answers(is_yes: bool | None) -> AsyncIterator[list[dict[str, Any]]]:
    """Show questions about `rex` to a person who answers each, or none; yield the notifications."""
    channel, _ = await open_channel("rex", Greeting(wants="rpc", who="page", role="move"))
    heard: list[dict[str, Any]] = []

    def hear(name: str, params: Raw) -> None:
        heard.append({"name": name, **msgspec.json.decode(params)})
        if name == "question" and is_yes is not None:
            channel.tell("question.answer", number=heard[-1]["number"], is_yes=is_yes)

    channel.on_notification = hear
    await channel.call("question.show")
    try:
        yield heard
    finally:
        await channel.close()


@asynccontextmanager
async def supervised_robot(
    *, may_move: bool = True, speed_cap: float = 200.0
) -> AsyncIterator[tuple[RobotSeen, Supervisor]]:
    """Share a robot, and supervise it."""
    async with (
        shared_robot() as robot,
        supervised("rex", may_move=may_move, speed_cap=speed_cap, log=robot.log.append) as supervisor,
    ):
        yield robot, supervisor
