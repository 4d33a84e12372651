"""What `apply` and `rollback` say when they end in the middle.

Modules: servolink.cli.projects.apply, servolink.cli.projects.export.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from servolink.client import Board
from servolink.errors import ConnectionLost
from servolink.project import ApplyResult, Progress, Project, save_project
from servolink.protocol import Action
from tests.cli.programs import Said, call

BOTH = "nothing is lost: the same command finishes it"


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A project, and a folder for backups."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    path = tmp_path / "robot.servolink.json"
    save_project(path, Project(8, actions=(Action(1, "Bow", ()),)))
    return str(path)


def lost_at(progress: Progress, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let imports be lost at this moment."""

    async def lost(*_: object, on_progress: Any, **__: object) -> ApplyResult:
        on_progress(moment)
        raise ConnectionLost("gone")

    moment = progress
    for name in ("apply", "rollback"):
        monkeypatch.setattr(Board, f"{name}_project", lost)


def said_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> Said:
    """Run a command on a virtual board."""
    return call(capsys, "--url", "virtual://", *arguments)


@pytest.mark.parametrize(
    ("progress", "arguments", "said"),
    [
        (Progress("reading", 1, 2, "action 1"), ["apply"], "nothing was changed on the board"),
        (Progress("saving", 1, 2, "backup"), ["apply"], "nothing was changed on the board"),
        (
            Progress("marking", 0, 1, "project id 5"),
            ["apply"],
            (
                "the board may say that it holds an unfinished import, but nothing else was changed, stopped while "
                "marking the import on the board, at project id 5 (0 of 1); "
                f"{BOTH}, `servolink rollback` undoes it"
            ),
        ),
        (
            Progress("writing", 3, 9, "action 1"),
            ["apply"],
            (
                "the board holds an unfinished import, stopped while writing, at action 1 (3 of 9); "
                f"{BOTH}, `servolink rollback` undoes it"
            ),
        ),
        (
            Progress("writing", 3, 9, "action 1"),
            ["apply", "--no-backup"],
            (
                "the board holds an unfinished import, stopped while writing, at action 1 (3 of 9); "
                "the same command finishes it; without a backup nothing can undo it"
            ),
        ),
        (
            Progress("finishing", 0, 1, "project id 8"),
            ["rollback"],
            (
                "everything is written, but the board may still say that the import is unfinished, stopped while "
                f"finishing, at project id 8 (0 of 1); {BOTH}"
            ),
        ),
    ],
    ids=lambda value: value.phase if isinstance(value, Progress) else None,
)
def test_an_import_that_is_lost_says_what_is_left_and_what_to_do(
    progress: Progress,
    arguments: list[str],
    said: str,
    file: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lost_at(progress, monkeypatch)
    ended = said_of(capsys, *arguments, "--yes", file)
    assert ended.code == 3
    assert ended.err.splitlines()[-2:] == [f"servolink: {said}", "servolink: gone"]


@pytest.mark.parametrize(("command", "resumed"), [("apply", False), ("apply", True), ("rollback", True)])
def test_what_was_there_before_is_named_where_it_can_come_back(
    command: str, file: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *, resumed: bool
) -> None:
    async def done(*_: object, **__: object) -> ApplyResult:
        return ApplyResult(changed=True, resumed=resumed, backup=Path("kept"))

    monkeypatch.setattr(Board, f"{command}_project", done)
    said = said_of(capsys, command, "--yes", file).out.splitlines()[-1]
    before = "before the unfinished import" if resumed else "before"
    text = f"the content {before} is saved in kept; `servolink rollback` restores it"
    assert (said == text) == (command == "apply")


def test_an_export_into_no_folder_is_refused_before_the_board_is_read(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    said = said_of(capsys, "export", str(tmp_path / "no" / "robot.servolink.json"))
    assert said.code == 1
    assert said.err == (
        f"servolink: {tmp_path / 'no' / 'robot.servolink.json'}: the folder does not exist; "
        "create it first, or choose another name\n"
    )
