"""One stop at one point of one movement, and what must hold from then on."""

from __future__ import annotations

import asyncio
import os
import selectors
import tempfile
from collections.abc import Awaitable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

from servolink.errors import ServolinkError
from servolink.protocol import Packet
from servolink.testing import VirtualTimeLoop
from tests.proofs.reliability.stop_doors import REAL, UNHEARD, opened
from tests.proofs.reliability.stop_line import CONFIRMED, FATES, Points, Robot, line_to
from tests.proofs.reliability.stop_movements import FROM_REST, OPTIONS

_WRITTEN = 0.1
"""Seconds in which a stop is written: a few packets of a serial line."""
_STARTED = 10.0
"""The same in real time, on a busy machine, where a program may have to start."""
_ON_THE_WAY = 0.02
"""Seconds on the way between two programs: the hub cannot know that the sender had not heard of the stop."""
_ENDED = 30.0
"""Seconds in which both the stop and the movement end, in whatever way."""
TIMES = 4
"""Stops at times of each movement, besides those at its packets."""
_AFTER = 0.2  # seconds after the end of a movement, in which servos may still turn
_WATCHED = 5.0
"""Seconds for which the robot is watched afterwards."""
_WATCHED_REALLY = 1.0
_STILL = 0.01  # degrees
_MOMENT = 0.0002  # seconds of real time in which what one socket was given reaches the other end


class Scene(NamedTuple):
    """Who moves and stops the robot, how, and what the stop meets."""

    mover: str
    stopper: str
    movement: str
    fate: str = "arrives"

    @property
    def is_real(self) -> bool:
        """Whether other processes take part, in real time."""
        return bool(REAL & {self.mover, self.stopper})

    @property
    def seconds_on_the_way(self) -> float:
        """Seconds in which the hub may get what was asked for before a stop by another, by doors that hear of none."""
        is_one_program = self.mover == self.stopper and not self.is_real
        return _ON_THE_WAY if self.mover in UNHEARD and not is_one_program else 0.0

    def __str__(self) -> str:
        """Return it as faults name it."""
        return f"{self.movement}, {self.mover}; stop, {self.stopper}, {self.fate}"


@dataclass(slots=True)
class Witness:
    """What was seen of one stop."""

    points: int = 0
    """Points of the whole movement, or up to the end."""
    seconds: float = 0.0
    """Seconds from the beginning of the movement to its end."""
    stop: str = "not reached"
    """How the stop ended: "confirmed", or the name of an error."""
    movement: str = ""
    """How the movement ended: "done", or the name of an error."""
    sent: list[tuple[float, Packet]] = field(default_factory=list)
    """Packets for the robot, and when they were written."""
    faults: list[str] = field(default_factory=list)


class _Stopping:
    """The stop that a program asks for at a point."""

    def __init__(self, scene: Scene, robot: Robot, points: Points, stop: Awaitable[object]) -> None:
        self.asked = asyncio.get_running_loop().time()
        self.outcome = ""
        self.angles: tuple[float, ...] = ()
        """Angles when it was confirmed."""
        self.sent = 0
        """Number of packets that had been sent when it was confirmed."""
        robot.stops = [*FATES[scene.fate]]
        self.scene, self._robot, self._points, self._stop = scene, robot, points, stop
        self.faults: list[str] = []
        self.task = asyncio.ensure_future(self._observe())

    async def _observe(self) -> None:
        try:
            await self._stop
        except ServolinkError as error:
            self.outcome = type(error).__name__
        else:
            self.outcome = "confirmed"
            self.angles, self.sent = self._robot.angles, len(self._points.sent)
            if not self._robot.is_stopped:
                self.faults.append("it was confirmed while servos were started")
        if self.scene.fate in CONFIRMED and self.outcome != "confirmed":
            self.faults.append(f"it ended as {self.outcome}")


