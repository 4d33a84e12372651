"""Poses become actions and a macro, with the times that they took.

Module: servolink.project.teaching.
"""

from __future__ import annotations

import math
import random
import time
from bisect import bisect_left
from collections.abc import Callable

import pytest

from servolink.errors import ProjectError
from servolink.project.build import build_project, extend_project
from servolink.project.model import Project
from servolink.project.teaching import PoseRecorder
from servolink.protocol import Action, Macro, Step


def lesson(seconds: float | None = None) -> PoseRecorder:
    """Begin a lesson at 100 s, with two servos at 0 degrees."""
    return PoseRecorder("Wave", {1: 0, 2: 0}, 100.0, speed_cap=90.0, seconds=seconds)


def test_one_pose_is_an_action() -> None:
    one = lesson()
    one.take({1: 30, 2: 0}, 101.5)
    assert build_project(one.record()) == Project(actions=(Action(1, "Wave", (Step(1, 30, 150), Step(2, 0, 150))),))


def test_several_poses_are_a_macro_with_the_times_between_them() -> None:
    several = lesson()
    several.take({1: 30, 2: 0}, 101.5)
    several.take({1: 0, 2: 10}, 103.75)
    project = extend_project(Project(actions=(Action(1, "Old"),), macros=(Macro(4, "Old"),)), several.record())
    assert [(one.action_id, one.action_caption) for one in project.actions] == [
        (1, "Old"),
        (2, "Wave 1"),
        (3, "Wave 2"),
    ]
    (_, macro) = project.macros
    assert macro.macro_caption == "Wave"
    assert [(one.command_id, one.type, one.total_interval) for one in macro.commands] == [(2, 0, 1500), (3, 0, 2250)]


def test_a_pose_is_never_faster_than_the_cap() -> None:
    hasty = lesson()
    assert hasty.take({1: 90, 2: -180}, 100.01).seconds == 2.0
    assert hasty.take({1: 90, 2: -180}, 100.02).seconds == PoseRecorder.SHORTEST
    assert hasty.take({1: 89, 2: -180}, 9999.0).seconds == PoseRecorder.LONGEST


def test_each_servo_has_its_own_cap_and_counts_from_its_latest_angle() -> None:
    lesson = PoseRecorder("Wave", {1: 0, 2: 0}, 0.0, speed_cap={1: 90, 2: 45})
    assert lesson.least_seconds({1: 90, 2: 90}) == 2.0
    lesson.take({1: 90}, 1.0)
    assert lesson.least_seconds({1: 90, 2: 90}) == 2.0
    assert lesson.least_seconds({1: 0}) == 1.0
    assert lesson.least_seconds({3: 500}) == PoseRecorder.SHORTEST


def test_times_can_be_set() -> None:
    even = lesson(seconds=0.5)
    assert even.take({1: 10}, 107.0).seconds == 0.5
    assert even.take({1: 100}, 108.0).seconds == 1.0


def test_what_is_undone_leaves_no_trace() -> None:
    undone = lesson()
    undone.undo()
    undone.take({1: 10}, 101.0)
    undone.take({1: 90}, 102.0)
    undone.undo()
    assert undone.take({1: 20}, 103.0).seconds == 2.0
    assert [pose.degrees for pose in undone.poses] == [{1: 10}, {1: 20}]


@pytest.mark.parametrize(
    "project",
    [
        Project(actions=(Action(1, "Wave"),)),
        Project(macros=(Macro(1, "Wave"),)),
        Project(actions=(Action(1, "Wave 7"),)),
    ],
)
def test_a_name_is_not_taken_twice(project: Project) -> None:
    with pytest.raises(ProjectError, match=r"there is already (action|macro) 'Wave.*'; choose another name"):
        PoseRecorder.refuse_duplicate(project, "Wave")


def test_a_name_that_is_no_caption_is_refused() -> None:
    long = PoseRecorder("W" * 40, {1: 0}, 0.0, speed_cap=90.0)
    long.take({1: 1}, 1.0)
    with pytest.raises(ProjectError, match="a caption has at most 32 bytes"):
        build_project(long.record())


END, START = {1: 90, 2: -30}, {1: 0.0, 2: 0.0}
CURVES = {
    "linear": lambda time: time,
    "soft": lambda time: (1 - math.cos(math.pi * time)) / 2,
    "snap": lambda time: 1 - (1 - time) ** 3,
}


