"""Imports that were interrupted: how they are known, gone on with, and undone."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path

import pytest
from msgspec.structs import replace

from servolink.client import Board, connect
from servolink.errors import ConnectionLost, ProjectError, RequestTimeout
from servolink.project.model import UNFINISHED, Project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.journal import Journal
from servolink.project.transfer.results import Progress
from servolink.protocol import ACTION, Action, AddActionRequest
from servolink.virtual import VirtualTransport
from tests.client.piped_board import SWALLOWED, PipedBoard
from tests.plugged import plugged
from tests.project.boards import (
    HERE,
    OTHER,
    OTHER_CONTENTS,
    THERE,
    clearing,
    on_board,
    on_fake,
    stopped,
    stopped_import,
    unfinished,
    writing,
)
from tests.project.cable import Cable
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, Make, bytes_of_import, contents_of, same
from tests.virtual_time import run


def test_an_import_that_is_cancelled_at_any_moment_is_gone_on_with(tmp_path: Path) -> None:
    async def cancelled_after(turns: int, folder: Path) -> bool:
        """Return whether the import was cancelled, and not done before."""
        virtual = Make().board(OLD_CONTENTS, 1)
        async with connect(VirtualTransport(virtual)) as board:
            task = asyncio.ensure_future(board.apply_project(NEW, folder=folder))
            for _ in range(turns):
                await asyncio.sleep(0)
            if task.done():
                return False
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            unfinished = await board.has_unfinished_import()
            assert (await board.apply_project(NEW, folder=folder)).resumed == unfinished
        assert same(virtual.storage.contents, NEW_CONTENTS)
        return True

    turns = 0
    while run(cancelled_after(turns, tmp_path / str(turns))):
        turns += 3
    assert turns > 100


def test_an_import_of_another_project_takes_over_and_keeps_the_first_backup(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        await stopped_import(board, tmp_path, writing)
        applied = await board.apply_project(OTHER, folder=tmp_path)
        assert applied.resumed
        (backup,) = BackupStore(tmp_path).backups()
        assert applied.backup == backup.path
        assert await board.export_project() == OTHER
        await board.rollback_project(folder=tmp_path)

    assert same(on_board(work), OLD_CONTENTS)


def test_a_rollback_that_is_interrupted_goes_either_way(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        await stopped_import(board, tmp_path, writing)
        for _ in range(2):
            await stopped(lambda tell: board.rollback_project(folder=tmp_path, on_progress=tell), writing)
            assert await board.has_unfinished_import()
        await board.apply_project(NEW, folder=tmp_path)
        assert await board.export_project() == NEW
        await board.rollback_project(folder=tmp_path)
        assert len(BackupStore(tmp_path).journals(0)) == 1

    assert same(on_board(work), OLD_CONTENTS)


def test_an_import_of_differences_may_go_on_as_one_of_everything_and_back(
    tmp_path: Path,
) -> None:
    async def work(board: Board) -> None:
        await stopped_import(board, tmp_path, writing)
        await stopped_import(board, tmp_path, writing, replace=True)
        applied = await board.apply_project(NEW, folder=tmp_path)
        assert applied.resumed
        assert applied.backup == BackupStore(tmp_path).backups()[0].path

    assert same(on_board(work), NEW_CONTENTS)


def test_an_unfinished_import_without_a_journal_needs_a_backup_to_be_named(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match="begun by another computer, or with a lost journal"):
            await board.rollback_project(folder=tmp_path)
        backup = BackupStore(tmp_path).keep(OLD, "virtual://", "utf-8")
        await board.rollback_project(backup, folder=tmp_path)

    assert same(on_board(work, unfinished()), OLD_CONTENTS)


def test_an_unfinished_import_without_a_journal_can_be_finished_and_comes_back(
    tmp_path: Path,
) -> None:
    async def work(board: Board) -> None:
        assert (await board.plan_project(NEW)).is_unfinished
        assert not (await board.apply_project(NEW, folder=tmp_path)).resumed
        assert await board.export_project() == NEW
        await board.rollback_project(folder=tmp_path)
        assert await board.has_unfinished_import()

    assert same(on_board(work, unfinished()), unfinished())


@pytest.mark.parametrize("when", [writing, clearing])
@pytest.mark.parametrize("back", [True, False])
def test_a_board_is_known_by_its_marker_whatever_was_done_at_its_address_since(
    when: Callable[[Progress], bool], tmp_path: Path, *, back: bool
) -> None:
    """Class rooms: boards come and go at one port, all get the same project, and one comes back at another port."""
    first, second = (Make(clear="records").board(contents, 1) for contents in (OLD_CONTENTS, OTHER_CONTENTS))

    async def main() -> None:
        async with connect(VirtualTransport(first, HERE)) as board:
            await stopped_import(board, tmp_path, when, replace=True)
        async with connect(VirtualTransport(second, HERE)) as board:
            assert not (await board.apply_project(NEW, folder=tmp_path)).resumed
            await board.rollback_project(folder=tmp_path)
            assert await board.export_project() == OTHER
        async with connect(VirtualTransport(first, THERE)) as board:
            if back:
                await board.rollback_project(folder=tmp_path)
            else:
                assert (await board.apply_project(NEW, folder=tmp_path)).resumed

    run(main())
    assert same(first.storage.contents, OLD_CONTENTS if back else NEW_CONTENTS)


@pytest.mark.parametrize("whole", [False, True])
def test_a_board_that_comes_back_by_itself_is_the_one_with_the_marker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, *, whole: bool
) -> None:
    """It is known again by its project id, which an import changes: it must not be taken for another board."""
    virtual = Make(partial_writes=True, bus_powered=True).board(OLD_CONTENTS, 1)

    async def main() -> None:
        size, _ = await bytes_of_import(Make(), whole=whole, folder=tmp_path / "size")
        for sent in range(900, size, 400):
            virtual.storage.contents = OLD_CONTENTS
            cables = iter((Cable(virtual, sent=sent), Cable(virtual)))
            url = plugged(monkeypatch, lambda _: next(cables))  # noqa: B023 - used at once
            folder = tmp_path / str(sent)
            async with connect(url, reconnect=True) as board:
                with pytest.raises(ConnectionLost):
                    await board.apply_project(NEW, replace=whole, folder=folder)
                async for state in board.states():
                    if state == "connected":
                        break
                unfinished = await board.has_unfinished_import()
                assert (await board.apply_project(NEW, replace=whole, folder=folder)).resumed >= unfinished
            assert same(virtual.storage.contents, NEW_CONTENTS)

    run(main())
    assert not caplog.messages


async def test_connecting_to_a_board_that_comes_back_by_itself_tells_of_an_unfinished_import(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    virtual = Make().board(unfinished(), 1)
    url = plugged(monkeypatch, lambda url: VirtualTransport(virtual, url))
    async with connect(url, reconnect=True):
        assert [record.levelname for record in caplog.records] == ["WARNING"]


def test_imports_at_other_addresses_are_undone_as_if_there_were_none_here(tmp_path: Path) -> None:
    first, second = (Make().board(contents, 1) for contents in (OLD_CONTENTS, OTHER_CONTENTS))

    async def main() -> None:
        for virtual, url in ((first, HERE), (second, THERE)):
            async with connect(VirtualTransport(virtual, url)) as board:
                await board.apply_project(NEW, folder=tmp_path)
        for virtual, url in ((first, HERE), (second, THERE)):
            async with connect(VirtualTransport(virtual, url)) as board:
                await board.rollback_project(folder=tmp_path)

    run(main())
    assert same(first.storage.contents, OLD_CONTENTS)
    assert same(second.storage.contents, OTHER_CONTENTS)


def test_imports_of_the_same_project_by_two_computers_have_different_markers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a board that moves to the other computer would be rolled back to what another board held."""
    markers = {BackupStore(tmp_path).new_marker() for _ in range(8)}
    assert len(markers) > 1
    assert all(marker in UNFINISHED for marker in markers)
    drawn = iter((UNFINISHED[3], UNFINISHED[3], UNFINISHED[4]))
    monkeypatch.setattr("servolink.project.transfer.backups.choice", lambda _: next(drawn))
    store = BackupStore(tmp_path)
    store.write(Journal(store.new_marker(), HERE, 1, None))
    assert store.new_marker() == UNFINISHED[4]


