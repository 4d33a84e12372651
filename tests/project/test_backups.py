"""A backup is restored as it was made, or not at all."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest

from servolink.client import Board, connect
from servolink.errors import ProjectError
from servolink.project.model import Project
from servolink.project.transfer.backups import BackupStore
from servolink.protocol import Action, Step
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.project.boards import on_board, stopped, stopped_import, writing
from tests.project.pulled import NEW

HANDS = Project(5, actions=(Action(1, "\u5de6\u624b", (Step(1, 10, 50),)),))
"""A caption that is other bytes in each encoding, and in some of them none at all."""


async def goes_on_in_big5(talk: Callable[..., Awaitable[None]], folder: Path) -> None:
    await talk("utf-8", lambda board: stopped_import(board, folder, writing))
    await talk("big5", lambda board: board.apply_project(NEW, folder=folder))


async def is_rolled_back_in_big5_after_that_was_interrupted(talk: Callable[..., Awaitable[None]], folder: Path) -> None:
    await talk("utf-8", lambda board: board.apply_project(NEW, folder=folder))
    await talk(
        "utf-8", lambda board: stopped(lambda tell: board.rollback_project(folder=folder, on_progress=tell), writing)
    )


async def is_named(talk: Callable[..., Awaitable[None]], folder: Path) -> None:
    await talk("UTF8", lambda board: board.apply_project(NEW, folder=folder))


@pytest.mark.parametrize("before", [goes_on_in_big5, is_rolled_back_in_big5_after_that_was_interrupted, is_named])
async def test_a_backup_is_restored_only_in_the_encoding_in_which_it_was_read(
    before: Callable[[Callable[..., Awaitable[None]], Path], Awaitable[None]], tmp_path: Path
) -> None:
    virtual, store = VirtualBoard(), BackupStore(tmp_path)

    async def talk(encoding: str, work: Callable[[Board], Awaitable[object]]) -> None:
        async with connect(VirtualTransport(virtual), caption_encoding=encoding) as board:
            await work(board)

    async def refused(board: Board) -> None:
        held, first = virtual.storage.contents, store.backups()[1]
        for backup in (None, first.path):
            with pytest.raises(ProjectError, match=r"was read with captions in utf_8; connect with the same"):
                await board.rollback_project(backup, folder=tmp_path)
        assert virtual.storage.contents == held

    await talk("utf-8", lambda board: board.apply_project(HANDS, folder=tmp_path))
    await before(talk, tmp_path)
    await talk("big5", refused)
    await talk("utf_8", lambda board: board.rollback_project(folder=tmp_path))
    async with connect(VirtualTransport(virtual)) as board:
        assert await board.export_project() == HANDS


def test_a_copy_of_a_backup_is_a_project_like_any_other(tmp_path: Path) -> None:
    kept = BackupStore(tmp_path / "kept").keep(HANDS, "virtual://", "utf-8")
    (copy := tmp_path / "copy").write_bytes(kept.read_bytes())

    async def work(board: Board) -> None:
        await board.rollback_project(copy, folder=tmp_path / "kept")
        assert await board.export_project() == HANDS

    on_board(work, caption_encoding="big5")


def test_a_backup_that_was_changed_is_not_restored(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        backup = (await board.apply_project(NEW, folder=tmp_path)).backup
        assert backup
        text = backup.read_text(encoding="utf-8")
        backup.write_text(text.replace('"degree": 60,', '"degree": 90,'), encoding="utf-8")
        assert backup.read_text(encoding="utf-8") != text
        with pytest.raises(ProjectError, match="was changed after the backup; to restore the changed content, copy"):
            await board.rollback_project(folder=tmp_path)
        assert await board.export_project() == NEW

    on_board(work)


def test_an_import_that_goes_on_names_no_backup_that_is_gone(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def work(board: Board) -> None:
        await stopped_import(board, tmp_path, writing)
        for backup in BackupStore(tmp_path).backups():
            backup.path.unlink()
        applied = await board.apply_project(NEW, folder=tmp_path)
        assert applied.resumed
        assert applied.backup is None
        with pytest.raises(ProjectError, match="the last import to virtual:// was made without a backup"):
            await board.rollback_project(folder=tmp_path)

    on_board(work)
    assert any("the backup of the continued import is missing: " in message for message in caplog.messages)
