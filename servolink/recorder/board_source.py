"""Events of a board connected by the present program: bytes, commands, readings of servos, loss and return."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from servolink.client import Board
from servolink.connection import Tap
from servolink.protocol import Packet
from servolink.recorder.channels import Event, Wire
from servolink.recorder.packet_messages import command_done
from servolink.recorder.readings import ReadingsFeed, Take


class WireTap(Tap):
    """Tap that turns the passing bytes into messages."""

    def __init__(self, take: Take) -> None:
        self._take = take
        self._now = asyncio.get_running_loop().time

    def sent(self, data: bytes) -> None:
        """Pass on bytes to the board."""
        now = self._now()
        self._take(now, Wire("sent", data, now))

    def received(self, data: bytes) -> None:
        """Pass on bytes from the board."""
        now = self._now()
        self._take(now, Wire("received", data, now))

    def done(self, packet: Packet, outcome: object, seconds: float, **who: str) -> None:
        """Pass on the outcome of a request, of the program `who` in a session (see `command_done`)."""
        self._take(self._now(), command_done(packet, outcome, seconds, **who))


class BoardTap(WireTap):
    """Tap that turns bytes and the outcome of requests into messages."""

    def ended(self, packet: Packet, outcome: object, seconds: float) -> None:
        """Pass on the outcome of a request."""
        self.done(packet, outcome, seconds)


@asynccontextmanager
async def following(board: Board, take: Take, readings: ReadingsFeed) -> AsyncIterator[None]:
    """Pass on, in this context, states of the connection and readings of the servos.

    Readings are shared with all watchers of the servos in this program.
    """
    follow = [_follow_states(board, take)]
    if readings.hz:
        follow.append(readings.follow(board))
    tasks = [asyncio.create_task(each) for each in follow]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)


async def _follow_states(board: Board, take: Take) -> None:
    now = asyncio.get_running_loop().time
    async for state in board.states():
        take(now(), Event("connection", state))
