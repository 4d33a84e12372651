"""What happens on a board that this program has connected: bytes, commands, readings of servos, loss and return."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING, TypeAlias

from servolink.connection.taps import Tap
from servolink.errors import ConnectionLost, ServolinkError
from servolink.motion.angles import Angle
from servolink.protocol.packet import Packet
from servolink.recorder.channels import Event, Message, ProblemFound, ServosRead, ServoState, Wire
from servolink.recorder.commands import command_done

if TYPE_CHECKING:
    from servolink.client.board import Board
    from servolink.client.servos import Servo

Take: TypeAlias = Callable[[float, Message], None]
"""Takes a message, and when it was: seconds on the clock of the event loop. Neither waits nor raises."""

_PAUSE = 1.0  # seconds until a board that does not report its servos is asked again


class BoardTap(Tap):
    """Turns what passes into messages."""

    def __init__(self, take: Take) -> None:
        """Pass messages on to `take`."""
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

    def ended(self, packet: Packet, outcome: object, seconds: float) -> None:
        """Pass on what became of a request."""
        self._take(self._now(), command_done(packet, outcome, seconds))


@asynccontextmanager
async def following(board: Board, take: Take, *, hz: float = 0.0) -> AsyncIterator[None]:
    """Pass on, in this context, states of the connection, and `hz` readings of the servos a second; 0: ask for none.

    Readings are shared with whoever watches the servos in this program.
    """
    follow = [_follow_states(board, take)]
    if hz:
        follow.append(_follow_servos(board, take, hz))
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


async def _follow_servos(board: Board, take: Take, hz: float) -> None:
    """Pass on readings; a board that does not answer is asked again, and that is said once."""
    now = asyncio.get_running_loop().time
    told = ""
    while True:
        try:
            async with board.watch(hz) as readings:
                async for reading in readings:
                    take(reading.seconds, servos_read(reading.servos, reading.missed))
        except ConnectionLost:
            return
        except ServolinkError as error:
            if str(error) != told:
                told = str(error)
                take(now(), ProblemFound("servos", f"the servos cannot be read: {told}"[:500]))
            await asyncio.sleep(_PAUSE)
        else:
            return


def servos_read(servos: Iterable[Servo], missed: int = 0) -> ServosRead:
    """Return the message about a reading."""
    return ServosRead(tuple(map(_servo_state, servos)), missed)


def _servo_state(servo: Servo) -> ServoState:
    unit = servo.angle.unit if isinstance(servo.angle, Angle) else ""
    return ServoState(
        servo.servo_id,
        int(servo.angle),
        unit,  # type: ignore[arg-type]  # there are two units
        servo.current,
        servo.temperature,
        servo.servo_type,
        servo.is_start,
        servo.is_hold,
    )
