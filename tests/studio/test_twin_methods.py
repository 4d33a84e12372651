"""The twin of a studio: runs are shown, records are judged in the background, and no board is touched.

Module: servolink.studio.studio_twin, servolink.studio.twin_methods, servolink.twin.jobs.
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from aiohttp import ClientWebSocketResponse

from servolink.project import Project, ProjectFile
from servolink.protocol import Action, Macro, MacroCommand, MacroCommandType, Step
from servolink.studio import studio_methods
from servolink.studio.studio_twin import Robot
from servolink.twin import FALLING, Body, Frame, Physics, RunningTrial, frame_of
from tests.studio.serving import Place, call, run, welcomed
from tests.studio.web_code import call_all, needs_node
from tests.twin.figures import lamp, template

pytestmark = pytest.mark.usefixtures("user")

MOST_BYTES = 30_000
"""Bytes in a second of a run."""
OVER = Action(1, "Over", (Step(1, 60, 60), Step(2, 30, 60)))
STILL = Action(2, "Still", (Step(1, 0, 50),))
READ = Macro(3, "Read", (MacroCommand(2), MacroCommand(1)))
ENDLESS = Macro(9, "Endless", (MacroCommand(9, MacroCommandType.MACRO.value),))


def robot(*records: Action | Macro) -> dict[str, Any]:
    """Return the params of a lamp with records."""
    actions = tuple(one for one in records if isinstance(one, Action))
    macros = tuple(one for one in records if isinstance(one, Macro))
    figure = lamp().to_json()
    figure["joints"][2]["mass"] = 1.5
    return {"project": ProjectFile(Project(actions=actions, macros=macros)).form(), "figure": figure}


ALL = robot(OVER, STILL, READ, ENDLESS)


async def reported(page: ClientWebSocketResponse, method: str, **params: Any) -> tuple[list[str], dict[str, Any]]:
    """Call a method, and return the texts of its progress and the response."""
    await page.send_json({"jsonrpc": "2.0", "id": 7, "method": method, "params": params})
    texts = list[str]()
    while "id" not in (message := json.loads(text := await page.receive_str())):
        if message["method"] == "progress":
            texts.append(text)
    return texts, message


async def angles(page: ClientWebSocketResponse) -> list[int]:
    """Return the angles of the servos of the board."""
    return [servo["angle"] for servo in (await call(page, "servos.list"))["result"]["servos"]]


def test_a_run_is_shown_until_the_fall_with_few_bytes_and_ends_when_told() -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            before = await angles(page)
            texts, answer = await reported(page, "studio.twin.try", **ALL, type="macro", id=3)
            fall = answer["result"]["fall"]
            assert fall["command"] == 2
            assert len(texts) * Frame.SECONDS == pytest.approx(fall["seconds"] + FALLING, abs=2 * Frame.SECONDS)
            assert sum(map(len, texts)) / (len(texts) * Frame.SECONDS) < MOST_BYTES / 2
            wrong = {"type": "action", "id": 7}, {"type": "action", "id": 1, "figure": {"figure": 1}}
            for params in (*wrong, {"type": "macro", "id": 9}):
                assert "error" in (await reported(page, "studio.twin.try", **ALL | params))[1]
            still = {
                "jsonrpc": "2.0",
                "id": 8,
                "method": "studio.twin.try",
                "params": {**ALL, "type": "action", "id": 2},
            }
            await page.send_json(still)
            frames = 0
            while "id" not in (message := json.loads(await page.receive_str())):
                frames += message.get("method") == "progress"
                if frames == 1:
                    await page.send_json({"jsonrpc": "2.0", "method": "studio.twin.stop"})
            assert message["result"] == {"fall": None}
            assert frames < STILL.seconds / Frame.SECONDS + 50, "of 125 frames"
            assert await angles(page) == before
            assert (await call(page, "status"))["result"]["lease"] is None

    run(test)


def test_verdicts_are_kept_until_a_record_or_the_figure_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    made = list[Any]()

    async def test(place: Place) -> None:
        twin = place.studio.twin
        judge = twin._judge

        async def counted(robot: Any, record: Any) -> Any:
            made.append(record)
            return await judge(robot, record)

        monkeypatch.setattr(twin, "_judge", counted)
        async with place.page() as page, place.page() as other:
            await welcomed(page, place.gate.new_token("watch"))
            await welcomed(other, place.gate.new_token("edit"))
            texts, answer = await reported(page, "studio.twin.verdicts", **ALL)
            found = {(one["type"], one["id"]): one["verdict"] for one in answer["result"]["verdicts"]}
            assert found == {("macro", 3): "falls", ("action", 1): "falls", ("action", 2): "stands"}
            assert len(texts) == 5
            assert made == [OVER, STILL, READ, ENDLESS]
            texts, again = await reported(other, "studio.twin.verdicts", **ALL)
            assert (len(texts), again["result"], made[4:]) == (1, answer["result"], [])
            gentle = Action(1, "Over", (Step(1, 5, 50),))
            _, answer = await reported(page, "studio.twin.verdicts", **robot(gentle, STILL, READ))
            assert {one["verdict"] for one in answer["result"]["verdicts"]} == {"stands"}
            assert made[4:] == [gentle, READ]
            figure = ALL["figure"] | {"body": {"bolted": True}}
            _, answer = await reported(page, "studio.twin.verdicts", **robot(OVER) | {"figure": figure})
            assert [one["verdict"] for one in answer["result"]["verdicts"]] == ["stands"]
            weightless = {"figure": 1, "name": "None", "view": {}, "joints": [{"id": "arm", "servo": 1}]}
            _, answer = await reported(page, "studio.twin.verdicts", **robot(OVER) | {"figure": weightless})
            assert "weighs nothing" in answer["error"]["message"]

    run(test)


def test_a_key_changes_with_all_that_a_macro_runs_and_thousands_are_made_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counted, by_type = list[Project](), Project.by_type

    def count(project: Project) -> Any:
        counted.append(project)
        return by_type(project)

    monkeypatch.setattr(Project, "by_type", count)
    chain = [Macro(at, "", (MacroCommand(at + 1, MacroCommandType.MACRO.value),)) for at in range(1, 2000)]
    circle = Macro(5000, "", (MacroCommand(5000, MacroCommandType.MACRO.value), MacroCommand(1)))

    def keys(last: Action) -> list[bytes]:
        macros = (*chain, Macro(2000, "", (MacroCommand(1),)), circle)
        robot = Robot.of(Project(actions=(last, STILL), macros=macros), lamp())
        records: list[Action | Macro] = [*macros, STILL]
        return [robot.key(record) for record in records]

    before, after = keys(OVER), keys(Action(1, "Over", (Step(1, 61, 60),)))
    assert len(counted) == 2
    assert len({*before, *after}) == 2 * 2000 + 2, "an endless macro, and an action, have the keys that they had"
    assert after[-2:] == before[-2:]


def test_a_hand_that_is_pulled_takes_the_arm_along_and_says_how_far_it_stays_away() -> None:
    figure = template("humanoid-16").to_json()

    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            params = {"figure": figure, "joint": "l_elbow", "start": {"4": 5}}
            near = (await call(page, "studio.twin.reach", **params, move=[30, 20, 40]))["result"]
            assert near["missed_mm"] == 0
            assert {"4", "5", "6"} <= near["angles"].keys()
            far = (await call(page, "studio.twin.reach", **params, move=[0, 0, 1000]))["result"]
            assert far["missed_mm"] > 500
            for wrong in ({"joint": "none"}, {"move": [0, 0, "x"]}, {"move": [1e9, 0, 0]}, {"start": {"1": None}}):
                assert "error" in await call(page, "studio.twin.reach", **{"move": [0, 0, 0], **params, **wrong})

    run(test)


def test_the_page_hears_whether_there_are_physics(monkeypatch: pytest.MonkeyPatch) -> None:
    async def test(place: Place) -> None:
        async with place.page() as page:
            await welcomed(page, place.gate.new_token("watch"))
            assert (await call(page, "studio.about"))["result"]["has_twin"] is True
            monkeypatch.setattr(studio_methods, "is_installed", lambda: False)
            assert (await call(page, "studio.about"))["result"]["has_twin"] is False

    run(test)


@needs_node
def test_the_page_draws_each_part_where_the_physics_have_it() -> None:
    """The robot has turned in all directions, falling over one foot."""
    figure = template("humanoid-16")
    stumble = Action(1, "Stumble", (Step(8, 60, 20), Step(9, 40, 20), Step(2, 90, 20), Step(14, 30, 20)))
    trial = RunningTrial(Physics(Body.of(figure)), Project(actions=(stumble,)), stumble)
    while trial.fall is None:
        trial.advance()
    frame, data = frame_of(figure, trial.physics), trial.physics.data
    ids = sorted(trial.physics.servo_ids)
    body = {"pose": dict(zip(map(str, ids), frame.angles, strict=True)), "move": frame.at, "turn": frame.turn}
    (drawn,) = call_all([("../../../tests/studio/web_figure.js", "placesOf", ["humanoid-16", body])])
    names = [joint.id for joint in figure.joints]
    places = {name: trial.physics.data.body(name).xpos for name in names}
    above = [1000 * data.body(names[0]).xpos[2] - drawn[0][1]] * 3
    for name, (x, y, z) in zip(names, drawn, strict=True):
        ahead, left, up = 1000 * places[name]
        assert (x, y + above[0], z) == pytest.approx((left, up, ahead), abs=1), name
    assert abs(above[0]) < 3, "the floor of the figure is that of the body"
