"""Imports to boards that keep 16 bits of a project id, or none: less shows whose import it is, and nothing is lost.

Modules: servolink.project.transfer.journal, servolink.project.transfer.marker, servolink.project.transfer.pinned.
"""

from __future__ import annotations

import logging
from pathlib import Path
from random import Random

import msgspec
import pytest

from servolink.client import Board, connect, ignore_progress
from servolink.errors import ProjectError
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.import_plan import plan_project
from servolink.project.transfer.journal import digests_of, strangers
from servolink.project.transfer.marker import is_cut, is_same_id
from servolink.project.transfer.pinned import PinnedConnection, ProjectIDBits
from servolink.virtual import Storage, VirtualTransport
from tests.client.reconnections import connected, until
from tests.client.sockets import Socket
from tests.plugged import plugged
from tests.project.boards import (
    HERE,
    OTHER,
    THERE,
    clearing,
    on_board,
    stopped,
    stopped_import,
    writing,
)
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, History, Make, Pull, bytes_of_import, contents_of
from tests.virtual_time import run

STRANGE = msgspec.structs.replace(
    OTHER, actions=tuple(msgspec.structs.replace(one, action_caption="Strange", steps=()) for one in OLD.actions)
)
"""A project that shares no action with the others of these tests."""
WEAK: list[ProjectIDBits] = [16, 0]
weak = pytest.mark.parametrize("bits", WEAK)


@weak
@pytest.mark.parametrize("whole", [False, True])
def test_an_import_says_how_much_of_an_id_the_board_keeps(bits: ProjectIDBits, tmp_path: Path, *, whole: bool) -> None:
    make = Make(project_id_bits=bits)

    async def work(board: Board) -> None:
        applied = await board.apply_project(NEW, folder=tmp_path, replace=whole)
        assert (applied.changed, applied.resumed, applied.project_id_bits) == (True, False, bits)
        assert not await board.has_unfinished_import(folder=tmp_path)
        again = await board.apply_project(NEW, folder=tmp_path)
        assert (again.changed, again.project_id_bits) == (False, None)
        assert (await board.rollback_project(folder=tmp_path)).project_id_bits == bits

    assert make.holds(on_board(work, make=make), OLD_CONTENTS)


@weak
@pytest.mark.parametrize("when", [writing, clearing])
@pytest.mark.parametrize("back", [True, False])
def test_an_interrupted_import_is_recognised_at_its_address(
    bits: ProjectIDBits, when: object, tmp_path: Path, *, back: bool
) -> None:
    make = Make(project_id_bits=bits)

    async def work(board: Board) -> None:
        await stopped_import(board, tmp_path, when, replace=when is clearing)  # type: ignore[arg-type]
        assert await board.has_unfinished_import(folder=tmp_path)
        if back:
            await board.rollback_project(folder=tmp_path)
        else:
            applied = await board.apply_project(NEW, folder=tmp_path)
            assert applied.resumed
            assert applied.backup == BackupStore(tmp_path).backups()[0].path
        assert len(BackupStore(tmp_path).backups()) == 1
        assert not await board.has_unfinished_import(folder=tmp_path)

    assert make.holds(on_board(work, make=make), OLD_CONTENTS if back else NEW_CONTENTS)


@weak
def test_a_rollback_that_is_interrupted_continues(bits: ProjectIDBits, tmp_path: Path) -> None:
    make = Make(project_id_bits=bits)

    async def work(board: Board) -> None:
        await board.apply_project(NEW, folder=tmp_path)
        await stopped(lambda tell: board.rollback_project(folder=tmp_path, on_progress=tell), writing)
        await board.rollback_project(folder=tmp_path)

    assert make.holds(on_board(work, make=make), OLD_CONTENTS)


