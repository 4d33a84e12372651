"""Picture of `servolink virtual` on a terminal: moving servos and buttons."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager

from servolink.cli.screen.live import Line, pictures, redrawn
from servolink.cli.screen.output import counted
from servolink.cli.screen.servo_picture import LEGEND, Watched, picture_of_servos, wrapped
from servolink.client import Servo, ServoReading
from servolink.connection import Stats
from servolink.motion import Degrees
from servolink.virtual import Keys, VirtualBoard
from servolink.virtual import SimulatedServo as VirtualServo

_EVERY = 0.1  # seconds


@asynccontextmanager
async def shown(board: VirtualBoard, urls: list[str]) -> AsyncIterator[None]:
    """Show `board`, which is served at `urls`, on the terminal."""
    with pictures(lambda width, height, blocks: picture(board, urls, (width, height), blocks=blocks)) as draw:
        loop = asyncio.get_running_loop()

        def advance() -> None:
            board.advance(loop.time())
            draw()

        async with redrawn(advance, _EVERY):
            yield


def picture(board: VirtualBoard, urls: list[str], size: tuple[int, int], *, blocks: bool) -> list[Line]:
    """Return the board as lines, for a width and a height (`size`)."""
    foot = [*wrapped(Keys.HELP, size[0], "dim"), *wrapped(LEGEND, size[0], "dim")]
    head = [line for text, style in _head(board, urls) for line in wrapped(text, size[0], style)]
    return picture_of_servos(servos_of(board), head, foot, size, blocks=blocks)


def servos_of(board: VirtualBoard) -> Watched:
    """Return the present state of the servos of `board`."""
    stored = board.storage.servo_parameters(board.codec)
    watched = Watched("", 0.0, Stats(), captions={one.servo_id: one.servo_caption for one in stored})
    watched.take(ServoReading(0.0, tuple(_reported(servo) for servo in board.servos.values())))
    return watched


def _head(board: VirtualBoard, urls: list[str]) -> Iterator[Line]:
    yield from ((f"listening {url}", "") for url in urls)
    power, style = ("on", "bold green") if board.powered else ("off", "")
    requests = counted(board.work.received, "request")
    yield f"power {power}  battery {board.battery / 10:.1f} %  {requests} received", style
    down = ", ".join(map(str, board.buttons_down))
    last = "" if board.button_pressed_last is None else f"; pressed last: {board.button_pressed_last}"
    yield f"buttons down: {down or 'none'}{last}", "bold" if down else ""


def _reported(servo: VirtualServo) -> Servo:
    """Return a servo as reported by a board set to degrees."""
    state = servo.state()
    return Servo(
        servo.servo_id,
        Degrees(round(servo.position)),
        state.current,
        state.temperature,
        state.servo_type,
        is_start=bool(servo.is_start),
        is_hold=bool(servo.is_hold),
    )
