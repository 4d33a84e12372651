"""Checks of motions before they are sent: tried from the pose in which the robot is, on a body with physics."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Collection, Iterator, Mapping
from functools import lru_cache
from time import monotonic
from typing import Final

import msgspec
from msgspec import Struct

from servolink.project import Figure, Project
from servolink.protocol import Action, Macro, Step
from servolink.twin.body import GRAVITY, Body
from servolink.twin.forecasts import VARIATIONS, Verdict
from servolink.twin.simulation import Physics
from servolink.twin.trial import AS_WRITTEN, LONGEST, RunningTrial, TrialResult, Watch, run_seconds
from servolink.twin.worker import Worker

HARDEST: Final = 0.5
"""Share of its weight with which a robot may press on itself, or on the floor with another part than a foot."""
SAFE_MM: Final = 10.0
"""Margin in millimetres of the centre of mass, with which a slow movement needs no simulation."""
SLOW: Final = 120.0
"""Degrees per second up to which a movement of a robot that can fall counts as slow."""

_STEP = 0.005  # seconds of a step of the physics: coarser than in a forecast, and three times as fast
_PIECE = 0.02  # seconds after which a piece ends: a movement that somebody waits for is checked between pieces
_APART, _MOST = 5.0, 12  # degrees between two poses of a way that are looked at, and most of them
_SUNK = 0.004  # metres below the floor, so that all feet near it count as support


class MotionVerdict(Struct, frozen=True):
    """Result of a check."""

    verdict: Verdict
    text: str
    """What happens, when, and at which servo, for people; empty for a robot that stands."""
    basis: dict[str, str]
    """Origin of the values of the body, as `Body.basis`."""


def check_record(
    figure: bytes, project: Project, record: Action | Macro, pose: Mapping[int, float]
) -> Iterator[MotionVerdict | bool]:
    """Yield True after each part of the work, and at last the result.

    Args:
        figure: JSON text of the figure.
        project: Project with the record, and all records run by it.
        record: Action or macro to run.
        pose: Degrees by servo id, in which the robot is now.

    Raises:
        ProjectError: No board could play the macro.
        TwinError: The twin does not stand in the pose, the figure has no possible body, or MuJoCo is missing.
    """
    physics, seconds = _physics(figure, "records"), run_seconds(project, record)
    moved = {step.servo_id for action in project.actions for step in action.steps}
    falls, has_stood = list[str](), False
    for variation in VARIATIONS:
        trial = RunningTrial(physics, project, record, variation, seconds, pose)
        while not trial.is_over:
            end = monotonic() + _PIECE
            while not trial.is_over and monotonic() < end:
                trial.advance()
            yield True
        result = trial.result()
        if found := _trouble(physics, result, moved, has_steps=True):
            falls.append(found)
            if result.fall is None:  # a part that meets another does so with any mass
                break
        else:
            has_stood = True
        if falls and has_stood:
            break
    if not falls and seconds > LONGEST:
        text = f"it takes {seconds:.0f} s, and only {LONGEST:.0f} s were tried"
        yield MotionVerdict(Verdict.UNCERTAIN, text, physics.body.basis)
        return
    verdict = Verdict.STANDS if not falls else Verdict.UNCERTAIN if has_stood else Verdict.FALLS
    yield MotionVerdict(verdict, falls[0] if falls else "", physics.body.basis)


def check_move(
    figure: bytes, pose: Mapping[int, float], targets: Mapping[int, float], seconds: float
) -> Iterator[MotionVerdict]:
    """Yield the result for a movement to `targets`, degrees by servo id. Raise TwinError as `check_record`.

    The poses on the way are looked at first. Only if parts meet, or the robot could fall, is the movement simulated.
    """
    physics = _physics(figure, "moves")
    way = {each: (pose.get(each, 0.0), target) for each, target in targets.items() if each in physics.servo_ids}
    if physics.body.bolted or all(abs(end - begin) <= SLOW * seconds for begin, end in way.values()):
        result = _look_along(physics, pose, way)
        if not result.collisions and (result.margin_mm is None or result.margin_mm >= SAFE_MM):
            yield MotionVerdict(Verdict.STANDS, "", physics.body.basis)
            return
    steps = tuple(Step(each, round(target), max(1, round(seconds * 100))) for each, (_, target) in way.items())
    action = Action(1, "", steps)
    trial = RunningTrial(physics, Project(actions=(action,)), action, AS_WRITTEN, seconds, pose)
    while not trial.is_over:
        trial.advance()
    found = _trouble(physics, trial.result(), way, has_steps=False)
    yield MotionVerdict(Verdict.FALLS if found else Verdict.STANDS, found, physics.body.basis)


def _look_along(physics: Physics, pose: Mapping[int, float], way: Mapping[int, tuple[float, float]]) -> TrialResult:
    """Return the measurements of the poses on a way, without weight or speed."""
    farthest = max((abs(end - begin) for begin, end in way.values()), default=0.0)
    count = min(_MOST, 1 + int(farthest / _APART))
    physics.pose(pose, sunk=_SUNK)
    watch = Watch(physics)
    for at in range(count + 1):
        between = {each: begin + (end - begin) * at / count for each, (begin, end) in way.items()}
        physics.pose({**pose, **between}, sunk=_SUNK)
        watch.look(float(at))
    return watch.trial(None)


def _trouble(physics: Physics, result: TrialResult, moved: Collection[int], *, has_steps: bool) -> str:
    """Return the first fall or hard touch in a trial as a text; `moved` are the servos that the motion turns."""
    if (fall := result.fall) is not None:
        step = f" ({fall.step})" if has_steps else ""
        strains = max(result.torque, key=lambda each: result.torque[each])
        return f"the robot falls after {fall.seconds:.1f} s{step}; servo {strains} strains most"
    most = HARDEST * physics.body.mass * GRAVITY
    for one in sorted(result.collisions, key=lambda one: one.seconds):
        if one.newtons > most:
            servo_id = _turned_by(physics.body, one.parts, moved)
            by = "" if servo_id is None else f", turned by servo {servo_id},"
            return (
                f"after {one.seconds:.1f} s, {' and '.join(one.parts)}{by} press on each other with {one.newtons:.0f} N"
            )
    return ""


def _turned_by(body: Body, names: Collection[str], moved: Collection[int]) -> int | None:
    """Return the nearest servo in motion that turns one of the parts; None if a fall of others brings them together."""
    parts = [part for part in body.parts if part.name in names]
    while parts:
        for part in parts:
            if part.servo is not None and part.servo in moved:
                return part.servo
        parts = [body.parts[part.parent] for part in parts if part.parent is not None]
    return None


@lru_cache(8)
def _physics(figure: bytes, use: str) -> Physics:
    """Return the physics of a figure; each use has its own, as a movement may be checked amid a record."""
    return Physics(Body.of(Figure.from_json(msgspec.json.decode(figure))), _STEP)


class CheckProcess(Worker):
    """Process of low priority that carries out checks for one figure."""

    def __init__(self, figure: bytes) -> None:
        """Check motions of the robot of `figure`, JSON text."""
        super().__init__()
        self._figure = figure

    async def check_move(
        self, pose: Mapping[int, float], targets: Mapping[int, float], seconds: float
    ) -> MotionVerdict:
        """Return the result for a movement (see the function `check_move`)."""
        (checked,) = [each async for each in self.run(check_move, self._figure, pose, targets, seconds)]
        return checked

    def check_record(
        self, project: Project, record: Action | Macro, pose: Mapping[int, float]
    ) -> AsyncGenerator[MotionVerdict | bool, None]:
        """Yield the parts of the check of a record (see the function `check_record`)."""
        return self.run(check_record, self._figure, project, record, pose, is_background=True)
