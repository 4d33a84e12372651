"""The line to a robot on which each packet is a point: something begins right before or after it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from servolink.project import Project
from servolink.protocol import (
    ALL_SERVOS,
    Action,
    FrameParser,
    Macro,
    MacroCommand,
    Packet,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
)
from servolink.testing import FakeBoard, Fate
from servolink.transports import Transport, WrappedTransport
from servolink.virtual import BoardKind, VirtualTransport
from tests.plugged import plugged
from tests.project.pulled import contents_of

STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
WAVE = Action(1, "Wave", (Step(1, 40, 20), Step(2, -40, 20)))
BACK = Action(2, "Back", (Step(1, -20, 10),))
DANCE = Macro(1, "Dance", (MacroCommand(1), MacroCommand(100, 1), MacroCommand(2, loop=2)))
PROJECT = Project(actions=(WAVE, BACK), macros=(DANCE,))

_LOST = Fate(executes=False)
_LIE = Fate(executes=False, says=SetServoParameterResponse(ALL_SERVOS, 0, 1))
_ALWAYS = 100
FATES: dict[str, tuple[Fate, ...]] = {
    "arrives": (),
    "is lost once": (_LOST,),
    "is lost": (_LOST,) * _ALWAYS,
    "is claimed only": (_LIE,) * _ALWAYS,
    "unplugs": (Fate(unplugs=True),),
}
"""What happens to stops of all servos on their way, in order."""
CONFIRMED = {"arrives", "is lost once"}
"""Fates of stops that the robot confirms in the end."""

_KIND = BoardKind(turnaround=0.003)
_BYTE = 10 / 115200  # seconds on the line


class Robot(FakeBoard):
    """Board with two actions and a macro, whose stops have a fate."""

    def __init__(self, *, is_stopped: bool) -> None:
        """Begin with all servos at 0 degrees, and stopped if so wanted."""
        super().__init__(3, kind=_KIND)
        self.storage.contents = contents_of(PROJECT)
        self.stops: list[Fate] = []
        """Fates of the next stops of all servos."""
        for servo in self.servos.values():
            servo.angle, servo.is_start = 0.0, int(not is_stopped)

    def fate_of(self, request: Packet) -> Fate:
        """Return the fate of a request that has arrived."""
        return self.stops.pop(0) if request == STOP and self.stops else super().fate_of(request)

    @property
    def is_stopped(self) -> bool:
        """Whether all servos are stopped and held."""
        return all((servo.is_start, servo.is_hold) == (0, 1) for servo in self.servos.values())

    @property
    def angles(self) -> tuple[float, ...]:
        """Angles of all servos, now."""
        self.advance(asyncio.get_running_loop().time())
        return tuple(servo.angle for servo in self.servos.values())


class Points:
    """Count of the points on the way of a movement: before and after each packet, in both directions."""

    def __init__(self, robot: Robot, at: int | None) -> None:
        """Begin something at the point number `at`, or at none."""
        self.count = 0
        self.sent: list[tuple[float, Packet]] = []
        """All packets for the robot, and when they were written."""
        self.on_point: Callable[[], object] | None = None
        """Called at the point; nothing is counted before it is set."""
        self._robot, self._at = robot, at

    def pass_one(self) -> None:
        """Pass a point."""
        if self.on_point is not None:
            self.count += 1
            if self.count == self._at:
                self.on_point()

    def write(self, data: bytes) -> None:
        """Note the packets in what is written."""
        now = asyncio.get_running_loop().time()
        decode = self._robot.codec.decode
        self.sent += [(now, decode(*frame)) for frame in FrameParser(self._robot.codec.byte_order).feed(data)]

    def motions_since(self, number: int) -> list[tuple[float, Packet]]:
        """Return the motions among the packets from a number on, and when they were written."""
        return [(when, packet) for when, packet in self.sent[number:] if packet.is_motion]

    @property
    def first_stop(self) -> int | None:
        """Number of the first stop of all servos among the packets; None if none was written."""
        return next((number for number, (_, packet) in enumerate(self.sent) if packet == STOP), None)


class Line(WrappedTransport):
    """Line with the speed of a serial port."""

    def __init__(self, robot: Robot, points: Points) -> None:
        """Lead to `robot`, and count what passes."""
        super().__init__(VirtualTransport(robot))
        self._points = points

    async def send(self, data: bytes) -> None:
        """Send what takes its time; the frame is the line's before anything else happens."""
        if not data:  # asks when all that was sent before has left
            await super().send(data)
            return
        self._points.pass_one()
        self._points.write(data)
        await super().send(data)
        self._points.pass_one()
        await asyncio.sleep(len(data) * _BYTE)

    def data(self, chunk: bytes, /) -> None:
        """Pass on what has come."""
        self._points.pass_one()
        super().data(chunk)
        self._points.pass_one()


@contextmanager
def line_to(robot: Robot, points: Points) -> Iterator[str]:
    """Yield the address under which every program of this process reaches the robot."""

    def create(_: str) -> Transport:
        return Line(robot, points)

    with pytest.MonkeyPatch.context() as patch:
        yield plugged(patch, create, "points://robot")
