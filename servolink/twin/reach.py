"""Reach: poses in which hands and feet are at given places."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from servolink.errors import TwinError, quote
from servolink.project import Feet, Figure, Joint
from servolink.twin.body import Body, metres, read_figure
from servolink.twin.mjcf import part_names
from servolink.twin.placement import Vector
from servolink.twin.simulation import Physics, mujoco

REACHED: Final = 0.003
"""Distance in metres within which a place is reached."""

_FARTHEST = 10.0  # metres
_CLOSE = 1e-4  # metres: the search ends
_ITERATIONS = 40
_RESTARTS = 8
_ALIKE = 2  # more searches in a row that end as near: no pose is nearer
_NUDGE = 0.15  # share of the way to a random pose: from straight legs no small step leads down
_LONGEST_STEP = 0.8  # radians, or metres of the base
_FIRM = 30.0  # weight of feet that stand, where a goal 100 mm away has 1
_BALANCE = 3.0  # weight of the centre of mass above the feet
_LEVER = 0.1  # metres: a turn of a foot counts as a move at this distance
_ENDS = {"hand": "arm", "foot": "leg"}


@dataclass(frozen=True, slots=True)
class Reach:
    """Answer of `PosableFigure.reach`."""

    angles: dict[int, float]
    """Angles in degrees by servo id, of the servos that lead to the places."""
    distances: dict[str, float]
    """Distance of each part from the place asked for, in metres."""

    @property
    def degrees(self) -> dict[int, int]:
        """Angles in whole degrees, for `Board.move` and the steps of actions."""
        return {servo_id: round(angle) for servo_id, angle in self.angles.items()}

    @property
    def is_reached(self) -> bool:
        """Whether each part is within 3 mm of its place."""
        return max(self.distances.values()) <= REACHED


class _Goal(NamedTuple):
    """Place for a point of a body of the model; for the centre of mass, if that is body 0."""

    body: int
    point: Any
    place: Any
    weight: float = 1.0
    rotation: Any = None
    """Rotation to keep, as a matrix; None for any."""


class PosableFigure:
    """Figure of a project, to compute poses; no robot moves.

    Places are in metres: x forwards, y to the left of the robot, z up from the floor. The origin is below the base of
    the figure at rest; that is with all servos at 0, or at the nearest limit.
    """

    def __init__(self, figure: Figure) -> None:
        """Give the figure a body. Raise TwinError for a figure without a possible body, or without MuJoCo."""
        self._figure = figure
        self._physics = Physics(Body.of(figure))
        self._mujoco = mujoco()
        import numpy as np  # late: MuJoCo brings it

        body, model, ids = self._physics.body, self._physics.model, self._physics.servo_ids
        names = zip(body.parts, part_names(body), strict=True)
        self._bodies = {part.name: int(model.body(name).id) for part, name in names}
        # Columns: the servos, and the six freedoms of a base that stands free. Rows: the joints of the model.
        self._columns = np.zeros((model.nv, len(ids) + (0 if body.bolted else 6)))
        if not body.bolted:
            self._columns[:6, len(ids) :] = np.eye(6)
        self._positions: list[list[int]] = [[] for _ in ids]  # in `data.qpos`, with those of followers
        for part in body.parts:
            if part.servo is not None:
                joint, at = model.body_jntadr[self._bodies[part.name]], ids.index(part.servo)
                self._columns[model.jnt_dofadr[joint], at] = 1
                self._positions[at].append(int(model.jnt_qposadr[joint]))
        limits = [body.drives[servo_id][0].limits for servo_id in ids]
        self._low, self._high = np.array(limits).reshape(-1, 2).T

    def place(self, part: str, angles: Mapping[int, float] | None = None) -> Vector:
        """Return the place of a part in metres, with servos at `angles` (degrees) and all others at rest.

        Raise TwinError for an unknown part.
        """
        goal = self._goal(part, (0, 0, 0))
        self._pose(angles or {})
        x, y, z = self._point(goal).tolist()
        return x, y, z

    def reach(self, places: Mapping[str, Sequence[float]], start: Mapping[int, float] | None = None) -> Reach:
        """Return a pose with parts at places, or as near as the search comes to them.

        The servos between the base and each part turn, within their limits. Where these do not suffice, a robot on
        feet also bends its legs: the feet stay where they are, and the centre of mass above them.

        Args:
            places: Place in metres of each part. A part is named by the id of its joint, or, as in "left hand", "Left
                arm" or "right foot", by its group in the figure. It is moved by its tip; a foot by its sole.
            start: Angles in degrees by servo id, from which the search begins; other servos are at rest.

        Raises:
            TwinError: A part is unknown or cannot move, or a place is not three numbers within 10 m.
        """
        goals = [self._goal(part, place) for part, place in places.items()]
        servos = self._leading_to(goals)
        standing = not self._physics.body.bolted and bool(self._physics.body.feet)
        if not servos and not standing:
            raise TwinError(f"reach: no servo moves {', '.join(map(quote, places)) or 'anything, as no part is named'}")
        begin = self._pose(start or {})
        found, missed = self._search(goals, [], servos, begin, 1.0)
        if missed > REACHED and standing:
            stance = self._stance(begin, goals, max(1.0, missed / 0.1))
            legs = self._leading_to(stance)
            base = range(len(self._positions), self._columns.shape[1])
            other, less = self._search(goals, stance, [*sorted({*servos, *legs}), *base], found, _NUDGE)
            if less < missed - _CLOSE:
                found, servos = other, sorted({*servos, *legs})
        self._move(found)
        distances = [math.dist(self._point(goal), goal.place) for goal in goals]
        ids, positions = self._physics.servo_ids, self._physics.positions
        angles = {ids[at]: math.degrees(found[positions[at]]) for at in servos}
        return Reach(angles, dict(zip(places, distances, strict=True)))

    def _goal(self, part: str, place: Sequence[float]) -> _Goal:
        import numpy as np

        joint = self._joint(part)
        try:
            target = np.array(place, dtype=float).reshape(3)
        except (TypeError, ValueError):
            target = np.array([math.nan])
        if not (np.abs(target) <= _FARTHEST).all():
            raise TwinError(f"reach: the place of {quote(part)} must be three numbers in metres, not {quote(place)}")
        return _Goal(self._bodies[joint.id], np.array(self._tip(joint)), target)

    def _joint(self, part: str) -> Joint:
        """Return the joint with an id, or the last of a group by its name in any language."""
        name = part.casefold()
        side, _, end = name.rpartition(" ")
        wanted = {name, f"{side} {_ENDS.get(end, end)}"}
        groups = {each.casefold(): group for group, names in self._figure.groups.items() for each in names.values()}
        of_group = {groups[each] for each in wanted & groups.keys()}
        for joint in reversed(self._figure.joints):
            if joint.id == part or joint.group in of_group:
                return joint
        known = ", ".join(map(quote, [joint.id for joint in self._figure.joints] + list(groups)))
        raise TwinError(f"reach: the figure has no part {quote(part)}; known are {known}")

    def _tip(self, joint: Joint) -> Vector:
        """Return the point of a joint to move to a place, in metres in its frame."""
        base = self._figure.base
        if isinstance(base, Feet) and joint.id in base.feet:
            return metres(base.sole)
        x, y, z = joint.along
        length = joint.length or 0.0
        return metres(joint.tip or (x * length, y * length, z * length))

    def _leading_to(self, goals: Sequence[_Goal]) -> list[int]:
        """Return the columns of the servos between the base and the parts."""
        model, found = self._physics.model, set[int]()
        for goal in goals:
            body = goal.body
            while body:
                if model.body_dofnum[body] == 1:
                    found.update(self._columns[model.body_dofadr[body]].nonzero()[0].tolist())
                body = model.body_parentid[body]
        return sorted(found)

    def _stance(self, begin: Any, goals: Sequence[_Goal], weight: float) -> list[_Goal]:
        """Return the goals to keep the feet that are to stand, and the centre of mass, as in the pose `begin`."""
        self._move(begin)
        data, moved = self._physics.data, {goal.body for goal in goals}
        feet = [foot for name in self._physics.body.feet if (foot := self._bodies[name]) not in moved]
        origin = 0 * data.xpos[0]
        stance = [
            _Goal(foot, origin, data.xpos[foot].copy(), weight * _FIRM, data.xmat[foot].reshape(3, 3).copy())
            for foot in feet
        ]
        return [*stance, _Goal(0, origin, data.subtree_com[1].copy(), weight * _BALANCE)]

    def _pose(self, angles: Mapping[int, float]) -> Any:
        """Put the figure at rest, and then servos at angles in degrees up to their limits; return the positions."""
        self._physics.reset()
        qpos = self._physics.data.qpos.copy()
        for at, servo_id in enumerate(self._physics.servo_ids):
            if servo_id in angles:
                qpos[self._positions[at]] = min(max(math.radians(angles[servo_id]), self._low[at]), self._high[at])
        self._move(qpos)
        return qpos

    def _move(self, qpos: Any) -> None:
        """Put all parts where the positions `qpos` have them."""
        model, data = self._physics.model, self._physics.data
        data.qpos[:] = qpos
        self._mujoco.mj_kinematics(model, data)
        self._mujoco.mj_comPos(model, data)

    def _point(self, goal: _Goal) -> Any:
        """Return the present place of the point of a goal."""
        data = self._physics.data
        return data.xpos[goal.body] + data.xmat[goal.body].reshape(3, 3) @ goal.point

    def _search(
        self, goals: list[_Goal], stance: list[_Goal], columns: list[int], start: Any, share: float
    ) -> tuple[Any, float]:
        """Return the best positions found, and the largest distance from a goal.

        The search begins at `start`, and again at a `share` of the way from there to random poses.
        """
        import numpy as np

        random = np.random.default_rng(0)  # the same question has the same answer
        best, least, alike = start, math.inf, 0
        for attempt in range(_RESTARTS + 1 if columns else 1):
            qpos = start.copy()
            for at, positions in enumerate(self._positions):
                if attempt and at in columns:
                    qpos[positions] += share * (random.uniform(self._low[at], self._high[at]) - qpos[positions])
            found = self._descend([*goals, *stance], columns, qpos)
            missed = max(math.dist(self._point(goal), goal.place) for goal in goals)
            alike = alike + 1 if abs(missed - least) < _CLOSE else 0
            if missed < least - _CLOSE:
                best, least = found, missed
            if least < REACHED / 3 or alike == _ALIKE:
                break
        return best, least

    def _descend(self, goals: list[_Goal], columns: list[int], qpos: Any) -> Any:
        """Return the positions at the nearest minimum of the distances, by the method of Levenberg and Marquardt."""
        self._move(qpos)
        missed, rows, damping = self._missed(goals), self._rows(goals, columns), 1e-4
        for _ in range(_ITERATIONS if columns else 0):
            other = qpos.copy()
            step = self._columns[:, columns] @ self._step(missed, rows, damping, columns, qpos)
            self._mujoco.mj_integratePos(self._physics.model, other, step, 1)
            self._move(other)
            now = self._missed(goals)
            gain = missed @ missed - now @ now
            if gain > 0:
                qpos, missed, rows, damping = other, now, self._rows(goals, columns), max(damping / 5, 1e-8)
            else:
                damping *= 10
            if missed @ missed < _CLOSE**2 or damping > 1e3 or 0 < gain < 1e-4 * _CLOSE * math.sqrt(missed @ missed):
                break
        self._move(qpos)
        return qpos

    def _missed(self, goals: list[_Goal]) -> Any:
        """Return the weighted ways from the present places to the goals."""
        import numpy as np

        data, parts = self._physics.data, []
        for goal in goals:
            if not goal.body:
                parts.append(goal.weight * (goal.place - data.subtree_com[1])[:2])
                continue
            parts.append(goal.weight * (goal.place - self._point(goal)))
            if goal.rotation is not None:
                turn = np.cross(data.xmat[goal.body].reshape(3, 3), goal.rotation, axis=0).sum(axis=1) / 2
                parts.append(goal.weight * _LEVER * turn)
        return np.concatenate(parts)

    def _rows(self, goals: list[_Goal], columns: list[int]) -> Any:
        """Return the derivatives of the weighted places by the columns."""
        import numpy as np

        model, data, parts = self._physics.model, self._physics.data, []
        for goal in goals:
            move, turn = np.zeros((2, 3, model.nv))
            if not goal.body:
                self._mujoco.mj_jacSubtreeCom(model, data, move, 1)
                parts.append(goal.weight * move[:2])
                continue
            self._mujoco.mj_jac(model, data, move, turn, self._point(goal), goal.body)
            parts.append(goal.weight * move)
            if goal.rotation is not None:
                parts.append(goal.weight * _LEVER * turn)
        return np.concatenate(parts) @ self._columns[:, columns]

    def _step(self, missed: Any, rows: Any, damping: float, columns: list[int], qpos: Any) -> Any:
        """Return the damped step of least squares within the limits of the servos."""
        import numpy as np

        servos = [at for at in columns if at < len(self._low)]
        now = qpos[[self._physics.positions[at] for at in servos]]
        low, high = np.full((2, len(columns)), [[-_LONGEST_STEP], [_LONGEST_STEP]])
        low[: len(servos)] = np.maximum(low[: len(servos)], self._low[servos] - now)
        high[: len(servos)] = np.minimum(high[: len(servos)], self._high[servos] - now)
        step, free = np.zeros(len(columns)), np.ones(len(columns), dtype=bool)
        while free.any():
            some = rows[:, free]
            square = some.T @ some + damping * np.eye(some.shape[1])
            step[free] = np.linalg.solve(square, some.T @ (missed - rows[:, ~free] @ step[~free]))
            clipped = np.clip(step, low, high)
            stuck = free & (clipped != step)
            step = clipped
            if not stuck.any():
                break
            free &= ~stuck
        return step


def load_figure(path: str | os.PathLike[str]) -> PosableFigure:
    """Return the figure of a project file, to compute poses.

    Raises:
        ProjectError: The file cannot be read.
        TwinError: The file has no figure, the figure has no possible body, or MuJoCo is missing.
    """
    return PosableFigure(read_figure(path)[1])
