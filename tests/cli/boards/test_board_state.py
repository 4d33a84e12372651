"""`servolink board project-id`, `mode`, `memory`, `battery`, `clear` and `dummy`."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.project import UNFINISHED, BackupStore, Project
from servolink.protocol import Action, ServoParameter, Step
from servolink.virtual import BoardKind, VirtualBoard
from tests.cli.robot import Robot

STORED = Project(77, (ServoParameter(2, 7, "knee"),), (Action(1, "Bow", (Step(1, 30, 50),)),))


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))


def test_the_project_id_is_shown_and_written(robot: Robot) -> None:
    assert robot("board", "project-id").out == "project id none\n"
    assert robot("board", "project-id", "7").out == "project id 7\n"
    assert robot("board", "project-id", "--json").json == {"project_id": 7, "has_unfinished_import": False}


def test_ids_that_mark_an_unfinished_import_are_neither_written_nor_overwritten(robot: Robot) -> None:
    said = robot("board", "project-id", str(UNFINISHED[5]))
    assert (said.code, said.out) == (1, "")
    assert said.err == (
        "servolink: project id 2046820357 is reserved: 2046820352 to 2047868927 mean that an import is unfinished; "
        "nothing was changed on the board\n"
    )
    robot.ask(lambda board: board.write_project_id(UNFINISHED[5]))
    said = robot("board", "project-id", "7")
    assert said.code == 1
    assert "another project id would hide it" in said.err
    assert robot("board", "project-id").out == "project id none: an import is unfinished\n"


def test_memory_and_battery(robot: Robot) -> None:
    assert robot("board", "memory").out == "memory 65,536 free of 65,536, in a unit not learnt so far\n"
    assert robot("board", "memory", "--json").json == {"size_bytes": 65536, "total_size_bytes": 65536}
    percent = robot("board", "battery", "--json").json["battery_percent"]
    assert 0 < percent <= 100
    assert robot("board", "battery").out.endswith(" %\n")


def test_modes(robot: Robot) -> None:
    assert robot("board", "mode", "0").out == "the board is in transmission mode 0\n"
    assert robot("board", "mode", "1", "--json").json == {"transmission_mode": 1}
    assert robot("board", "mode", "2").code == 2
    assert robot("servos").code == 0


@pytest.mark.parametrize("clear", ["all", "records"])
def test_a_board_is_cleared_after_a_backup(clear: str, robot: Robot) -> None:
    robot.board = VirtualBoard(3, kind=BoardKind(clear=clear))  # type: ignore[arg-type]
    robot.ask(lambda board: board.apply_project(STORED, backup=False))
    refused = robot("board", "clear")
    assert refused.code == 2
    assert "--yes continues without asking" in refused.err
    said = robot("board", "clear", "--yes")
    assert (said.code, said.err) == (0, "")
    assert "- action 1 'Bow'" in said.out
    assert robot.ask(lambda board: board.export_project()).sorted() == Project()
    [backup] = BackupStore().backups()
    assert BackupStore().load(backup.path) == STORED
    assert "nothing to change" in robot("board", "clear", "--yes").out
    assert robot("rollback", "--yes").code == 0
    assert robot.ask(lambda board: board.export_project()) == STORED


def test_a_board_is_cleared_without_a_backup_if_told_so(robot: Robot) -> None:
    robot.ask(lambda board: board.apply_project(STORED, backup=False))
    assert robot("board", "clear", "--yes", "--no-backup", "--json").json["backup"] is None
    assert not BackupStore().backups()


def test_dummy_data(robot: Robot) -> None:
    assert robot("board", "dummy").out == "16 bytes sent; the board ignored them\n"
    assert robot("board", "dummy", "00 ff", "--json").json == {"bytes": 2}
    assert "HEX must be hex digits in pairs" in robot("board", "dummy", "0").err
    assert robot("board", "dummy", "00" * 65536).code == 1
