"""Records and projects through the control interface of a hub.

Module: servolink.hub.methods.stored.
"""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from servolink.project import ProjectFile
from servolink.virtual import BoardKind
from tests.hub.control_program import RpcFailed, shared

POSE: dict[str, Any] = {
    "action_id": 0,
    "action_caption": "Wave",
    "steps": [{"servo_id": 1, "degree": 30, "interval_ms": 500}],
}
DANCE: dict[str, Any] = {
    "macro_id": 7,
    "macro_caption": "Dance",
    "commands": [{"type": "action", "action_id": 1, "ratio_percent": 100, "loop": 2, "total_interval_ms": 0}],
}


@pytest.fixture(autouse=True)
def _backups_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


async def test_records_are_stored_listed_run_and_deleted() -> None:
    async with shared() as here, here.program() as studio:
        stored = await studio.call("records.put", type="action", record=POSE)
        assert (stored["type"], stored["id"], stored["changed"]) == ("action", 1, True)
        assert Path(stored["backup"]).is_file()
        await studio.call("records.put", type="macro", record=DANCE)
        stored = await studio.call("records.get", type="macro", id=7)
        assert stored["record"]["commands"][0]["total_interval_ms"] == 1000
        renamed = {**POSE, "action_id": 1, "action_caption": "Hello"}
        await studio.call("records.put", type="action", record=renamed)
        assert (await studio.call("records.list"))["records"] == [
            {"type": "action", "id": 1, "caption": "Hello"},
            {"type": "macro", "id": 7, "caption": "Dance"},
        ]
        assert (await studio.call("records.list", type="joystick_table"))["records"] == []
        assert await studio.call("records.get", type="action", id="hello") == {"type": "action", "record": renamed}
        assert await studio.call("run", type="action", id="Hello", wait=True) == {"seconds": 0.5}
        assert (await here.states())[0].angle == 30
        assert await studio.call("run", type="macro", id=7, wait=True) == {"seconds": None}
        with pytest.raises(RpcFailed, match="macro 7") as failed:
            await studio.call("records.delete", type="action", id=1)
        assert failed.value.kind == "ProjectError"
        await studio.call("records.delete", type="macro", id="Dance")
        assert (await studio.call("records.delete", type="action", id=1))["changed"]
        with pytest.raises(RpcFailed) as failed:
            await studio.call("records.get", type="action", id=1)
        assert failed.value.kind == "NotFound"
        assert [one["number"] for one in (await studio.call("project.backups"))["backups"]] == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("params", "text"),
    [
        ({"type": "pose", "record": POSE}, "type: must be one of action, macro, joystick_table, not 'pose'"),
        ({"record": POSE}, '"type" is missing'),
        ({"type": "action", "record": DANCE}, "record: 'macro_id' is not a field"),
        ({"type": "action", "record": {**POSE, "steps": [{}]}}, "record.steps[0]: 'servo_id'"),
        ({"type": "action", "record": {**POSE, "action_caption": "x" * 33}}, "caption"),
        ({"type": "macro", "record": {**DANCE, "commands": [{"type": "fly"}]}}, "record.commands[0].type"),
        ({"type": "macro", "record": DANCE}, "action 1"),
    ],
)
async def test_what_cannot_be_stored_is_refused_with_the_place(params: Any, text: str) -> None:
    async with shared() as here, here.program() as studio:
        with pytest.raises(RpcFailed) as failed:
            await studio.call("records.put", **params)
        assert text in str(failed.value)
        assert (await studio.call("records.list"))["records"] == []
        assert here.hub.exclusive_use is None


