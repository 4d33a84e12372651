"""The studio opens and saves the files of the command line, checks projects, and shows what backups hold."""

from __future__ import annotations

import json
from typing import Any

import pytest

from servolink import Action, Macro, MacroCommand, Project, Step
from servolink.boards import BoardProfile, ProfileInUse, SafetyLimits
from servolink.control import Code
from servolink.project import BackupStore, PoseRecorder, ProjectFile
from servolink.studio.project_methods import findings
from tests.studio.serving import Place, call, run, welcomed

pytestmark = pytest.mark.usefixtures("user")

TEXT = """{"schema": 1, "$schema": "servolink-project.schema.json", "actions": [
  {"action_id": 2, "action_caption": "<img src=x>", "steps": [{"servo_id": 1, "degree": 40, "interval_ms": 500}]},
  {"action_id": 1, "action_caption": "", "steps": []}]}"""


async def called(place: Place, method: str, **params: Any) -> Any:
    async with place.page() as page:
        await welcomed(page, place.gate.new_token("edit"))
        return await call(page, method, **params)


def test_a_page_asks_for_the_images_of_servos() -> None:
    async def test(place: Place) -> None:
        images = (await called(place, "project.images", captions={"1": "left", "2": "right"}))["result"]["images"]
        assert {servo: (image["servo"], image["is_right"]) for servo, image in images.items()} == {
            "1": (2, False),
            "2": (1, True),
        }

    run(test)


LESSON: dict[str, Any] = {"name": "Wave", "start": {"2": 0}, "caps": {"2": 90}, "actions": {"1": "Old"}, "macros": {}}


def test_poses_taken_by_hand_get_times_and_become_records() -> None:
    async def test(place: Place) -> None:
        poses = [{"degrees": {"2": 90}, "seconds": 0.2}, {"degrees": {"2": 45}, "seconds": 2.5}]
        made = (await called(place, "project.lesson", poses=poses, **LESSON))["result"]
        assert (made["seconds"], made["least_seconds"], made["refusal"]) == ([1, 2.5], [1, 0.5], "")
        assert [(one["action_id"], one["action_caption"]) for one in made["actions"]] == [(2, "Wave 1"), (3, "Wave 2")]
        assert made["actions"][0]["steps"] == [{"servo_id": 2, "degree": 90, "interval_ms": 1000}]
        (macro,) = made["macros"]
        assert [(one["action_id"], one["total_interval_ms"]) for one in macro["commands"]] == [(2, 1000), (3, 2500)]
        (only,) = (await called(place, "project.lesson", poses=poses[:1], **LESSON))["result"]["actions"]
        assert only["action_caption"] == "Wave"
        nothing = (await called(place, "project.lesson", poses=[], **LESSON))["result"]
        assert (nothing["actions"], nothing["macros"]) == ([], [])

    run(test)


def test_a_movement_is_eased_and_becomes_records_of_the_size_that_was_told() -> None:
    async def test(place: Place) -> None:
        movement: dict[str, Any] = {"curve": "soft", "start": {"2": 0}, "end": {"2": 90}, "seconds": 1, "error": 2}
        eased = (await called(place, "project.ease", **movement))["result"]
        question = {**LESSON, "name": "Old", "poses": eased["poses"], "caps": {}, "may_repeat": True}
        made = (await called(place, "project.lesson", **question))["result"]
        count = len(eased["poses"])
        assert (len(made["actions"]), len(made["macros"][0]["commands"])) == (count, count)
        assert eased["size_bytes"] == (38 + 5) * count + 38 + 12 * count
        assert 0.5 <= eased["worst"] <= 2

    run(test)


def test_a_movement_that_was_seen_becomes_few_poses() -> None:
    async def test(place: Place) -> None:
        times = [at / 50 for at in range(101)]
        up_and_down = [90 - abs(90 - 1.8 * at) for at in range(101)]
        seen = {"times": times, "angles": {"2": up_and_down, "3": [7.2] * 101}, "error": 2, "lead": 1}
        found = (await called(place, "project.thin", **seen))["result"]
        assert found["poses"] == [
            {"degrees": {"2": 0}, "seconds": 1},
            {"degrees": {"2": 90}, "seconds": 1},
            {"degrees": {"2": 0}, "seconds": 1},
        ]
        assert (found["worst"], found["size_bytes"]) == (pytest.approx(0.5), 3 * (38 + 5) + 38 + 3 * 12)
        assert (await called(place, "project.thin", **{**seen, "angles": {}}))["result"]["poses"] == []
        for fault in ({"angles": {"2": [0]}}, {"times": times[::-1]}):
            answer = await called(place, "project.thin", **{**seen, **fault})
            assert "record again" in answer["error"]["message"]

    run(test)