def live(scene: Scene, point: int | None = None, whole: Witness | None = None) -> Witness:
    """Live through a scene with a stop at a point, or without any.

    Points beyond those of the `whole` scene are times, the last of them after its end.
    """
    seconds = None
    if point is not None and whole is not None and point > whole.points:
        seconds = (whole.seconds + _AFTER) * (point - whole.points) / TIMES
        point = None
    selector = _SocketSelector if "page" in (scene.mover, scene.stopper) else None
    factory = None if scene.is_real else partial(VirtualTimeLoop, selector)
    with own_folders(), asyncio.Runner(loop_factory=factory) as runner:
        return runner.run(_live(scene, point, seconds))


async def _live(scene: Scene, point: int | None, seconds: float | None) -> Witness:
    loop, seen = asyncio.get_running_loop(), Witness()
    robot = Robot(is_stopped=scene.movement in FROM_REST)
    points = Points(robot, point)
    stopping: list[_Stopping] = []
    with line_to(robot, points) as address:
        async with opened(address, scene.mover, scene.stopper, OPTIONS.get(scene.movement, {})) as (mover, stopper):

            def stop() -> None:
                stopping.append(_Stopping(scene, robot, points, stopper.stop()))

            await mover.look()
            points.on_point, begun = stop, loop.time()
            if seconds is not None:
                loop.call_later(seconds, stop)
            moving = asyncio.ensure_future(_ended(mover.move(scene.movement)))
            await asyncio.wait((moving,), timeout=_ENDED / 2)
            seen.points, seen.seconds = points.count, loop.time() - begun
            await asyncio.sleep(_AFTER)  # for a stop at a time after the end
            for each in stopping:
                await asyncio.wait((moving, each.task), timeout=_ENDED)
                await asyncio.sleep(_WATCHED_REALLY if scene.is_real else _WATCHED)
                seen.faults += _judge(each, robot, points)
                seen.stop = each.outcome
                await _give_up(each.task)
            if not moving.done():
                seen.faults.append("the movement does not end")
            await _give_up(moving)
            seen.sent = points.sent
            seen.movement = "" if moving.cancelled() else moving.result()
    return seen


def _judge(stopping: _Stopping, robot: Robot, points: Points) -> list[str]:
    """Return what is wrong with a stop and what came after it."""
    faults = stopping.faults
    if not stopping.task.done():
        faults.append("it does not end")
    first = points.first_stop
    if first is None:
        return [*faults, "it was never written"]
    if (waited := points.sent[first][0] - stopping.asked) > (_STARTED if stopping.scene.is_real else _WRITTEN):
        faults.append(f"it was written after {waited:.3f} s")
    written, grace = points.sent[first][0], stopping.scene.seconds_on_the_way
    if late := [packet for when, packet in points.motions_since(first) if when >= written + grace]:
        faults.append(f"{len(late)} motions were sent after it, the first {late[0]}")
    if stopping.outcome == "confirmed":
        if late := [packet for _, packet in points.motions_since(stopping.sent)]:
            faults.append(f"{len(late)} motions were sent after it was confirmed, the first {late[0]}")
        if not robot.is_stopped:
            faults.append("servos are started after it was confirmed")
        if any(abs(a - b) > _STILL for a, b in zip(stopping.angles, robot.angles, strict=True)):
            faults.append(f"servos turned from {stopping.angles} to {robot.angles} after it was confirmed")
    return faults


async def _ended(moving: Awaitable[object]) -> str:
    try:
        await moving
    except ServolinkError as error:
        return type(error).__name__
    return "done"


async def _give_up(task: asyncio.Task[object] | asyncio.Future[object]) -> None:
    task.cancel()
    await asyncio.wait((task,))


class _SocketSelector(selectors.DefaultSelector):
    """Selector that lets virtual time pass only when no socket of this process has anything under way."""

    def __init__(self, loop: VirtualTimeLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0)
        if ready or timeout == 0:
            return ready
        ready = super().select(_MOMENT)
        if not ready:
            assert timeout is not None, "nothing is timed, and the scene still waits"
            self._loop.now += timeout
        return ready


@contextmanager
def own_folders() -> Iterator[None]:
    """Keep the folders of the user out of this."""
    names = ("XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME")
    before = {name: os.environ.get(name) for name in names}
    with tempfile.TemporaryDirectory(prefix="stops-") as folder:
        os.environ.update(dict.fromkeys(names, folder))
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
