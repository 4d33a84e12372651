"""Exports, plans, imports and rollbacks on boards that behave, that are odd, and that lie."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from servolink.client.board import Board
from servolink.client.connect import connect
from servolink.errors import ProjectError, RequestTimeout
from servolink.project.compare import Change
from servolink.project.model import UNFINISHED
from servolink.project.progress import Progress
from servolink.project.store import Store
from servolink.protocol.editing import (
    Action,
    AddActionRequest,
    Macro,
    QueryActionRequest,
    QueryActionResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    ServoParameter,
    WriteProjectIDRequest,
)
from servolink.protocol.servos import ALL_SERVOS, SetServoParameterRequest, Step
from servolink.protocol.settings import ClearAllDataRequest
from servolink.virtual.storage import Contents, Kind
from servolink.virtual.transport import VirtualTransport
from tests.client.fake_board import SWALLOWED, FakeBoard, lie
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, Make, contents_of, same
from tests.virtual_time import run

CHANGING = (AddActionRequest, ClearAllDataRequest, WriteProjectIDRequest)


def on_board(work: Any, contents: Contents = OLD_CONTENTS, make: Make | None = None) -> Contents:
    """Let `work` use a connected board; return what the board holds then."""

    async def main() -> Contents:
        virtual = (make or Make()).board(contents, 1)
        async with connect(VirtualTransport(virtual)) as board:
            await work(board)
        return virtual.storage.contents

    return run(main())


def on_fake(work: Any) -> FakeBoard:
    """Let `work` use a connected fake board, which has OLD stored."""
    fake = FakeBoard(servos=3)
    fake.virtual.storage.contents = OLD_CONTENTS

    async def main() -> None:
        async with connect(fake) as board:
            await work(board, fake)

    run(main())
    return fake


def test_an_export_is_everything_on_the_board() -> None:
    async def work(board: Board) -> None:
        assert await board.export_project() == OLD

    assert on_board(work) == OLD_CONTENTS


def test_an_export_is_not_fooled_by_one_damaged_answer() -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        fake.plan(QueryActionRequest, lie(QueryActionResponse(1, "Bow", (Step(1, 61, 50), Step(2, -60, 50)))))
        assert await board.export_project() == OLD

    assert len(on_fake(work).sent_of(QueryActionRequest)) == 2 * len(OLD.actions) + 1


def test_an_export_gives_up_when_no_two_readings_agree() -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        fake.plan(QueryProjectIDRequest, *(lie(QueryProjectIDResponse(at)) for at in range(100)))
        with pytest.raises(ProjectError, match="9 readings of its lists all differed"):
            await board.export_project()

    on_fake(work)


def test_what_is_listed_and_not_given_is_an_error_that_says_so() -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        fake.plan(QueryActionRequest, *[lie(QueryActionResponse(0))] * 2)
        with pytest.raises(ProjectError, match="action 1: the board lists it and does not give it"):
            await board.export_project()

    on_fake(work)


def test_what_is_listed_twice_is_named(caplog: pytest.LogCaptureFixture) -> None:
    twice = OLD_CONTENTS.records[Kind.ACTION] + OLD_CONTENTS.records[Kind.ACTION][:1]

    async def work(board: Board) -> None:
        with caplog.at_level(logging.WARNING):
            assert await board.export_project() == OLD

    on_board(work, replace(OLD_CONTENTS, records={**OLD_CONTENTS.records, Kind.ACTION: twice}))
    assert "virtual:// lists twice and gives once: action 1" in caplog.text


@pytest.mark.parametrize("whole", [False, True])
def test_an_import_tells_how_far_it_is_and_what_it_did(tmp_path: Path, *, whole: bool) -> None:
    told: list[Progress] = []

    async def work(board: Board) -> None:
        applied = await board.apply(NEW, replace=whole, folder=tmp_path, progress=told.append)
        assert applied.changed
        assert not applied.resumed
        assert applied.backup == Store(tmp_path).backups()[-1].path

    assert same(on_board(work), NEW_CONTENTS)
    phases = [
        at.phase for at, before in zip(told, [None, *told], strict=False) if before is None or at.phase != before.phase
    ]
    middle = ["clearing"] if whole else []
    assert phases == ["reading", "saving", "marking", *middle, "writing", "verifying", "finishing"]
    assert all(0 <= at.done <= at.total for at in told)
    assert Store(tmp_path).journals() == []


def test_what_is_there_already_is_not_written_again(tmp_path: Path) -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        assert not (await board.apply(OLD, replace=True, folder=tmp_path)).changed

    fake = on_fake(work)
    assert not [packet for _, packet in fake.sent if isinstance(packet, CHANGING)]
    assert not list(tmp_path.iterdir())


def test_only_what_differs_is_written(tmp_path: Path) -> None:
    bow = Action(1, "Bow", (Step(1, 60, 50), Step(2, -61, 50)))
    changed = msgspec.structs.replace(OLD, actions=(bow, *OLD.actions[1:]))

    async def work(board: Board, fake: FakeBoard) -> None:
        await board.apply(changed, folder=tmp_path)

    fake = on_fake(work)
    assert [packet.action_id for packet in fake.executed_of(AddActionRequest)] == [1]  # type: ignore[attr-defined]
    assert fake.executed_of(ClearAllDataRequest) == []


def test_a_plan_says_what_would_change_and_changes_nothing() -> None:
    async def work(board: Board) -> None:
        plan = await board.plan(NEW)
        assert plan.changes[0] == Change("project id", 77, 88)
        assert [change.what for change in plan.changes if change.old is None] == [
            "servo parameter 3",
            "action 9",
            "joystick table 7",
        ]
        assert [change.what for change in plan.changes if change.new is None] == [
            "servo parameter 2",
            "action 5",
            "macro 4",
            "joystick table 2",
        ]
        assert plan.free_before - plan.free_after == NEW_CONTENTS.size - OLD_CONTENTS.size
        assert not plan.is_unfinished
        assert not (await board.plan(OLD)).changes

    assert on_board(work) == OLD_CONTENTS


@pytest.mark.parametrize("whole", [False, True])
def test_a_plan_knows_the_cost_of_the_import(tmp_path: Path, *, whole: bool) -> None:
    async def work(board: Board) -> None:
        plan = await board.plan(NEW, replace=whole)
        before = board.stats.bytes_sent + board.stats.bytes_received
        await board.apply(NEW, replace=whole, folder=tmp_path)
        actual = board.stats.bytes_sent + board.stats.bytes_received - before
        assert abs(plan.wire_bytes - actual) < 0.05 * actual

    on_board(work)


def test_a_project_that_does_not_fit_is_refused_before_anything_changes(tmp_path: Path) -> None:
    huge = msgspec.structs.replace(OLD, actions=tuple(Action(at, "x", (Step(1, 0, 1),) * 900) for at in range(1, 30)))

    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match=r"takes .* bytes more than what is on virtual://, which has .* free"):
            await board.apply(huge, folder=tmp_path)
        assert (await board.plan(huge)).free_after < 0

    assert on_board(work) == OLD_CONTENTS


def test_a_project_with_an_error_is_refused_before_anything_is_asked(tmp_path: Path) -> None:
    wrong = msgspec.structs.replace(OLD, project_id=UNFINISHED.start)

    async def work(board: Board, fake: FakeBoard) -> None:
        with pytest.raises(ProjectError, match="project_id"):
            await board.apply(wrong, folder=tmp_path)

    assert on_fake(work).sent == []


def test_what_a_board_does_not_take_is_named_and_can_be_rolled_back(tmp_path: Path) -> None:
    wanted = msgspec.structs.replace(OLD, servo_parameters=(ServoParameter(99, 1, "no such servo"),))

    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match="does not take servo parameters; the import is unfinished"):
            await board.apply(wanted, folder=tmp_path)
        assert await board.has_unfinished_import()
        await board.rollback(folder=tmp_path)

    assert same(on_board(work), OLD_CONTENTS)


def test_an_import_that_is_cancelled_at_any_moment_is_gone_on_with(tmp_path: Path) -> None:
    async def cancelled_after(turns: int, folder: Path) -> bool:
        """Tell whether the import was cancelled, and not done before."""
        virtual = Make().board(OLD_CONTENTS, 1)
        async with connect(VirtualTransport(virtual)) as board:
            task = asyncio.ensure_future(board.apply(NEW, folder=folder))
            for _ in range(turns):
                await asyncio.sleep(0)
            if task.done():
                return False
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            unfinished = await board.has_unfinished_import()
            assert (await board.apply(NEW, folder=folder)).resumed == unfinished
        assert same(virtual.storage.contents, NEW_CONTENTS)
        return True

    turns = 0
    while run(cancelled_after(turns, tmp_path / str(turns))):
        turns += 3
    assert turns > 100


def test_an_answer_that_never_comes_is_no_reason_to_write_twice(tmp_path: Path) -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        fake.plan(AddActionRequest, SWALLOWED)
        await board.apply(NEW, folder=tmp_path)

    fake = on_fake(work)
    assert len(fake.sent_of(AddActionRequest)) == 2
    assert same(fake.virtual.storage.contents, NEW_CONTENTS)


def test_an_import_of_another_project_takes_over_and_keeps_the_first_backup(tmp_path: Path) -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        fake.plan(AddActionRequest, *[SWALLOWED] * 9)
        task = asyncio.ensure_future(board.apply(NEW, folder=tmp_path))
        while not fake.sent_of(AddActionRequest):
            await asyncio.sleep(0.01)
        task.cancel()
        fake.forget_plans()
        other = msgspec.structs.replace(OLD, project_id=5)
        assert (await board.apply(other, folder=tmp_path)).resumed
        assert len(Store(tmp_path).backups()) == 1

    assert on_fake(work).virtual.storage.project_id == 5


def unfinished(contents: Contents = OLD_CONTENTS) -> Contents:
    """Return the contents of a board on which another computer has begun an import."""
    return replace(contents, project_id=UNFINISHED.start + 7)


def test_an_unfinished_import_without_a_journal_needs_a_backup_to_be_named(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match="that another computer began, or whose journal is lost"):
            await board.rollback(folder=tmp_path)
        backup = Store(tmp_path).keep(OLD, "virtual://")
        await board.rollback(backup, folder=tmp_path)

    assert same(on_board(work, unfinished()), OLD_CONTENTS)


def test_an_unfinished_import_without_a_journal_can_be_finished(tmp_path: Path) -> None:
    async def work(board: Board) -> None:
        assert (await board.plan(NEW)).is_unfinished
        assert not (await board.apply(NEW, folder=tmp_path)).resumed
        assert not await board.has_unfinished_import()

    assert same(on_board(work, unfinished()), NEW_CONTENTS)


def test_no_backup_must_be_asked_for_where_none_can_be_made(tmp_path: Path) -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        fake.plan(QueryActionRequest, *[lie(QueryActionResponse(0))] * 2)
        with pytest.raises(ProjectError, match=r"no backup of fake://board can be made: action 1: the board lists it"):
            await board.apply(NEW, folder=tmp_path)
        fake.plan(QueryActionRequest, *[lie(QueryActionResponse(0))] * 2)
        assert (await board.apply(NEW, folder=tmp_path, backup=False)).backup is None
        with pytest.raises(ProjectError, match="there is no backup of fake://board"):
            await board.rollback(folder=tmp_path)

    assert same(on_fake(work).virtual.storage.contents, NEW_CONTENTS)


def test_what_was_stored_on_a_board_that_only_looks_cleared_is_kept(tmp_path: Path) -> None:
    virtual = Make(clear="all").board(OLD_CONTENTS, 1)

    async def main() -> None:
        async with connect(VirtualTransport(virtual)) as board:
            await board.apply(NEW, replace=True, folder=tmp_path)
        journal = tmp_path / "imports"
        async with connect(VirtualTransport(virtual)) as board:
            task = asyncio.ensure_future(board.apply(OLD, replace=True, folder=tmp_path))
            while virtual.storage.project_id or not list(journal.iterdir()):
                await asyncio.sleep(0)
            task.cancel()
        assert virtual.storage.contents.size == 0
        virtual.storage.contents = contents_of(msgspec.structs.replace(OLD, project_id=0))
        async with connect(VirtualTransport(virtual)) as board:
            before = len(Store(tmp_path).backups())
            assert (await board.apply(NEW, folder=tmp_path)).resumed
            assert len(Store(tmp_path).backups()) == before + 1

    run(main())


def test_a_rollback_of_a_finished_import_restores_what_was_there_even_what_we_would_not_write(tmp_path: Path) -> None:
    odd = msgspec.structs.replace(OLD, macros=(Macro(3, "clear\x1b[2J", ()),))

    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match="control"):
            await board.apply(odd, folder=tmp_path)
        await board.apply(NEW, folder=tmp_path)
        await board.rollback(folder=tmp_path)
        assert (await board.export_project()).macros == odd.macros
        await board.rollback(folder=tmp_path)  # what was there before the rollback
        assert await board.export_project() == NEW

    assert same(on_board(work, contents_of(odd)), NEW_CONTENTS)


def test_stop_gets_through_in_the_middle_of_an_import(tmp_path: Path) -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        task = asyncio.ensure_future(board.apply(NEW, folder=tmp_path))
        while not fake.sent_of(AddActionRequest):
            await asyncio.sleep(0.001)
        sent = len(fake.sent)
        await board.stop()
        assert [packet for _, packet in fake.sent[sent : sent + 2]][-1] == SetServoParameterRequest(
            ALL_SERVOS, 0, 1
        ) or (fake.sent[sent][1] == SetServoParameterRequest(ALL_SERVOS, 0, 1))
        await task

    assert same(on_fake(work).virtual.storage.contents, NEW_CONTENTS)


def test_clearing_overlaps_nothing(tmp_path: Path) -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        async def ask() -> None:
            while not done.is_set():
                await board.battery()

        done = asyncio.Event()
        asking = asyncio.ensure_future(ask())
        await board.apply(NEW, replace=True, folder=tmp_path)
        done.set()
        await asking

    fake = on_fake(work)
    (cleared,) = fake.sent_of(ClearAllDataRequest)
    at = [when for when, _ in fake.sent].index(cleared)
    next_sent = fake.sent[at + 1][0]
    answered = next(when for when in fake.answered_at if when > cleared)
    assert next_sent >= answered


def test_a_journal_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "imports").mkdir()
    (tmp_path / "imports" / "7a000001.json").write_text("{")

    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match=r"7a000001\.json: this journal of an import cannot be read"):
            await board.apply(NEW, folder=tmp_path)

    assert on_board(work) == OLD_CONTENTS


def test_a_folder_that_cannot_be_written_stops_before_anything_changes(tmp_path: Path) -> None:
    (tmp_path / "backups").write_text("in the way")

    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match="the backup cannot be written"):
            await board.apply(NEW, folder=tmp_path)

    assert on_board(work) == OLD_CONTENTS


def test_a_board_that_falls_silent_leaves_an_import_to_go_on_with(tmp_path: Path) -> None:
    async def work(board: Board, fake: FakeBoard) -> None:
        fake.plan(AddActionRequest, SWALLOWED)
        usual = fake.usual
        task = asyncio.ensure_future(board.apply(NEW, folder=tmp_path))
        while not fake.sent_of(AddActionRequest):
            await asyncio.sleep(0.001)
        fake.usual = SWALLOWED
        with pytest.raises((RequestTimeout, ConnectionError)):
            await task
        fake.usual = usual

    fake = on_fake(work)
    assert fake.virtual.storage.project_id in UNFINISHED
    left = on_board(lambda board: board.apply(NEW, folder=tmp_path), fake.virtual.storage.contents)
    assert same(left, NEW_CONTENTS)
