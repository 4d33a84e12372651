"""Imports and rollbacks on boards that behave, and on boards that do not.

Modules: servolink.client.projects, servolink.project.transfer.import_run.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from servolink.client import Board, connect, ignore_progress
from servolink.errors import ProjectError
from servolink.project.model import UNFINISHED, Project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.import_plan import plan_project
from servolink.project.transfer.pinned import PinnedConnection
from servolink.project.transfer.results import Memory, Progress
from servolink.protocol import (
    ACTION,
    ALL_SERVOS,
    Action,
    AddActionRequest,
    ClearAllDataRequest,
    QueryMemorySizeRequest,
    SetServoParameterRequest,
    Step,
    WriteProjectIDRequest,
)
from servolink.virtual import Contents, VirtualTransport
from tests.client.piped_board import SWALLOWED, PipedBoard
from tests.project.boards import on_board, on_fake
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, Make, contents_of, same
from tests.virtual_time import run


@pytest.mark.parametrize("whole", [False, True])
def test_an_import_tells_how_far_it_is_and_what_it_did(tmp_path: Path, *, whole: bool) -> None:
    told: list[Progress] = []

    async def work(board: Board) -> None:
        applied = await board.apply_project(NEW, replace=whole, folder=tmp_path, on_progress=told.append)
        assert applied.changed
        assert not applied.resumed
        assert applied.backup == BackupStore(tmp_path).backups()[-1].path

    assert same(on_board(work), NEW_CONTENTS)
    phases = [
        at.phase for at, before in zip(told, [None, *told], strict=False) if before is None or at.phase != before.phase
    ]
    middle = ["clearing"] if whole else []
    assert phases == ["reading", "saving", "marking", *middle, "writing", "verifying", "finishing"]
    assert all(0 <= at.done <= at.total for at in told)
    (journal,) = BackupStore(tmp_path).journals(0)
    assert journal.phase == "finished"


def test_what_is_there_already_is_not_written_again(tmp_path: Path) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        assert not (await board.apply_project(OLD, replace=True, folder=tmp_path)).changed

    fake = on_fake(work)
    assert not [
        packet
        for _, packet in fake.sent
        if isinstance(packet, (WriteProjectIDRequest, AddActionRequest, ClearAllDataRequest))
    ]
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_only_what_differs_is_written(tmp_path: Path) -> None:
    bow = Action(1, "Bow", (Step(1, 60, 50), Step(2, -61, 50)))
    changed = msgspec.structs.replace(OLD, actions=(bow, *OLD.actions[1:]))

    async def work(board: Board, fake: PipedBoard) -> None:
        await board.apply_project(changed, folder=tmp_path)

    fake = on_fake(work)
    assert [packet.action_id for packet in fake.executed_of(AddActionRequest)] == [1]  # type: ignore[attr-defined]
    assert fake.executed_of(ClearAllDataRequest) == []


def test_a_project_that_does_not_fit_is_tried_and_comes_off_again(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    huge = msgspec.structs.replace(OLD, actions=tuple(Action(at, "x", (Step(1, 0, 1),) * 900) for at in range(1, 30)))

    async def work(board: Board) -> None:
        memory = (await board.plan_project(huge)).memory
        assert memory is not None
        assert memory.free_after < 0
        assert memory.warning.endswith("assuming memory figures in bytes")
        assert not caplog.messages
        with pytest.raises(ProjectError, match=r"action \d+ \(refused\).* because its memory is full"):
            await board.apply_project(huge, folder=tmp_path)
        assert caplog.messages == [f"virtual://: {memory.warning}"]
        await board.rollback_project(folder=tmp_path)

    assert same(on_board(work), OLD_CONTENTS)


@pytest.mark.parametrize("spare", [0, -1])
@pytest.mark.virtual_only("the test changes the storage of the virtual board itself")
def test_a_project_that_just_fits_is_taken(tmp_path: Path, *, spare: int) -> None:
    wanted = msgspec.structs.replace(OLD, actions=(*OLD.actions, Action(7, "More", (Step(1, 0, 1),) * 100)))
    virtual = Make().board(OLD_CONTENTS, 1)
    virtual.storage.memory = contents_of(wanted).size + spare

    async def main() -> None:
        async with connect(VirtualTransport(virtual)) as board:
            if spare < 0:
                with pytest.raises(ProjectError, match=r"action 7 \(refused\), perhaps because its memory is full"):
                    await board.apply_project(wanted, folder=tmp_path)
                await board.rollback_project(folder=tmp_path)
            else:
                await board.apply_project(wanted, folder=tmp_path)

    run(main())
    assert same(virtual.storage.contents, OLD_CONTENTS if spare < 0 else contents_of(wanted))


def test_memory_is_counted_in_the_unit_of_the_board() -> None:
    async def work(board: Board) -> None:
        free = (await board.memory()).size
        pinned = PinnedConnection(board, memory_unit=1024)
        plan = await plan_project(pinned, NEW, on_progress=ignore_progress)
        assert plan.memory is not None
        assert (plan.memory.unit, plan.memory.free_before) == (1024, 1024 * free)
        assert not plan.memory.warning
        tight = Memory(1024, None, 2048, -1)
        assert "2,049 bytes more than" in tight.warning
        assert tight.warning.endswith("2,048 bytes free, counted in units of 1,024 bytes")

    on_board(work)


def test_a_board_that_does_not_say_how_much_memory_it_has_is_imported_to(tmp_path: Path) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.usual_of[QueryMemorySizeRequest] = SWALLOWED
        assert (await board.plan_project(NEW)).memory is None
        await board.apply_project(NEW, folder=tmp_path)

    assert same(on_fake(work).storage.contents, NEW_CONTENTS)


def test_a_project_with_an_error_is_refused_before_anything_is_asked(tmp_path: Path) -> None:
    wrong = msgspec.structs.replace(OLD, project_id=UNFINISHED.start)

    async def work(board: Board, fake: PipedBoard) -> None:
        with pytest.raises(ProjectError, match="project_id"):
            await board.apply_project(wrong, folder=tmp_path)

    assert on_fake(work).sent == []


def test_an_answer_that_never_comes_is_no_reason_to_write_twice(tmp_path: Path) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.plan(AddActionRequest, SWALLOWED)
        await board.apply_project(NEW, folder=tmp_path)

    fake = on_fake(work)
    assert len(fake.sent_of(AddActionRequest)) == 2
    assert same(fake.storage.contents, NEW_CONTENTS)


def test_stop_gets_through_in_the_middle_of_an_import(tmp_path: Path) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        task = asyncio.ensure_future(board.apply_project(NEW, folder=tmp_path))
        while not fake.sent_of(AddActionRequest):
            await asyncio.sleep(0.001)
        sent = len(fake.sent)
        await board.stop()
        assert [packet for _, packet in fake.sent[sent : sent + 2]][-1] == SetServoParameterRequest(
            ALL_SERVOS, 0, 1
        ) or (fake.sent[sent][1] == SetServoParameterRequest(ALL_SERVOS, 0, 1))
        await task

    assert same(on_fake(work).storage.contents, NEW_CONTENTS)


@pytest.mark.parametrize("depth", [1, 4])
def test_clearing_overlaps_nothing(tmp_path: Path, *, depth: int) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        async def ask(ask: Callable[[], Awaitable[object]]) -> None:
            while not done.is_set():
                await ask()

        done = asyncio.Event()
        others = (board.battery, board.servos, board.joystick_tables, board.memory)
        asking = [asyncio.ensure_future(ask(other)) for other in others]
        await board.apply_project(NEW, replace=True, folder=tmp_path)
        done.set()
        await asyncio.gather(*asking)

    fake = on_fake(work, depth=depth)
    assert same(fake.storage.contents, NEW_CONTENTS)
    (cleared,) = fake.sent_of(ClearAllDataRequest)
    at = [when for when, _ in fake.sent].index(cleared)
    answers = [when for when in fake.answered_at if when <= cleared]
    assert len(answers) == at  # whatever was sent before it was answered before it
    assert fake.sent[at + 1][0] >= fake.answered_at[at]


def test_captions_are_checked_in_the_encoding_of_the_connection(tmp_path: Path) -> None:
    """Twelve characters take 24 bytes in Big5 and 36 in UTF-8; a caption has 32."""
    caption = "\u5411\u524d\u8d70\u5411\u5f8c\u8d70\u5411\u5de6\u8f49\u5411\u53f3\u8f49"
    project = Project(1, actions=(Action(1, caption, ()),))

    async def work(board: Board) -> None:
        await board.apply_project(project, folder=tmp_path)
        assert await board.export_project() == project

    on_board(work, caption_encoding="big5")

    async def refused(board: Board) -> None:
        with pytest.raises(ProjectError, match=r"actions\[0\]\.action_caption: .* takes 36 bytes in utf-8"):
            await board.apply_project(project, folder=tmp_path)

    on_board(refused)


def test_a_backup_is_restored_in_the_encoding_in_which_it_was_read(tmp_path: Path) -> None:
    old = Project(3, actions=(Action(1, "\u52d5\u4f5c", ()),))
    there = on_board(
        lambda board: board.apply_project(old, folder=tmp_path / "first"), Contents(), caption_encoding="big5"
    )
    new = on_board(lambda board: board.apply_project(NEW, folder=tmp_path), there, caption_encoding="big5")

    async def refused(board: Board) -> None:
        with pytest.raises(ProjectError, match="captions in big5; connect with the same caption encoding, not utf-8"):
            await board.rollback_project(folder=tmp_path)

    assert on_board(refused, new) == new
    assert same(on_board(lambda board: board.rollback_project(folder=tmp_path), new, caption_encoding="big5"), there)


@pytest.mark.virtual_only("the test changes the storage of the virtual board itself")
async def test_doubled_records_make_room_where_they_go(tmp_path: Path) -> None:
    bow = contents_of(Project(actions=(Action(1, "Bow", (Step(1, 0, 1),) * 1000),)))
    doubled = replace(bow, records={**bow.records, ACTION: bow.records[ACTION] * 3})
    project = Project(4, actions=(Action(1, "Bow", (Step(1, 0, 2),) * 1000), Action(2, "Nod", (Step(1, 0, 1),) * 1000)))
    virtual = Make().board(doubled, 1)
    virtual.storage.memory = doubled.size + 10
    async with connect(VirtualTransport(virtual)) as board:
        plan = await board.plan_project(project)
        assert plan.inconsistencies == ("action 1 is listed more than once",)
        await board.apply_project(project, folder=tmp_path)
        assert plan.memory is not None
        assert (await board.memory()).size == plan.memory.free_after


@pytest.mark.virtual_only("the test changes the storage of the virtual board itself")
def test_a_project_that_is_there_but_for_a_doubled_record_is_not_there_yet(tmp_path: Path) -> None:
    actions = OLD_CONTENTS.records[ACTION]
    doubled = replace(OLD_CONTENTS, records={**OLD_CONTENTS.records, ACTION: (*actions, actions[0])})

    async def work(board: Board) -> None:
        plan = await board.plan_project(OLD)
        assert plan.differs
        assert plan.requests
        assert (plan.changes, plan.inconsistencies) == ((), ("action 1 is listed more than once",))
        assert (await board.apply_project(OLD, folder=tmp_path)).changed
        assert not (await board.plan_project(OLD)).differs

    assert same(on_board(work, doubled), OLD_CONTENTS)