@pytest.mark.parametrize(
    ("method", "more"),
    [
        ("project.thin", {"times": [1e300]}),
        ("project.thin", {"error": 0}),
        ("project.thin", {"lead": 0}),
        ("project.thin", {"angles": {"2": [1e300]}}),
        ("project.ease", {"end": {"2": 10**400}}),
        ("project.ease", {"start": {"2": -0x8000}}),
        ("project.ease", {"seconds": 1e300}),
        ("project.ease", {"error": 0}),
        ("project.ease", {"end": {str(servo): 1 for servo in range(257)}}),
        ("project.lesson", {"start": {"2": 10**400}}),
        ("project.lesson", {"caps": {"2": 1e-320}}),
        ("project.lesson", {"poses": [{"degrees": {"2": 1}, "seconds": 1e300}]}),
        ("project.images", {"captions": {"two": "left"}}),
    ],
)
def test_values_that_no_board_takes_are_refused_by_name(method: str, more: dict[str, Any]) -> None:
    async def test(place: Place) -> None:
        movement: dict[str, Any] = {"curve": "soft", "start": {"2": 0}, "end": {"2": 90}, "seconds": 1, "error": 2}
        seen: dict[str, Any] = {"times": [], "angles": {}, "error": 2, "lead": 1}
        usual = {"project.ease": movement, "project.lesson": {**LESSON, "poses": []}, "project.thin": seen}
        params = usual.get(method, {})
        answer = await called(place, method, **{**params, **more})
        assert answer["error"]["code"] == Code.INVALID_PARAMS

    run(test)


def test_the_longest_movement_of_all_servos_has_less_than_a_thousand_poses() -> None:
    start, end = (dict.fromkeys(range(256), way) for way in (-0x7FFF, 0x7FFF))
    recorder, _ = PoseRecorder.eased("soft", start, end, PoseRecorder.LONGEST, 1)
    assert len(recorder.poses) < 1000


@pytest.mark.parametrize(
    ("name", "count", "refusal"),
    [
        ("Old", 1, "name_taken"),
        ("Wave 2", 1, ""),
        ("N" * 32, 1, ""),
        ("N" * 33, 1, "name_long"),
        ("N" * 30, 9, ""),
        ("N" * 31, 9, "name_long"),
        ("\u7eff" * 10, 9, ""),
        ("\u7eff" * 11, 9, "name_long"),
    ],
)
def test_the_name_of_a_lesson_must_be_free_and_leave_room_for_the_number(name: str, count: int, refusal: str) -> None:
    async def test(place: Place) -> None:
        poses = [{"degrees": {"2": at}, "seconds": 1} for at in range(count)]
        answer = await called(place, "project.lesson", **{**LESSON, "poses": poses, "name": name})
        assert answer["result"]["refusal"] == refusal

    run(test)


def test_a_page_asks_how_motions_of_another_robot_fit_before_they_are_pasted() -> None:
    async def test(place: Place) -> None:
        steps = [{"servo_id": 1, "degree": 40, "interval_ms": 500}]
        action = {"action_id": 7, "action_caption": "Up", "steps": steps}
        servos = [{"id": 1, "caption": "L arm", "part": ""}]
        copied = {"kind": "servolink motions", "version": 1, "servos": servos, "actions": [action], "macros": []}
        ours = [{"id": 2, "caption": "l arm", "part": ""}, {"id": 3, "caption": "R arm", "part": ""}]
        question = {"text": json.dumps(copied), "project": {"schema": 1}, "servos": ours}
        found = (await called(place, "project.paste", **question))["result"]
        assert (found["servos"], found["pairs"], found["names"]) == (servos, {"1": 2}, ["Up"])
        assert found["actions"] == [{**action, "action_id": 1, "steps": [{**steps[0], "servo_id": 2}]}]
        mirror = {"captions": {"2": "L arm", "3": "R arm"}}
        fit = {"mirror": mirror, "percent": 200}
        (made,) = (await called(place, "project.paste", **question, **fit))["result"]["actions"]
        assert made["steps"] == [{"servo_id": 3, "degree": -40, "interval_ms": 1000}]
        lost = (await called(place, "project.paste", **question, pairs={}))["result"]
        assert (lost["actions"], lost["left"]) == ([], ["Up"])
        foreign = (await called(place, "project.paste", **{**question, "text": "<img src=x>"}))["result"]
        assert (foreign["names"], foreign["actions"]) == ([], [])
        error = (await called(place, "project.paste", **question, percent=10_000_000))["error"]
        assert error["code"] == Code.INVALID_PARAMS

    run(test)


