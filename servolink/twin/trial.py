"""Trial: one run of an action or a macro on a body with physics, and all that is measured meanwhile."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

import msgspec
from msgspec import Struct

from servolink.errors import ProjectError, TwinError
from servolink.project import Project, RecordRun, name_of
from servolink.protocol import Action, Macro
from servolink.twin.mjcf import BASE, FLOOR, part_names
from servolink.twin.moment import moment
from servolink.twin.simulation import Physics, Simulation
from servolink.virtual import DryRun

LONGEST: Final = 60.0
"""Longest trial in simulated seconds; a longer run is cut off."""
AFTERWARDS: Final = 2.0
"""Seconds after the end of a run, in which the robot can still fall."""
SETTLING: Final = 0.5
"""Seconds in which a body comes to rest in a pose before a run."""
LEANING: Final = 15.0
"""Most degrees by which a body leans that has come to rest in a pose."""
FALLEN: Final = 45.0
"""Lean in degrees of a robot that has fallen."""
SPACING: Final = 0.05
"""Seconds between two measurements, a whole number of ticks."""

_STILL = 0.01  # rad/s and m/s of the fastest part of a robot at rest
_SAFE = 0.003  # metres of the margin of a robot at rest: nearer to the edge, it may be about to tip over
_SUPPORT = 3  # measurements whose points of support count together: a foot that bounces still supports
_DIRECTIONS = 64  # in which the margin of the centre of mass is measured


class Variation(Struct, frozen=True):
    """Factors of the values of a body."""

    mass: float = 1.0
    stiffness: float = 1.0
    friction: float = 1.0


AS_WRITTEN: Final = Variation()
"""Values of the body as they are."""


class Fall(Struct, frozen=True):
    """Moment in which a robot has fallen."""

    seconds: float
    """Seconds since the start of the run."""
    step: str
    """Command and action that run at this moment."""
    command: int | None
    """Number of the command of the macro, from 1; None for an action, and after the end."""
    variation: Variation


class Collision(Struct, frozen=True):
    """Two parts that touch, or the floor and a part other than a foot."""

    parts: tuple[str, str]
    seconds: float
    """Seconds from the start of the run to the first touch."""
    newtons: float = 0.0
    """Largest force between them, as measured 20 times a second."""


class TrialResult(Struct, frozen=True):
    """Measurements of one run, up to the fall if there is one."""

    fall: Fall | None
    worst_tilt: float
    """Largest lean of the feet in degrees; of a robot without feet, of its base."""
    worst_at: float
    """Seconds from the start of the run to the largest lean."""
    margin_mm: float | None
    """Least distance of the centre of mass from the edge of the support; negative beyond it, None for a bolted body."""
    collisions: tuple[Collision, ...]
    torque: dict[int, float]
    """Highest torque of each servo, as a share of its strongest."""
    lag: dict[int, float]
    """Largest lag of each servo behind its command, in degrees."""


def run_seconds(project: Project, record: Action | Macro) -> float:
    """Return the duration of a run. Raise ProjectError for a macro that no board can play."""
    try:
        DryRun(project.actions, project.macros, ()).begin(record)
    except ProjectError as error:
        raise ProjectError(f"{name_of(record)}: {error}; `servolink project check` explains it") from error
    return RecordRun(project, record).seconds()


def start(
    physics: Physics,
    project: Project,
    record: Action | Macro,
    variation: Variation,
    pose: Mapping[int, float] | None = None,
) -> Simulation:
    """Return a simulation in which a record begins to run, on a body with the values of a variation.

    It begins at rest, or in a pose (degrees by servo id) in which the body has come to rest. Raise TwinError for a pose
    in which it does not.
    """
    physics.vary(**msgspec.structs.asdict(variation))
    dry_run = DryRun(project.actions, project.macros, physics.servo_ids)
    simulation = Simulation(physics, dry_run.hardware, pose)
    if pose is not None:
        _settle(physics)
    dry_run.begin(record)
    return simulation


def _settle(physics: Physics) -> None:
    watch = Watch(physics)
    physics.advance(round(SETTLING / physics.model.opt.timestep))
    watch.look(0.0)
    if watch.has_fallen or watch.trial(None).worst_tilt > LEANING:
        raise TwinError("the twin does not stand where the robot is now")


def run_trial(
    physics: Physics, project: Project, record: Action | Macro, variation: Variation = AS_WRITTEN, seconds: float = 0.0
) -> TrialResult:
    """Run a record from the pose with all servos at 0, and a little longer.

    `seconds` is the duration by `run_seconds`, if known. Raise ProjectError for a macro that no board can play.
    """
    trial = RunningTrial(physics, project, record, variation, seconds)
    while not trial.is_over:
        trial.advance()
    return trial.result()


class RunningTrial:
    """Trial in progress: a run from the pose with all servos at 0, and a little longer."""

    def __init__(
        self,
        physics: Physics,
        project: Project,
        record: Action | Macro,
        variation: Variation = AS_WRITTEN,
        seconds: float = 0.0,
        pose: Mapping[int, float] | None = None,
    ) -> None:
        """Begin a run in a pose, degrees by servo id, or at rest. The other arguments are those of `run_trial`."""
        self.physics = physics
        self._project, self._record, self._variation = project, record, variation
        self._end = min(seconds or run_seconds(project, record), LONGEST) + AFTERWARDS
        self._simulation = start(physics, project, record, variation, pose)
        self._watch = Watch(physics)
        self.fall: Fall | None = None
        """Fall, once the robot has fallen."""

    @property
    def now(self) -> float:
        """Simulated seconds since the start of the run."""
        return self._simulation.now

    @property
    def is_over(self) -> bool:
        """Whether the robot has fallen, or the time is over, or nothing moves any more after the end of the run."""
        if self.fall is not None or self.now >= self._end:
            return True
        return self.now > self._end - AFTERWARDS + SPACING and self._watch.is_at_rest

    def advance(self, seconds: float = SPACING) -> None:
        """Go on by some seconds, a whole number of ticks, and measure once."""
        self._simulation.advance(self.now + seconds)
        self._watch.look(self.now)
        if self._watch.has_fallen and self.fall is None:
            command, step = moment(self._project, self._record, self.now)
            self.fall = Fall(self.now, step, command, self._variation)

    def result(self) -> TrialResult:
        """Return all measurements."""
        return self._watch.trial(self.fall)


class Watch:
    """Measurements of a body in motion."""

    def __init__(self, physics: Physics) -> None:
        """Measure from now on; all that touches now may touch later."""
        import numpy as np  # late: MuJoCo brings it

        self.has_fallen = False
        """Whether the robot leans too far, or its base has come to the floor."""
        self.is_at_rest = False
        """Whether nothing moves, and the centre of mass is above the support."""
        self._physics = physics
        self._np = np
        body, model = physics.body, physics.model
        named = dict(zip((part.name for part in body.parts), part_names(body), strict=True))
        self._upright = np.array([model.body(named[foot]).id for foot in body.feet] or [model.body(BASE).id])
        self._positions = np.array(physics.positions, dtype=int)
        self._up = physics.data.xmat[self._upright][:, 6:].copy()
        self._floor = model.geom(FLOOR).id if body.has_floor else -1
        self._is_trunk = model.body_weldid[model.geom_bodyid] == model.body(BASE).id
        self._is_trunk[physics.data.contact.geom] = False  # a base that rests on the floor
        angles = np.arange(_DIRECTIONS) * (2 * math.pi / _DIRECTIONS)
        self._directions = np.array([np.cos(angles), np.sin(angles)])
        self._strongest = np.abs(physics.model.actuator_forcerange).max(axis=1)
        self._torque = np.zeros(model.nu)
        self._lag = np.zeros(model.nu)
        self._support: deque[Any] = deque(maxlen=_SUPPORT)
        self._tilt, self._tilt_at, self._margin = 0.0, 0.0, math.inf
        self._at_rest = physics.touching()
        self._known = set(self._pairs())
        self._touched: dict[tuple[str, str], tuple[float, float]] = {}

    def look(self, now: float) -> None:
        """Measure once, at the time `now`."""
        np, data = self._np, self._physics.data
        np.maximum(self._torque, np.abs(data.actuator_force), out=self._torque)
        np.maximum(self._lag, np.abs(data.ctrl - data.qpos[self._positions]), out=self._lag)
        if new := set(self._pairs()) - self._known:
            self._note_collisions(now)
            self._known |= new
        if self._touched:
            forces = self._physics.forces()
            for pair, (at, most) in self._touched.items():
                self._touched[pair] = at, max(most, forces.get(pair, 0.0))
        self.is_at_rest = bool(np.abs(data.qvel).max() < _STILL)
        if self._physics.body.bolted:
            return
        cosine = (data.xmat[self._upright][:, 6:] * self._up).sum(axis=1).max()
        tilt = math.degrees(math.acos(min(1.0, float(cosine))))
        if tilt > self._tilt:
            self._tilt, self._tilt_at = tilt, now
        pairs = data.contact.geom
        on_floor = pairs[:, 0] == self._floor  # MuJoCo names a plane before other shapes
        self._support.append(data.contact.pos[on_floor, :2])
        if self._measure_margin() < _SAFE:
            self.is_at_rest = False
        self.has_fallen = tilt > FALLEN or bool(self._is_trunk[pairs[on_floor, 1]].any())

    def trial(self, fall: Fall | None) -> TrialResult:
        """Return all measurements."""
        ids = self._physics.servo_ids
        shares = self._torque / self._strongest
        return TrialResult(
            fall=fall,
            worst_tilt=self._tilt,
            worst_at=self._tilt_at,
            margin_mm=None if math.isinf(self._margin) else self._margin * 1000,
            collisions=tuple(Collision(parts, *found) for parts, found in self._touched.items()),
            torque=dict(zip(ids, shares.tolist(), strict=True)),
            lag=dict(zip(ids, self._np.degrees(self._lag).tolist(), strict=True)),
        )

    def _pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of bodies in contact, by number."""
        numbers = self._physics.model.geom_bodyid[self._physics.data.contact.geom].tolist()
        return [(one, other) for one, other in numbers]

    def _note_collisions(self, now: float) -> None:
        for pair in self._physics.touching() - self._at_rest:
            if FLOOR not in pair or not {*pair} & {*self._physics.body.feet}:
                self._touched.setdefault(pair, (now, 0.0))

    def _measure_margin(self) -> float:
        """Return the margin of the centre of mass to the hull of the points of support, in all directions."""
        support = self._np.concatenate(self._support)
        if not len(support):
            return -math.inf
        centre = self._physics.data.subtree_com[1, :2]
        margin = float(((support @ self._directions).max(axis=0) - centre @ self._directions).min())
        self._margin = min(self._margin, margin)
        return margin
