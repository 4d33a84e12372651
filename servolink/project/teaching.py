"""A lesson: the poses of a limb that somebody moves by hand, and the actions and the macro that come of them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from msgspec import Struct

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.project.model import Project
from servolink.protocol.records import Action, Macro

SHORTEST, LONGEST = 0.1, 327.67
"""Seconds that a pose may take: the first that looks like a movement, the last that the protocol has."""


class Pose(Struct, frozen=True):
    """Where servos are to be."""

    degrees: dict[int, int]
    """By servo id."""
    seconds: float
    """From the pose before."""


class PoseRecorder:
    """Takes poses, each with the time that it took to get there."""

    def __init__(
        self, caption: str, start: Mapping[int, int], now: float, *, speed_cap: float, seconds: float | None = None
    ) -> None:
        """Begin at `start`, degrees by servo id, at the time `now`.

        Each pose takes the time since the one before, or `seconds` if given, but never less than its longest way
        takes at `speed_cap` degrees per second.
        """
        self.caption = caption
        self.poses: list[Pose] = []
        self._start = dict(start)
        self._times = [now]
        self._seconds = seconds
        self._speed_cap = speed_cap

    def take(self, degrees: Mapping[int, int], now: float) -> Pose:
        """Add the pose that the servos are in."""
        before = self.poses[-1].degrees if self.poses else self._start
        way = max((abs(angle - before[servo_id]) for servo_id, angle in degrees.items()), default=0)
        wish = now - self._times[-1] if self._seconds is None else self._seconds
        seconds = min(max(wish, way / self._speed_cap, SHORTEST), LONGEST)
        pose = Pose(dict(degrees), min(math.ceil(round(seconds * 100, 6)) / 100, LONGEST))
        self.poses.append(pose)
        self._times.append(now)
        return pose

    def undo(self) -> None:
        """Forget the last pose, if there is one."""
        if self.poses:
            self.poses.pop()
            self._times.pop()

    def record(self) -> Action | Macro:
        """Return the action of a single pose, or the macro that plays an action for each pose."""
        if len(self.poses) == 1:
            return self._action(self.caption, self.poses[0])
        actions = [self._action(f"{self.caption} {at}", pose) for at, pose in enumerate(self.poses, 1)]
        return Macro.of(self.caption, *actions)

    @staticmethod
    def _action(caption: str, pose: Pose) -> Action:
        return Action.pose(caption, pose.degrees, seconds=pose.seconds)


def refuse_taken(project: Project, caption: str) -> None:
    """Raise ProjectError if an action or a macro has this caption, or one that its poses would have."""
    for word, captions in (
        ("action", [action.action_caption for action in project.actions]),
        ("macro", [macro.macro_caption for macro in project.macros]),
    ):
        for taken in captions:
            name, _, number = taken.rpartition(" ")
            if taken == caption or (word == "action" and name == caption and number.isdecimal()):
                raise ProjectError(f"there is {word} '{escape(taken)}' already; take another name")