async def test_a_project_is_planned_applied_exported_and_rolled_back() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("page") as page:
        await page.call("status")
        project = {"schema": 1, "project_id": 5, "actions": [{**POSE, "action_id": 3}]}
        plan = await studio.call("project.plan", project=project)
        assert [change["what"] for change in plan["changes"]] == ["project id", "action 3"]
        assert plan["changes"][1]["new"]["action_caption"] == "Wave"
        request = studio.begin("project.apply", project=project)
        applied = await request
        assert applied["changed"]
        phases = [progress["phase"] for progress in studio.of("progress")]
        assert {"reading", "saving", "writing", "verifying"} <= set(phases)
        held = [change["hold"] and change["hold"]["reason"] for change in page.of("hold")]
        assert held == ["a project is being compared", None, "a project is being written", None]
        exported = (await studio.call("project.export"))["project"]
        assert ProjectFile.parse(json.dumps(exported)).project.actions[0].action_id == 3
        assert not (await studio.call("project.plan", project=exported))["changes"]
        await studio.call("project.rollback")
        assert (await studio.call("records.list"))["records"] == []
        await studio.call("project.rollback", backup=2)
        assert len((await studio.call("records.list"))["records"]) == 1
        assert "share" not in (await studio.call("project.backups"))["backups"][0]["board"]
        await here.hub.board.rollback_project()  # the same address: an import is undone through a hub or without
        assert not (await studio.call("records.list"))["records"]
        with pytest.raises(RpcFailed, match="there is no backup 99"):
            await studio.call("project.rollback", backup=99)


@pytest.mark.parametrize(
    ("project", "text"),
    [
        ({}, "schema"),
        ({"schema": 2}, "schema"),
        ({"schema": 1, "actions": [{}]}, "project.actions[0]"),
        ([], "project: must be an object"),
    ],
)
async def test_a_project_that_cannot_be_read_is_refused_with_the_place(project: Any, text: str) -> None:
    async with shared() as here, here.program() as studio:
        for method in ("project.plan", "project.apply"):
            with pytest.raises(RpcFailed) as failed:
                await studio.call(method, project=project)
            assert text in str(failed.value)


async def test_the_end_of_a_program_in_an_import_frees_the_board() -> None:
    slow = BoardKind(write_seconds=0.1)
    async with shared(kind=slow) as here, here.program("page") as page:
        actions = [{**POSE, "action_id": number} for number in range(1, 20)]
        project = {"schema": 1, "project_id": 5, "actions": actions}
        async with here.program("studio") as studio:
            studio.begin("project.apply", project=project)
            while not any(progress["phase"] == "writing" for progress in studio.of("progress")):
                await asyncio.sleep(0.01)
            assert (await page.call("status"))["hold"]["who"] == "studio"
        assert (await page.call("status"))["hold"] is None
        with pytest.raises(RpcFailed, match="unfinished import"):
            await page.call("records.put", type="action", record=POSE)
        half = (await page.call("project.export"))["project"]
        assert half["project_id"] == 5  # not that of the interrupted import, which no board may be given
        assert 0 < len(half["actions"]) < len(actions)
        assert (await page.call("project.apply", project=project))["resumed"]
        assert len((await page.call("records.list"))["records"]) == 19


async def test_a_program_that_has_the_board_alone_already_keeps_it() -> None:
    async with shared() as here, here.program("studio") as studio:
        await studio.call("board.hold", reason="a long change")
        await studio.call("project.apply", project={"schema": 1, "project_id": 5})
        assert here.hub.exclusive_use is not None
        assert here.hub.exclusive_use.reason == "a long change"


async def test_a_watcher_changes_nothing() -> None:
    async with shared() as here, here.program("page", "watch") as page:
        for method, params in (
            ("records.put", {"type": "action", "record": POSE}),
            ("records.delete", {"type": "action", "id": 1}),
            ("project.apply", {"project": {"schema": 1}}),
            ("project.rollback", {}),
            ("board.hold", {}),
            ("run", {"type": "action", "id": 1}),
        ):
            with pytest.raises(RpcFailed) as failed:
                await page.call(method, **params)
            assert failed.value.kind == "forbidden"
        await page.call("project.export")
