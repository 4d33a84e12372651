"""Rollbacks: of which import, and of none."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest

from servolink.client import Board
from servolink.errors import ConnectionLost, ProjectError, TransportError
from servolink.project.project_file import load_project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.results import Progress
from servolink.protocol import Macro, QueryActionRequest, QueryActionResponse
from tests.client.piped_board import PipedBoard, lie
from tests.project.boards import OTHER, OTHER_CONTENTS, on_board, on_fake
from tests.project.cable import Cable
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, Make, attempt, contents_of, same
from tests.sampling import some


def test_a_rollback_of_a_finished_import_restores_what_was_there_even_what_we_would_not_write(tmp_path: Path) -> None:
    odd = msgspec.structs.replace(OLD, macros=(Macro(3, "clear\x1b[2J", ()),))

    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match="control"):
            await board.apply_project(odd, folder=tmp_path)
        await board.apply_project(NEW, folder=tmp_path)
        await board.rollback_project(folder=tmp_path)
        assert (await board.export_project()).macros == odd.macros
        await board.rollback_project(folder=tmp_path)  # what was there before the rollback
        assert await board.export_project() == NEW

    assert same(on_board(work, contents_of(odd)), NEW_CONTENTS)


def test_no_backup_must_be_asked_for_where_none_can_be_made(tmp_path: Path) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.plan(QueryActionRequest, *[lie(QueryActionResponse(0))] * 2)
        with pytest.raises(
            ProjectError, match=r"no backup of fake://board can be made: action 1: the board lists the record"
        ):
            await board.apply_project(NEW, folder=tmp_path)
        fake.plan(QueryActionRequest, *[lie(QueryActionResponse(0))] * 2)
        assert (await board.apply_project(NEW, folder=tmp_path, backup=False)).backup is None
        with pytest.raises(ProjectError, match="the last import to fake://board was made without a backup"):
            await board.rollback_project(folder=tmp_path)

    assert same(on_fake(work).storage.contents, NEW_CONTENTS)


@pytest.mark.parametrize("phase", ["reading", "saving"])
def test_an_import_that_ends_before_its_backup_leaves_nothing_to_undo(phase: str, tmp_path: Path) -> None:
    def lost(progress: Progress) -> None:
        if progress.phase == phase:
            raise ConnectionLost("gone")

    async def work(board: Board) -> None:
        await board.apply_project(NEW, folder=tmp_path)
        with pytest.raises(ConnectionLost):
            await board.apply_project(OTHER, folder=tmp_path, on_progress=lost)
        with pytest.raises(ProjectError, match="ended before its backup was made"):
            await board.rollback_project(folder=tmp_path)
        assert await board.export_project() == NEW
        assert (await board.apply_project(OTHER, folder=tmp_path)).changed
        await board.rollback_project(folder=tmp_path)

    assert same(on_board(work, OLD_CONTENTS), NEW_CONTENTS)


def lost_before_marking(progress: Progress) -> None:
    """Lose the board just before it is changed."""
    if progress.phase == "marking":
        raise ConnectionLost("gone")


def test_a_rollback_undoes_the_last_import_alone(tmp_path: Path) -> None:
    """Not an older one where the last was made without a backup, or was not begun."""

    async def work(board: Board) -> None:
        await board.apply_project(OTHER, folder=tmp_path)
        await board.apply_project(NEW, folder=tmp_path, backup=False)
        with pytest.raises(ProjectError, match=r"the last import to virtual:// was made without a backup"):
            await board.rollback_project(folder=tmp_path)
        await board.apply_project(OTHER, folder=tmp_path)
        with pytest.raises(ConnectionLost):
            await board.apply_project(NEW, folder=tmp_path, on_progress=lost_before_marking)
        assert not await board.has_unfinished_import()
        with pytest.raises(ProjectError, match=r"no import from this computer gave .* nothing to undo"):
            await board.rollback_project(folder=tmp_path)

    assert same(on_board(work), OTHER_CONTENTS)


def test_a_rollback_leaves_a_board_alone_that_the_last_import_there_did_not_leave_so(tmp_path: Path) -> None:
    on_board(lambda board: board.apply_project(NEW, folder=tmp_path))

    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match=r"no import from this computer gave virtual:// the project id 5"):
            await board.rollback_project(folder=tmp_path)

    assert on_board(work, OTHER_CONTENTS) == OTHER_CONTENTS


def test_a_rollback_is_of_the_last_import_though_the_clock_was_put_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hours = iter((12, 11, 10))
    made = BackupStore.__init__.__defaults__
    assert made is not None
    monkeypatch.setattr(
        BackupStore.__init__, "__defaults__", (*made[:-1], lambda: datetime(2026, 1, 1, next(hours), tzinfo=UTC))
    )

    async def work(board: Board) -> None:
        await board.apply_project(OTHER, folder=tmp_path)
        await board.apply_project(NEW, folder=tmp_path)
        await board.rollback_project(folder=tmp_path)
        assert [load_project(backup.path, unchecked=True) for backup in BackupStore(tmp_path).backups()] == [
            OLD,
            OTHER,
            NEW,
        ]

    assert same(on_board(work), OTHER_CONTENTS)


async def test_a_rollback_that_is_pulled_anywhere_and_asked_for_again_goes_on(tmp_path: Path) -> None:
    """Asked for again once it is done, it undoes itself; so it must be known whether it was."""
    kept, folder = tmp_path / "kept", tmp_path / "again"
    virtual = Make().board(OLD_CONTENTS, 1)

    async def pulled(received: int | None) -> Cable:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(kept, folder)
        virtual.storage.contents = NEW_CONTENTS
        cable = Cable(virtual, received=received)
        error = await attempt(cable, lambda board: board.rollback_project(folder=folder))
        assert isinstance(error, TransportError) == (received is not None)
        return cable

    assert await attempt(Cable(virtual), lambda board: board.apply_project(NEW, folder=kept)) is None
    size = (await pulled(None)).received
    for received in (*range(1, size - 50, 331), *some(size - 50, size, 5)):
        await pulled(received)
        assert await attempt(Cable(virtual), lambda board: board.rollback_project(folder=folder)) is None
        assert same(virtual.storage.contents, OLD_CONTENTS), received
    assert await attempt(Cable(virtual), lambda board: board.rollback_project(folder=folder)) is None
    assert same(virtual.storage.contents, NEW_CONTENTS)


def test_without_anything_to_roll_back_it_says_so(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        with pytest.raises(
            ProjectError, match=r"give `rollback` a backup from `servolink backups`, or apply a project"
        ):
            await board.rollback_project(folder=tmp_path)
        with pytest.raises(ProjectError, match="nowhere: cannot be read"):
            await board.rollback_project(tmp_path / "nowhere", folder=tmp_path)

    assert on_board(work) == OLD_CONTENTS