def test_a_journal_that_cannot_be_read_stands_in_the_way_of_its_own_board_alone(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "imports").mkdir()
    (tmp_path / "imports" / f"{UNFINISHED.start + 7:08x}.json").write_text("{")

    async def refused(board: Board) -> None:
        for work in (board.apply_project(NEW, folder=tmp_path), board.rollback_project(folder=tmp_path)):
            with pytest.raises(ProjectError, match=r"7a000007\.json: the journal of an import cannot be read"):
                await work

    assert on_board(refused, unfinished()) == unfinished()
    assert same(on_board(lambda board: board.apply_project(NEW, folder=tmp_path)), NEW_CONTENTS)
    assert "7a000007.json" in caplog.text


def test_a_board_that_falls_silent_leaves_an_import_to_go_on_with(tmp_path: Path) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.plan(AddActionRequest, SWALLOWED)
        usual = fake.usual
        task = asyncio.ensure_future(board.apply_project(NEW, folder=tmp_path))
        while not fake.sent_of(AddActionRequest):
            await asyncio.sleep(0.001)
        fake.usual = SWALLOWED
        with pytest.raises((RequestTimeout, ConnectionError)):
            await task
        fake.usual = usual

    fake = on_fake(work)
    assert fake.storage.project_id in UNFINISHED
    left = on_board(lambda board: board.apply_project(NEW, folder=tmp_path), fake.storage.contents)
    assert same(left, NEW_CONTENTS)


def test_records_that_are_torn_and_doubled_are_put_right(tmp_path: Path) -> None:
    bow = OLD_CONTENTS.records[ACTION][0]
    torn = (
        *OLD_CONTENTS.records[ACTION],
        bow,
        (9, contents_of(Project(actions=(Action(9, "?"),))).records[ACTION][0][1]),
    )
    left = unfinished(replace(OLD_CONTENTS, records={**OLD_CONTENTS.records, ACTION: torn}))
    assert same(on_board(lambda board: board.apply_project(NEW, folder=tmp_path, backup=False), left), NEW_CONTENTS)


def test_python_is_told_of_an_unfinished_import_once(caplog: pytest.LogCaptureFixture) -> None:
    async def work(board: Board) -> None:
        with caplog.at_level(logging.WARNING):
            assert [await board.project_id() for _ in range(2)] == [UNFINISHED.start + 7] * 2

    on_board(work, unfinished())
    assert caplog.messages == [
        "virtual:// holds an unfinished import: apply the project again to finish it, or roll back to undo it"
    ]
    caplog.clear()
    on_board(work_that_asks, unfinished())
    on_board(lambda board: board.project_id())
    assert caplog.messages == []


async def work_that_asks(board: Board) -> None:
    """Ask whether there is one, and then for the number."""
    assert await board.has_unfinished_import()
    await board.project_id()
