"""`servolink twin measure`: speed, lag and strength of a servo, measured on the robot and kept in the figure."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Iterator
from datetime import UTC, datetime

from msgspec import UNSET
from msgspec.structs import replace

from servolink.cli.arguments import SERVO_NAME, not_empty, number, whole_number
from servolink.cli.command import Command, option
from servolink.cli.command_session import Interruption, refuse_unasked, run_with_board
from servolink.cli.motion.move import LIMITS, limits_of, make_ready
from servolink.cli.motion.run import stopped_by_interruption
from servolink.cli.screen.output import Table, counted, print_error
from servolink.cli.screen.result import Ending, Part, print_for_people
from servolink.cli.screen.terminal import confirm_motion
from servolink.client import Board, servo_id
from servolink.errors import ProjectError, RequestRefused, ServolinkError
from servolink.project import BodyFields, Figure, ProjectFile
from servolink.twin import ServoMeasuring

MOVEMENTS = 8
"""Movements there and back, by default."""

_HZ = 100.0  # readings per second, or as many as the board answers
_REST = 0.5  # seconds after a movement, in which a servo that lags arrives
_SHOWN = {"speed": ("speed", "degrees/s"), "lag": ("lag", "degrees"), "torque": ("strength", "N m")}


@Command(
    "twin measure",
    help="measure speed, lag and strength of a servo on the robot",
    details=(
        "Hold the robot upright in the air, so that it cannot fall. The servo turns 30 degrees to a side and back, "
        "first as quickly as it can, then slowly; each of these movements is asked for. What fits the readings within "
        "10 % is written into the figure. The weight comes from a scale: --mass."
    ),
    examples=("twin measure robot.servolink.json 3", "twin measure robot.servolink.json elbow --mass 1.4"),
    options=(
        option("source", "FILE", "a project file with a figure", not_empty),
        option("servo", "SERVO", "which servo, by id or caption", SERVO_NAME),
        option("--mass", "KG", "mass of the whole robot, which is written into the figure", number(0.001, 1000, "kg")),
        option("--movements", "N", f"movements there and back ({MOVEMENTS})", whole_number(2, 100), default=MOVEMENTS),
        *LIMITS,
    ),
    defaults={"yes": False},
)
def run_measure(args: argparse.Namespace) -> int:
    """Move after each yes, and write what was measured into the figure."""
    refuse_unasked(args, "each movement is asked for, which needs an interactive terminal, without --json")
    file = ProjectFile.read(args.source, unchecked=True)
    if file.figure is None:
        raise ProjectError(f"{args.source}: has no figure; `servolink studio` fits one to the robot")
    figure = _weighed(file.figure, args.mass)

    async def talk(board: Board, interruption: Interruption) -> Ending:
        moving = _Movements(board, interruption, await servo_id(board, args.servo), str(args.source))
        measuring = ServoMeasuring(figure, moving.servo_id)
        await moving.carry_out(measuring, args.movements)
        today = datetime.now(UTC).astimezone().date()
        found = await asyncio.to_thread(measuring.result, args.movements, today)
        file._replace(figure=found.figure).write(args.source)
        interruption.state = f"servo {moving.servo_id} is back where it was; {args.source}: written"
        print_for_people(_table(found.found, found.unknown))
        print_for_people(f"{args.source}: written, servo {moving.servo_id} was moved {args.movements} times")
        return 0

    return run_with_board(args, talk, **limits_of(args))


def _weighed(figure: Figure, mass: float | None) -> Figure:
    """Return the figure with the mass of the robot, if one was given."""
    if mass is None:
        return figure
    return replace(figure, body=replace(figure.body or BodyFields(), mass=mass, density=UNSET))


def _table(found: dict[str, tuple[float, float, float]], unknown: dict[str, str]) -> Iterator[Part]:
    """Yield a table of the values, and why some are not kept."""
    rows = [
        (what, *found[name], unit, "assumed" if name in unknown else "measured")
        for name, (what, unit) in _SHOWN.items()
    ]
    yield Table(("", "value", "lowest", "highest", "", ""), rows)
    for name, reason in unknown.items():
        yield f"{_SHOWN[name][0]} is not kept: {reason}"


class _Movements:
    """Movements of one servo, each after a yes."""

    def __init__(self, board: Board, interruption: Interruption, servo: int, file: str) -> None:
        self.servo_id = servo
        self._board, self._interruption = board, interruption
        self._unwritten = f"{file} is as it was"
        self._done = 0

    async def carry_out(self, measuring: ServoMeasuring, count: int) -> None:
        """Ask for each movement, and carry it out. Raise ServolinkError after a no; Ctrl-C stops all servos."""
        servo = await self._board.servo(self.servo_id)
        await make_ready(self._board, [servo], self._interruption, start=False)
        start, (low, high) = int(servo.angle), self._board.limits.of(self.servo_id) or (-180.0, 180.0)
        self._interruption.state = self._moved("is back where it was")
        for at in range(count):
            parts = measuring.movement(at, start, low, high)
            question = (
                f"movement {at + 1} of {count}: servo {self.servo_id} turns from {start}° to {parts[0][0]}° and back, "
                "as quickly as it can, then slowly. Now?"
            )
            if not await confirm_motion(question):
                raise ServolinkError(self._interruption.state)
            self._done += 1
            self._interruption.state = begun = self._moved("may be on its way still")
            stopped = self._moved("was stopped on its way")
            try:
                async with stopped_by_interruption(self._board, self._interruption, begun, stopped):
                    await self._move(measuring, start, parts)
            except ServolinkError:
                print_error(f"servolink: {self._interruption.state}")
                raise
            self._interruption.state = self._moved("is back where it was")

    def _moved(self, where: str) -> str:
        """Return how often the servo was moved, and where it is, as a text."""
        if not self._done:
            return f"no servo was moved, and {self._unwritten}"
        return f"servo {self.servo_id} was moved {counted(self._done, 'time')} and {where}; {self._unwritten}"

    async def _move(self, measuring: ServoMeasuring, start: int, parts: list[tuple[int, float]]) -> None:
        """Turn the servo there and back, and read all servos meanwhile."""
        now, at = asyncio.get_running_loop().time, start
        for goal, seconds in parts:
            pose = {each.servo_id: float(each.angle) for each in await self._board.servos()}
            readings = list[tuple[float, float]]()
            async with self._board.watch(_HZ) as watched:
                takes = await self._board.move({self.servo_id: goal}, duration=seconds)
                begun, after = now(), 0.0
                while after < takes + _REST:
                    reading = await anext(watched)
                    after = reading.seconds - reading.took / 2 - begun
                    servo = next(each for each in reading.servos if each.servo_id == self.servo_id)
                    if not (servo.is_start and servo.is_hold):
                        raise RequestRefused(f"servo {self.servo_id} was stopped or released meanwhile")
                    if after > 0:
                        readings.append((after, float(servo.angle)))
            measuring.add(pose | {self.servo_id: float(at)}, goal, takes, readings)
            at = goal