def test_a_linear_movement_is_one_pose() -> None:
    recorder, worst = PoseRecorder.eased("linear", START, END, 1.0, 1)
    assert [(pose.degrees, pose.seconds) for pose in recorder.poses] == [(END, 1.0)]
    assert worst < 1e-9


@pytest.mark.parametrize("error", [1, 2, 5, 20])
@pytest.mark.parametrize("curve", ["soft", "snap"])
@pytest.mark.parametrize("seconds", [0.0, 0.03, 1.0, PoseRecorder.LONGEST])
def test_an_eased_movement_stays_near_its_curve_and_takes_its_time(curve: str, error: int, seconds: float) -> None:
    recorder, worst = PoseRecorder.eased(curve, START, END, seconds, error)
    assert sum(pose.seconds for pose in recorder.poses) == pytest.approx(max(seconds, 0.01))
    assert recorder.poses[-1].degrees == END
    assert all(pose.seconds >= 0.01 for pose in recorder.poses)
    if seconds >= 1:
        assert worst <= error
        assert furthest(recorder, CURVES[curve]) == pytest.approx(worst, abs=0.1)


def furthest(recorder: PoseRecorder, curve: Callable[[float], float]) -> float:
    """Return the largest distance of the movement from its curve, looked at each 10 ms."""
    total, begin, worst, before = sum(pose.seconds for pose in recorder.poses), 0.0, 0.0, dict(START)
    for pose in recorder.poses:
        after = {**before, **pose.degrees}
        for at in range(round(pose.seconds * 100) + 1):
            done = at / round(pose.seconds * 100)
            for servo, end in END.items():
                angle = before[servo] + (after[servo] - before[servo]) * done
                worst = max(worst, abs(angle - end * curve((begin + pose.seconds * done) / total)))
        begin, before = begin + pose.seconds, after
    return worst


def test_less_error_takes_more_poses() -> None:
    fine, coarse = (len(PoseRecorder.eased("soft", START, END, 1.0, error)[0].poses) for error in (1, 10))
    assert fine > coarse >= 2


def test_soft_begins_slowly_and_snap_quickly() -> None:
    speeds = {}
    for curve in ("soft", "snap"):
        first = PoseRecorder.eased(curve, START, END, 1.0, 2)[0].poses[0]
        speeds[curve] = first.degrees[1] / first.seconds
    assert speeds["soft"] < 90 < speeds["snap"]


def test_a_servo_that_stands_right_already_is_in_the_last_pose_only() -> None:
    recorder, _ = PoseRecorder.eased("soft", {1: 0.0}, END, 1.0, 2)
    assert all(pose.degrees.keys() == {1} for pose in recorder.poses[:-1])
    assert recorder.poses[-1].degrees == END


@pytest.mark.parametrize("error", [1, 2, 5, 10])
def test_thinned_poses_stay_as_near_to_what_was_seen_as_told(error: float) -> None:
    chance = random.Random(5)
    times = [at / 50 for at in range(2000)]
    waves = [60 * math.sin(at) + chance.uniform(-0.3, 0.3) for at in times]
    angles = {2: waves, 3: [abs(50 - at) for at in times]}
    recorder, worst = PoseRecorder.thinned(times, angles, error, 1)
    assert len(recorder.poses) < 500 / error
    assert worst <= error + 0.3
    ends = [sum(pose.seconds for pose in recorder.poses[: at + 1]) - 1 for at in range(len(recorder.poses))]
    for servo_id, row in angles.items():
        for now, seen in zip(times, row, strict=True):
            at = min(max(1, bisect_left(ends, now)), len(ends) - 1)
            low, high = (recorder.poses[each].degrees[servo_id] for each in (at - 1, at))
            played = low + (high - low) * (now - ends[at - 1]) / (ends[at] - ends[at - 1])
            assert abs(played - seen) <= worst + 0.7, (servo_id, now)  # times are whole hundredths of a second
    assert PoseRecorder.thinned(times, {4: [3.0] * 2000}, error, 1)[0].poses == []
    assert PoseRecorder.thinned([], {4: []}, error, 1)[0].poses == []


def test_readings_that_jump_everywhere_are_thinned_in_seconds() -> None:
    chance = random.Random(1)
    times = [float(at) for at in range(3000)]
    angles = {each: [chance.uniform(-90, 90) for _ in times] for each in range(16)}
    began = time.process_time()
    recorder, _ = PoseRecorder.thinned(times, angles, 1, 1)
    assert len(recorder.poses) == 3000
    assert time.process_time() - began < 20
