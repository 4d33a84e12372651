"""Jobs of the process with the physics: a run to be watched, a verdict, and a pose that reaches a place."""

from __future__ import annotations

import os
from collections.abc import AsyncGenerator, Iterator
from functools import lru_cache
from time import monotonic
from typing import Annotated, ClassVar, Final

import msgspec
from msgspec import Meta, Struct

from servolink.project import Figure, Project
from servolink.protocol import Action, Macro
from servolink.twin.body import Body, metres, read_figure
from servolink.twin.forecasts import VARIATIONS, Verdict
from servolink.twin.mjcf import BASE
from servolink.twin.motion_checks import CheckProcess
from servolink.twin.placement import Vector, plus
from servolink.twin.reach import PosableFigure
from servolink.twin.simulation import Physics
from servolink.twin.trial import Fall, RunningTrial, run_seconds
from servolink.twin.worker import Worker

FALLING: Final = 1.5
"""Seconds for which a run is shown after the fall."""

_PIECE = 25  # frames, or measurements, in a piece of a job
_SECONDS = 0.1  # after which a piece ends with the present frame: jobs of other pages wait meanwhile


class Frame(Struct, frozen=True):
    """Robot at a moment of a run, in the frame of its figure: y points up, x to the robot's left."""

    SECONDS: ClassVar[float] = 0.02
    """Simulated seconds from one frame to the next."""

    at: Annotated[tuple[float, float, float], Meta(description="move of the base from rest, in millimetres")]
    turn: Annotated[tuple[float, float, float, float], Meta(description="turn of the base: w, x, y, z of a quaternion")]
    angles: Annotated[tuple[float, ...], Meta(description="degrees of the servos of the figure, in order of their ids")]


class Piece(Struct, frozen=True):
    """Frames of a part of a run, and the fall, if the robot has fallen."""

    frames: tuple[Frame, ...]
    fall: Fall | None


class Judged(Struct, frozen=True):
    """Verdict about a record."""

    verdict: Verdict
    fall: Fall | None


def play(figure: bytes, project: Project, record: Action | Macro) -> Iterator[Piece]:
    """Yield a run of a record on the body as written.

    Args:
        figure: JSON text of the figure.
        project: Project with the record, and all records run by it.
        record: Action or macro to run.

    Raises:
        ProjectError: No board could play the macro.
        TwinError: The figure has no possible body, or MuJoCo is missing.
    """
    shown = _figure(figure)
    trial = RunningTrial(Physics(Body.of(shown)), project, record)
    is_over = False
    while not is_over:
        frames, end = list[Frame](), monotonic() + _SECONDS
        while len(frames) < _PIECE and not is_over and (monotonic() < end or not frames):
            frames.append(frame_of(shown, trial.physics))
            trial.advance(Frame.SECONDS)
            is_over = trial.is_over if trial.fall is None else trial.now > trial.fall.seconds + FALLING
        yield Piece(tuple(frames), trial.fall)


def judge(figure: bytes, project: Project, record: Action | Macro) -> Iterator[Judged | bool]:
    """Yield True after each part of the work, and at last the verdict. Arguments and errors are those of `play`.

    As soon as the robot has fallen with one variation and stood with another, the rest is not run.
    """
    physics = _physics(figure)
    seconds = run_seconds(project, record)
    falls, has_stood = list[Fall](), False
    for variation in VARIATIONS:
        trial = RunningTrial(physics, project, record, variation, seconds)
        while not trial.is_over:
            end = monotonic() + _SECONDS
            for _ in range(_PIECE):
                if not trial.is_over:
                    trial.advance()
                if monotonic() >= end:
                    break
            yield True
        if trial.fall is None:
            has_stood = True
        else:
            falls.append(trial.fall)
        if falls and has_stood:
            break
    verdict = Verdict.STANDS if not falls else Verdict.UNCERTAIN if has_stood else Verdict.FALLS
    yield Judged(verdict, falls[0] if falls else None)


class Reached(Struct, frozen=True):
    """Pose in which the tip of a joint is at a place, or as near as possible."""

    angles: dict[int, int]
    """Degrees by servo id, of the servos that lead to the place."""
    missed_mm: float
    """Millimetres from the tip to the place; 0 for a place that was reached."""


def pull(figure: bytes, joint: str, move: Vector, start: dict[int, float]) -> Iterator[Reached]:
    """Yield the pose after the tip of a joint was pulled.

    Args:
        figure: JSON text of the figure.
        joint: Id of the joint.
        move: Way of the tip in millimetres, in the frame of the base of the figure.
        start: Degrees by servo id, before.

    Raises:
        TwinError: The joint is unknown or cannot move, the figure has no possible body, or MuJoCo is missing.
    """
    posable = _posable(figure)
    found = posable.reach({joint: plus(posable.place(joint, start), metres(move))}, start)
    missed = 0.0 if found.is_reached else 1000 * found.distances[joint]
    yield Reached(found.degrees, round(missed, 1))


@lru_cache(4)
def _posable(figure: bytes) -> PosableFigure:
    return PosableFigure(_figure(figure))


@lru_cache(4)
def _figure(text: bytes) -> Figure:
    return Figure.from_json(msgspec.json.decode(text))


@lru_cache(4)
def _physics(figure: bytes) -> Physics:
    """Return the physics of a figure for verdicts, which are made one after the other."""
    return Physics(Body.of(_figure(figure)))


def frame_of(figure: Figure, physics: Physics) -> Frame:
    """Return the robot as it is now."""
    base, data = physics.model.body(BASE).id, physics.data
    x, y, z = (1000 * (data.xpos[base] - physics.body.base)).tolist()
    w, i, j, k = data.xquat[base].tolist()
    degrees = {servo_id: physics.angle(at) for at, servo_id in enumerate(physics.servo_ids)}
    ids = sorted(joint.servo for joint in figure.joints if joint.servo is not msgspec.UNSET)
    return Frame(
        (_tenth(y), _tenth(z), _tenth(x)),
        (round(w, 4), round(j, 4), round(k, 4), round(i, 4)),
        tuple(_tenth(degrees.get(servo_id, 0.0)) for servo_id in ids),
    )


def _tenth(value: float) -> float:
    return round(value, 1) + 0.0  # and no negative zero


class PhysicsProcess(Worker):
    """Process of low priority that carries out these jobs. Any TwinError of the process is raised as well."""

    def play(self, figure: bytes, project: Project, record: Action | Macro) -> AsyncGenerator[Piece, None]:
        """Yield a run of a record (see `play`)."""
        return self.run(play, figure, project, record)

    def judge(self, figure: bytes, project: Project, record: Action | Macro) -> AsyncGenerator[Judged | bool, None]:
        """Yield True after each part of the work, and at last the verdict; nobody waits for it (see `judge`)."""
        return self.run(judge, figure, project, record, is_background=True)

    async def pull(self, figure: bytes, joint: str, move: Vector, start: dict[int, float]) -> Reached:
        """Return the pose after the tip of a joint was pulled (see `pull`)."""
        (reached,) = [each async for each in self.run(pull, figure, joint, move, start)]
        return reached

    @staticmethod
    def checker(path: str | os.PathLike[str]) -> CheckProcess:
        """Return a process that checks motions for the robot of a project file.

        Raises:
            ProjectError: The file cannot be read.
            TwinError: The file has no figure, the figure has no possible body, or MuJoCo is missing.
        """
        figure = read_figure(path)[1]
        Physics(Body.of(figure))
        return CheckProcess(msgspec.json.encode(figure.checked().to_json()))
