"""What the page makes of poses that were taken is what `servolink teach` makes of them."""

from __future__ import annotations

from typing import Any

import pytest

from servolink.errors import ProjectError
from servolink.project import PoseRecorder, Project, ProjectFile, build_project
from servolink.protocol import Action, Macro
from tests.studio.web_code import call_all, needs_node

pytestmark = needs_node

_LESSON = "state/lesson.js"
_EMPTY: dict[str, Any] = {**ProjectFile(Project()).form(), "actions": [], "macros": []}
_TIMES = [1.0, 1.204, 1.274, 1.28, 4.0, 900.0]
_POSES = [{2: 0, 3: 10}, {2: 15, 3: 10}, {2: -90, 3: 0}, {2: -90, 3: 0}, {2: 0, 3: 1}, {2: 0, 3: 0}]


def taught() -> PoseRecorder:
    recorder = PoseRecorder("Wave", _POSES[0], 0.5, speed_cap=120)
    for pose, time in zip(_POSES, _TIMES, strict=True):
        recorder.take(pose, time)
    return recorder


def film() -> list[dict[str, Any]]:
    return [{"pose": pose.degrees, "ids": [2, 3], "seconds": pose.seconds, "at": 0} for pose in taught().poses]


def test_poses_get_the_times_of_the_command_line() -> None:
    start, caps = {"pose": _POSES[0], "at": 0.5}, {2: 120, 3: 120}
    taken: list[Any] = []
    for pose, time in zip(_POSES, _TIMES, strict=True):
        (taken,) = call_all([(_LESSON, "withPose", [taken, start, {"pose": pose, "ids": [2, 3], "at": time}, caps])])
    assert [one["seconds"] for one in taken] == [pose.seconds for pose in taught().poses]


def test_a_lesson_becomes_the_records_of_the_command_line() -> None:
    (made,) = call_all([(_LESSON, "withLesson", [_EMPTY, "Wave", film()])])
    expected = ProjectFile(build_project(taught().record())).form()
    for macro in expected["macros"]:  # the page adds the durations with every edit of its draft
        macro["commands"] = [{**command, "total_interval_ms": 0} for command in macro["commands"]]
    assert made["project"]["actions"] == expected["actions"]
    assert made["project"]["macros"] == expected["macros"]
    assert (made["actionId"], made["macroId"]) == (1, 1)


def test_a_single_pose_becomes_an_action() -> None:
    (made,) = call_all([(_LESSON, "withLesson", [_EMPTY, "Wave", film()[:1]])])
    assert [action["action_caption"] for action in made["project"]["actions"]] == ["Wave"]
    assert (made["project"]["macros"], made.get("macroId")) == ([], None)


_CAPTIONS = ["Wave", "Wave 2", "Wave  2", "Wave x", "Wave 2x", "wave", "Wave ", "", "A b 7"]


@pytest.mark.parametrize("name", ["Wave", "Wave 2", "A b", "New"])
def test_names_are_refused_as_by_the_command_line(name: str) -> None:
    projects = [Project(actions=(Action(1, caption),)) for caption in _CAPTIONS]
    projects += [Project(macros=(Macro(1, caption),)) for caption in _CAPTIONS]
    found = call_all([(_LESSON, "whyNot", [{**_EMPTY, **form(each)}, name, 3]) for each in projects])
    assert [why == "teach.name_taken" for why in found] == [is_refused(each, name) for each in projects]


def test_a_name_must_leave_room_for_the_number() -> None:
    names = ["N" * 30, "N" * 31, "\u7eff" * 10, "\u7eff" * 11]
    found = call_all([(_LESSON, "whyNot", [_EMPTY, name, 9]) for name in names])
    assert found == ["", "teach.name_long", "", "teach.name_long"]


def form(project: Project) -> dict[str, Any]:
    whole = ProjectFile(project).form()
    return {"actions": whole["actions"], "macros": whole["macros"]}


def is_refused(project: Project, name: str) -> bool:
    try:
        PoseRecorder.refuse_duplicate(project, name)
    except ProjectError:
        return True
    return False
