"""What `plan` and `apply` say of boards that protect an import less, or seem too small for it."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.project import Project, save_project
from servolink.protocol import Action, Step
from tests.cli.programs import call

LARGE = Project(8, actions=tuple(Action(at, "Bow", (Step(1, 0, 1),) * 10) for at in range(1, 4)))


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A project, and a folder for backups."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    save_project(tmp_path / "robot.servolink.json", LARGE)
    return str(tmp_path / "robot.servolink.json")


@pytest.mark.parametrize(
    ("bits", "said"),
    [
        (32, None),
        (
            16,
            "this board keeps 16 bits of a project id, so an interrupted import is recognised only from this",
        ),
        (0, "this board keeps no project id, so an interrupted import is recognised only from this"),
    ],
)
def test_apply_says_how_much_protects_an_import(
    bits: int, said: str | None, file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    url = f"virtual://?project_id_bits={bits}"
    applied = call(capsys, "--url", url, "apply", "--yes", file)
    assert applied.code == 0
    assert ("this board keeps" in applied.out) == (said is not None)
    assert said is None or said in " ".join(applied.out.split())
    assert call(capsys, "--url", url, "--json", "apply", "--yes", file).json["project_id_bits"] == bits


def test_a_project_that_seems_too_large_is_a_warning_before_it_is_refused_by_the_board(
    file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    url = "virtual://?memory=100"
    planned = call(capsys, "--url", url, "plan", file)
    assert planned.code == 1
    assert "100 of 100, in a unit not learnt so far: the project may not fit" in planned.out
    assert "264 bytes more than the present content; the board has 100 bytes free" in planned.err
    assert "assuming memory figures in bytes; `servolink apply` tries it, and nothing is lost by that" in planned.err
    applied = call(capsys, "--url", url, "apply", "--yes", file)
    assert applied.code == 1
    assert "perhaps because its memory is full" in applied.err
    memory = call(capsys, "--url", url, "--json", "plan", file).json["memory"]
    assert memory["free_after_bytes"] == -164
    assert memory["unit_bytes"] is None


def test_a_board_that_does_not_say_how_much_memory_it_has_is_planned_for(
    file: str, capsys: pytest.CaptureFixture[str]
) -> None:
    url = "virtual://?unsupported=QueryMemorySize"
    assert "unknown, the board does not say" in call(capsys, "--url", url, "plan", file).out
    assert call(capsys, "--url", url, "--json", "plan", file).json["memory"] is None