@weak
def test_another_board_at_the_address_of_an_interrupted_import_is_not_taken_for_it(
    bits: ProjectIDBits, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    make = Make(project_id_bits=bits)
    first, second = make.board(OLD_CONTENTS, 1), make.board(contents_of(STRANGE), 2)

    async def main() -> None:
        async with connect(VirtualTransport(first, HERE)) as board:
            await stopped_import(board, tmp_path, writing)
        async with connect(VirtualTransport(second, HERE)) as board:
            if bits == 0:
                with pytest.raises(ProjectError, match="keeps no project id, and the content differs"):
                    await board.rollback_project(folder=tmp_path)
            with caplog.at_level(logging.WARNING):
                assert not (await board.apply_project(NEW, folder=tmp_path)).resumed
            assert (bits == 0) == any("the import starts over, with a new backup" in one for one in caplog.messages)
            await board.rollback_project(folder=tmp_path)
            assert make.holds(second.storage.contents, contents_of(STRANGE))
        async with connect(VirtualTransport(first, HERE)) as board:
            assert (await board.apply_project(NEW, folder=tmp_path)).resumed

    run(main())
    assert make.holds(first.storage.contents, NEW_CONTENTS)


@weak
def test_an_import_that_was_interrupted_elsewhere_is_not_recognised_and_has_its_own_backup(
    bits: ProjectIDBits, tmp_path: Path
) -> None:
    make = Make(project_id_bits=bits)
    virtual = make.board(OLD_CONTENTS, 1)

    async def main() -> None:
        async with connect(VirtualTransport(virtual, HERE)) as board:
            await stopped_import(board, tmp_path, writing)
        async with connect(VirtualTransport(virtual, THERE)) as board:
            assert not await board.has_unfinished_import(folder=tmp_path)
            assert not (await board.apply_project(NEW, folder=tmp_path)).resumed
        assert len(BackupStore(tmp_path).backups()) == 2

    run(main())
    assert make.holds(virtual.storage.contents, NEW_CONTENTS)


def test_a_board_without_ids_that_was_changed_since_is_not_rolled_back(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        await board.apply_project(NEW, folder=tmp_path)
        await board.delete_action(9)
        with pytest.raises(ProjectError, match=r"a different board; give `rollback` a backup from `servolink backups`"):
            await board.rollback_project(folder=tmp_path)
        await board.rollback_project(BackupStore(tmp_path).backups()[0].path, folder=tmp_path)

    make = Make(project_id_bits=0)
    assert make.holds(on_board(work, make=make), OLD_CONTENTS)


class NoLargeIds(Storage):
    """Refuses project ids of more than 16 bits."""

    @property
    def project_id(self) -> int:
        return super().project_id

    @project_id.setter
    def project_id(self, project_id: int) -> None:
        if 0 <= project_id <= 0xFFFF:
            Storage.project_id.fset(self, project_id)  # type: ignore[attr-defined]


@pytest.mark.virtual_only("the test changes the storage of the virtual board itself")
def test_a_board_that_refuses_large_ids_gets_a_small_marker(tmp_path: Path) -> None:
    virtual = Make().board(OLD_CONTENTS, 1)
    virtual.storage.__class__ = NoLargeIds

    async def main() -> None:
        async with connect(VirtualTransport(virtual)) as board:
            await stopped_import(board, tmp_path, writing)
            assert virtual.storage.project_id not in (OLD.project_id, NEW.project_id)
            applied = await board.apply_project(NEW, folder=tmp_path)
            assert (applied.resumed, applied.project_id_bits) == (True, 16)

    run(main())
    assert Make().holds(virtual.storage.contents, NEW_CONTENTS)


def test_an_id_of_which_the_board_keeps_half_is_no_difference_when_that_is_known() -> None:
    wanted = msgspec.structs.replace(OLD, project_id=OLD.project_id + 0x50000)

    async def work(board: Board) -> None:
        for bits, differs in ((None, True), (16, False), (0, False)):
            pinned = PinnedConnection(board, project_id_bits=bits)  # type: ignore[arg-type]
            plan = await plan_project(pinned, wanted, on_progress=ignore_progress)
            assert plan.differs == differs

    on_board(work, make=Make(project_id_bits=16))


@pytest.mark.parametrize(
    ("found", "wanted", "bits", "same"),
    [
        (5, 5, 32, True),
        (5, 0x10005, 32, False),
        (5, 0x10005, 16, True),
        (-1, 0x1FFFF, 16, True),
        (6, 5, 16, False),
        (6, 5, 0, True),
    ],
)
def test_ids_are_compared_as_far_as_they_are_kept(found: int, wanted: int, bits: ProjectIDBits, *, same: bool) -> None:
    assert is_same_id(found, wanted, bits) == same
    assert not is_cut(6, 5)


def test_digests_tell_records_apart() -> None:
    old, new = digests_of(OLD), digests_of(NEW)
    assert strangers(old, [old]) == []
    assert {"action 2", "action 5", "macro 4"} <= set(strangers(old, [new]))
    assert "action 1" not in strangers(old, [new])


@weak
@pytest.mark.parametrize("whole", [False, True], ids=["differences", "replace"])
@pytest.mark.parametrize("partial", [False, True], ids=["whole", "torn"])
def test_nothing_is_lost_wherever_the_cable_is_pulled(
    bits: ProjectIDBits, tmp_path: Path, *, whole: bool, partial: bool
) -> None:
    make = Make(project_id_bits=bits, partial_writes=partial, bus_powered=partial)
    size = run(bytes_of_import(make, whole=whole, folder=tmp_path / "size"))
    random = Random(f"{bits} {whole} {partial}")
    for at in range(3):
        history = History(make, whole, (Pull.at(random.randrange(sum(size)), size),), seed=at)
        verdict = run(history.judge(tmp_path / str(at)))
        assert verdict.right, history


@weak
async def test_a_board_that_keeps_less_of_its_id_is_recognised_when_it_comes_back(
    bits: ProjectIDBits, monkeypatch: pytest.MonkeyPatch
) -> None:
    socket = Socket(Make(project_id_bits=bits).board(OLD_CONTENTS, 1))
    async with connected(plugged(monkeypatch, socket.transport)) as board:
        await board.write_project_id(0x12345)
        there = socket.board
        assert there is not None
        socket.pull()
        socket.plug(there)
        await until(board, "connected")
