"""Events of a board connected by the present program: bytes, commands, readings of servos, loss and return."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from servolink.connection.taps import Tap
from servolink.errors import ConnectionLost, ServolinkError
from servolink.protocol.packet import Packet
from servolink.recorder.channels import Event, Wire
from servolink.recorder.packet_messages import command_done
from servolink.recorder.readings import ReadingsFeed, Take

if TYPE_CHECKING:
    from servolink.client.board import Board

_PAUSE = 1.0  # seconds until a board without a reading is asked again


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


class BoardTap(WireTap):
    """Tap that turns bytes and the outcome of requests into messages."""

    def ended(self, packet: Packet, outcome: object, seconds: float) -> None:
        """Pass on the outcome of a request."""
        self._take(self._now(), command_done(packet, outcome, seconds))


@asynccontextmanager
async def following(board: Board, take: Take, readings: ReadingsFeed) -> AsyncIterator[None]:
    """Pass on, in this context, states of the connection and readings of the servos.

    Readings are shared with all watchers of the servos in this program.
    """
    follow = [_follow_states(board, take)]
    if readings.hz:
        follow.append(follow_servos(board, readings))
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


async def follow_servos(board: Board, readings: ReadingsFeed) -> None:
    """Pass on readings; after a missing answer, ask the board again."""
    while True:
        try:
            async with board.watch(readings.hz) as watch:
                async for reading in watch:
                    readings.read(reading.seconds, reading.servos, reading.missed)
        except ConnectionLost:
            return
        except ServolinkError as error:
            readings.failed(error)
            await asyncio.sleep(_PAUSE)
        else:
            return
