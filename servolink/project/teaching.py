"""Recording of poses of limbs moved by hand, and conversion to actions and a macro."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import ChainMap
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import ClassVar

from msgspec import Struct

from servolink.errors import ProjectError
from servolink.project.model import Project
from servolink.protocol import ACTION, MACRO, Action, Macro


class Pose(Struct, frozen=True):
    """Pose, with the time from the previous pose."""

    degrees: dict[int, int]
    """Angles by servo id."""
    seconds: float


_CURVES: Mapping[str, Callable[[float], float]] = {
    "linear": lambda time: time,
    "soft": lambda time: (1 - math.cos(math.pi * time)) / 2,
    "snap": lambda time: 1 - (1 - time) ** 3,
}
"""Share of the way by share of the time: steady, slow at both ends, or quick at first and then slower."""
_SAMPLES = 24
_SPAN = 250  # readings that are thinned together: the work grows with their square
_ROUNDING = 0.5  # degrees: actions have whole ones


def _distance(curve: Callable[[float], float], begin: float, until: float, low: float, high: float) -> float:
    """Return how far the line from `low` to `high` is from a curve at most."""
    shares = [at / _SAMPLES for at in range(_SAMPLES + 1)]
    return max(abs(low + (high - low) * at - curve(begin + (until - begin) * at)) for at in shares)


def _latest(share: Callable[[float], float], begin: int, units: int, allowed: float) -> int:
    """Return the latest end of a line from `begin` that stays near a curve, all times in units."""

    def is_far(end: int) -> bool:
        first, last = begin / units, end / units
        return _distance(share, first, last, share(first), share(last)) > allowed

    return begin + 1 + bisect_left(range(begin + 2, units + 1), 1, key=is_far)


def _farthest(
    times: Sequence[float], angles: Sequence[Sequence[float]], begin: int, until: int
) -> tuple[float, int, float]:
    """Return the worst distance of readings from the line between two of them in degrees, where, and the worst at all.

    A reading nearer to either end than `SHORTEST` leaves no time for a pose: it counts only for the worst at all.
    """
    worst, place, worst_of_all = 0.0, begin, 0.0
    length = times[until] - times[begin]
    for at in range(begin + 1, until):
        share = (times[at] - times[begin]) / length
        error = max(
            (
                abs(low + (high - low) * share - now)
                for low, high, now in zip(angles[begin], angles[until], angles[at], strict=True)
            ),
            default=0,
        )
        worst_of_all = max(worst_of_all, error)
        least = PoseRecorder.SHORTEST
        if error > worst and times[at] - times[begin] >= least and times[until] - times[at] >= least:
            worst, place = error, at
    return worst, place, worst_of_all


class PoseRecorder:
    """Recorder of poses, each with the time from the previous pose."""

    SHORTEST: ClassVar[float] = 0.1
    """Seconds for a pose at least, so that it looks like a movement."""
    LONGEST: ClassVar[float] = 327.67
    """Seconds for a pose at most, by the protocol."""

    def __init__(
        self,
        caption: str,
        start: Mapping[int, int],
        now: float,
        *,
        speed_cap: float | Mapping[int, float],
        seconds: float | None = None,
    ) -> None:
        """Start at the pose `start`, degrees by servo id, at the time `now`.

        A pose gets the time since the previous pose, or `seconds`; in any case enough time to stay below `speed_cap`
        degrees per second, of all servos or by servo id.
        """
        self.caption = caption
        self.poses: list[Pose] = []
        self._start = dict(start)
        self._times = [now]
        self._seconds = seconds
        self._speed_cap = speed_cap

    @classmethod
    def eased(
        cls, curve: str, start: Mapping[int, float], end: Mapping[int, int], seconds: float, error: float
    ) -> tuple[PoseRecorder, float]:
        """Return poses from `start` to `end` along the curve `linear`, `soft` or `snap`, and the worst error, degrees.

        Servos turn steadily from pose to pose, by servo id, so each pose is as late as the error allows, at least 1
        degree. The last pose has all servos, others only those that turn.
        """
        share, units = _CURVES[curve], max(1, round(seconds * 100))
        ways = {servo_id: (start.get(servo_id, angle), angle) for servo_id, angle in end.items()}
        longest = max((abs(last - first) for first, last in ways.values()), default=0)
        times = [0]
        while times[-1] < units:
            times.append(_latest(share, times[-1], units, (error - _ROUNDING) / max(longest, _ROUNDING)))
        recorder, worst = cls("", {}, 0, speed_cap=math.inf), 0.0
        for begin, until in pairwise(times):
            degrees: dict[int, int] = {}
            for servo_id, (first, last) in ways.items():

                def angle(at: float, first: float = first, way: float = last - first) -> float:
                    return first + way * share(at / units)

                low, high = round(angle(begin)), round(angle(until))
                worst = max(worst, _distance(angle, begin, until, low, high))
                if high != low or until == units:
                    degrees[servo_id] = high
            recorder.poses.append(Pose(degrees, (until - begin) / 100))
        return recorder, worst

    @classmethod
    def thinned(
        cls, times: Sequence[float], angles: Mapping[int, Sequence[float]], error: float, lead: float
    ) -> tuple[PoseRecorder, float]:
        """Return few poses of a movement that was seen, and the worst error, degrees: Ramer, Douglas and Peucker.

        `times` are ascending, in seconds, and `angles` has the readings of each servo at these times. Between two poses
        each servo turns steadily, no farther than `error` degrees from its readings, unless poses would be nearer than
        `SHORTEST`. Servos that stay within the error are left out. The first pose is reached in `lead` seconds.
        """
        moved = {each: row for each, row in angles.items() if row and max(row) - min(row) > error}
        recorder, rows = cls("", {}, 0, speed_cap=math.inf), [*zip(*moved.values(), strict=True)]
        if not rows:
            return recorder, 0.0
        last = len(rows) - 1
        worst, open_spans = 0.0, [*pairwise([*range(0, last, _SPAN), last])]
        kept = {0, last, *range(0, last, _SPAN)}
        while open_spans:
            begin, until = open_spans.pop()
            distance, at, worst_of_span = _farthest(times, rows, begin, until)
            if distance > error - _ROUNDING:
                kept.add(at)
                open_spans += [(begin, at), (at, until)]
            else:
                worst = max(worst, worst_of_span + _ROUNDING)
        before = 0
        for at in sorted(kept):
            now = round((times[at] - times[0] + lead) * 100)  # so that roundings of times do not add up
            degrees = {each: round(angle) for each, angle in zip(moved, rows[at], strict=True)}
            recorder.poses.append(Pose(degrees, (now - before) / 100))
            before = now
        return recorder, worst

    def take(self, degrees: Mapping[int, int], now: float) -> Pose:
        """Record the present pose of the servos."""
        duration = now - self._times[-1] if self._seconds is None else self._seconds
        pose = Pose(dict(degrees), max(self._rounded(duration), self.least_seconds(degrees)))
        self.poses.append(pose)
        self._times.append(now)
        return pose

    def least_seconds(self, degrees: Mapping[int, int]) -> float:
        """Return the least time for a pose after the last one, seconds. A servo without a known angle needs none."""
        before = ChainMap({}, *(pose.degrees for pose in reversed(self.poses)), self._start)
        ways = {servo_id: abs(angle - before.get(servo_id, angle)) for servo_id, angle in degrees.items()}
        caps = self._speed_cap
        needed = (
            way / (caps if isinstance(caps, float | int) else caps.get(servo_id, math.inf))
            for servo_id, way in ways.items()
        )
        return self._rounded(max(needed, default=0))

    def _rounded(self, seconds: float) -> float:
        """Return a time in the resolution of the protocol, rounded up; rounded first, or 0.07 s would become 0.08 s."""
        return min(math.ceil(round(max(seconds, self.SHORTEST) * 100, 6)) / 100, self.LONGEST)

    def undo(self) -> None:
        """Remove the last pose. No effect without one."""
        if self.poses:
            self.poses.pop()
            self._times.pop()

    def record(self) -> Action | Macro:
        """Return the action of a single pose, or a macro with an action for each pose."""
        if len(self.poses) == 1:
            return self._action(self.caption, self.poses[0])
        actions = [self._action(f"{self.caption} {at}", pose) for at, pose in enumerate(self.poses, 1)]
        return Macro.of(self.caption, *actions)

    @staticmethod
    def _action(caption: str, pose: Pose) -> Action:
        return Action.pose(caption, pose.degrees, seconds=pose.seconds)

    @staticmethod
    def refuse_duplicate(project: Project, caption: str) -> None:
        """Raise ProjectError if an action or a macro has this caption, or an action that of a pose of the macro."""
        for kind in (ACTION, MACRO):
            for existing in (kind.caption_of(record) for record in kind.by_id(project).values()):
                name, _, number = existing.rpartition(" ")
                if existing == caption or (kind is ACTION and name == caption and number.isdecimal()):
                    raise ProjectError(f"there is already {kind} '{existing}'; choose another name")
