"""Boards that delete their project id with all data, and with it the marker of the import."""

from __future__ import annotations

import logging
from pathlib import Path

import msgspec
import pytest

from servolink.client import connect
from servolink.project.model import Project
from servolink.project.transfer.backups import BackupStore
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.project.boards import (
    HERE,
    OTHER,
    OTHER_CONTENTS,
    THERE,
    cleared,
)
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, Make, contents_of, same
from tests.virtual_time import run


@pytest.mark.parametrize("back", [True, False])
def test_a_board_that_lost_its_marker_when_cleared_is_known_by_its_address(tmp_path: Path, *, back: bool) -> None:
    virtual = Make().board(OLD_CONTENTS, 1)

    async def main() -> None:
        await cleared(virtual, tmp_path)
        async with connect(VirtualTransport(virtual, HERE)) as board:
            if back:
                await board.rollback_project(folder=tmp_path)
            else:
                applied = await board.apply_project(NEW, folder=tmp_path)
                assert applied.resumed
                assert applied.backup == BackupStore(tmp_path).backups()[0].path
            assert len(BackupStore(tmp_path).backups()) == 1

    run(main())
    assert same(virtual.storage.contents, OLD_CONTENTS if back else NEW_CONTENTS)


@pytest.mark.parametrize("left", [OLD, Project(servo_parameters=OLD.servo_parameters)], ids=["all", "parameters"])
async def test_what_is_on_a_board_that_only_looks_cleared_is_kept(
    left: Project, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    virtual = Make().board(OLD_CONTENTS, 1)
    left = msgspec.structs.replace(left, project_id=0)
    await cleared(virtual, tmp_path)
    virtual.storage.contents = contents_of(left)
    async with connect(VirtualTransport(virtual, HERE)) as board:
        with caplog.at_level(logging.WARNING):
            assert (await board.apply_project(NEW, folder=tmp_path)).resumed
        assert [BackupStore(tmp_path).backups()[1].path.name in line for line in caplog.messages] == [True]
        await board.rollback_project(BackupStore(tmp_path).backups()[1].path, folder=tmp_path)
        assert (await board.export_project()) == left


async def test_a_board_without_project_id_is_not_taken_for_one_that_was_cleared_elsewhere_or_before_another(
    tmp_path: Path,
) -> None:
    await cleared(Make().board(OLD_CONTENTS, 1), tmp_path)
    async with connect(VirtualTransport(VirtualBoard(3), THERE)) as board:
        assert not (await board.apply_project(NEW, folder=tmp_path)).resumed
    async with connect(VirtualTransport(Make().board(OTHER_CONTENTS, 1), HERE)) as board:
        await board.apply_project(NEW, folder=tmp_path)
    async with connect(VirtualTransport(VirtualBoard(3), HERE)) as board:
        assert not (await board.apply_project(NEW, folder=tmp_path)).resumed
        await board.rollback_project(folder=tmp_path)
        assert await board.export_project() == Project()


async def test_nothing_is_kept_of_a_board_that_only_looks_cleared_where_no_backup_is_wanted(tmp_path: Path) -> None:
    virtual = Make().board(OLD_CONTENTS, 1)
    await cleared(virtual, tmp_path)
    virtual.storage.contents = contents_of(msgspec.structs.replace(OTHER, project_id=0))
    async with connect(VirtualTransport(virtual, HERE)) as board:
        applied = await board.apply_project(NEW, folder=tmp_path, backup=False)
    (backup,) = BackupStore(tmp_path).backups()
    assert applied.backup == backup.path