def test_a_file_is_read_and_written_as_the_command_line_does() -> None:
    async def test(place: Place) -> None:
        project = (await called(place, "studio.file.read", text=TEXT))["result"]["project"]
        assert [one["action_id"] for one in project["actions"]] == [1, 2]
        text = (await called(place, "studio.file.write", project=project))["result"]["text"]
        assert text == ProjectFile(ProjectFile.parse(TEXT).project).text()

    run(test)


def test_a_file_keeps_its_figure() -> None:
    async def test(place: Place) -> None:
        figure = {"figure": 1, "name": "Arm", "view": {}, "joints": [{"id": "arm", "servo": 1}]}
        written = json.dumps({"schema": 1, "figure": figure})
        project = (await called(place, "studio.file.read", text=written))["result"]["project"]
        assert project["figure"] == figure
        text = (await called(place, "studio.file.write", project=project))["result"]["text"]
        assert json.loads(text)["figure"] == figure

    run(test)


def test_a_file_with_an_error_is_refused_with_its_place() -> None:
    async def test(place: Place) -> None:
        for text, place_of in (
            (TEXT.replace("40", "40.5"), "actions[0].steps[0].degree"),
            (TEXT.replace('"schema": 1', '"schema": 99'), "newer"),
            ("{", "line 1"),
            ("", "line 1"),
        ):
            error = (await called(place, "studio.file.read", text=text))["error"]
            assert error["data"]["kind"] == "ProjectError"
            assert place_of in error["message"]

    run(test)


def test_a_project_is_checked_before_it_is_written() -> None:
    async def test(place: Place) -> None:
        table = {"table_id": 1, "buttons": [{"button_id": 1, "button_press_macro": 7}]}
        project = {"schema": 1, "joystick_tables": [table], "active_joystick_table": 1}
        project["macros"] = [{"macro_id": 2**31 - 1, "commands": [{"type": "macro", "macro_id": 2**31 - 1}]}]
        found = (await called(place, "studio.check", project=project))["result"]["found"]
        assert [one["severity"] for one in found] == sorted(one["severity"] for one in found)
        assert any("macro 7" in one["text"] for one in found)
        assert (await called(place, "studio.check", project={"schema": 1}))["result"]["found"] == []

    run(test)


def test_who_may_only_watch_reads_no_backups_of_other_boards() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            for method, params in (("project.backups", {}), ("studio.backup", {"number": 1})):
                assert "needs the role edit" in (await call(page, method, **params))["error"]["message"]

    run(test)


def test_movements_are_checked_against_the_limits_of_the_board() -> None:
    poses = [Action(number, "", (Step(1, degree, 50),)) for number, degree in ((1, 0), (2, 150))]
    commands = [MacroCommand(number, 0, 100, 1, 500) for number in (1, 2)]
    project = Project(actions=tuple(poses), macros=(Macro(1, "Turn", tuple(commands)),))

    def texts(**limits: Any) -> list[str]:
        profile = ProfileInUse("rex", BoardProfile(limits=SafetyLimits(**limits)))
        return [one.text for one in findings(project, profile)]

    assert findings(project, None) == []
    assert texts(speed_cap=300.0) == []
    (text,) = texts(speed_cap=200.0)
    assert text.endswith('its cap is 200 (from profile "rex")')
    (too_far,) = texts(angles={1: (-90.0, 90.0)})
    assert 'its limits are -90..90 (from profile "rex")' in too_far


def test_a_backup_can_be_looked_at() -> None:
    async def test(place: Place) -> None:
        BackupStore().keep(ProjectFile.parse(TEXT).project, "virtual://", "utf-8")
        project = (await called(place, "studio.backup", number=1))["result"]["project"]
        assert [one["action_id"] for one in project["actions"]] == [1, 2]
        assert "no backup 2" in (await called(place, "studio.backup", number=2))["error"]["message"]

    run(test)
