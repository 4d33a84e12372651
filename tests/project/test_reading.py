"""Exports and plans, of boards that behave and of boards that lie.

Modules: servolink.project.transfer.import_plan, servolink.project.transfer.importing, servolink.project.transfer.read,
servolink.project.transfer.results, servolink.project.transfer.writing.
"""

from __future__ import annotations

import logging
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from servolink.client import Board, ignore_progress
from servolink.errors import ProjectError
from servolink.project.model import Project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.import_plan import compare, plan_project
from servolink.project.transfer.importing import apply_project
from servolink.project.transfer.pinned import PinnedConnection
from servolink.project.transfer.read import Content, Listed
from servolink.project.transfer.results import Change, Progress
from servolink.project.transfer.writing import writes
from servolink.protocol import (
    ACTION,
    RECORD_TYPES,
    Action,
    FrameParser,
    QueryActionRequest,
    QueryActionResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoParameterRequest,
    QueryServoParameterResponse,
    ServoParameter,
    Step,
    encode_frame,
)
from servolink.testing import Fate
from tests.client.piped_board import PipedBoard, lie
from tests.project.boards import on_board, on_fake
from tests.project.drawn import storable_projects
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS
from tests.proofs.fuzz.amounts import MANY


def test_an_export_is_everything_on_the_board() -> None:
    async def work(board: Board) -> None:
        assert await board.export_project() == OLD

    assert on_board(work) == OLD_CONTENTS


def test_an_export_is_not_fooled_by_one_damaged_answer() -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.plan(QueryActionRequest, lie(QueryActionResponse(1, "Bow", (Step(1, 61, 50), Step(2, -60, 50)))))
        assert await board.export_project() == OLD

    assert len(on_fake(work).sent_of(QueryActionRequest)) == 2 * len(OLD.actions) + 1


def test_an_export_gives_up_when_no_two_readings_agree() -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.plan(QueryProjectIDRequest, *(lie(QueryProjectIDResponse(at)) for at in range(100)))
        with pytest.raises(ProjectError, match="9 readings of the project id all differed"):
            await board.export_project()

    on_fake(work)


def test_what_is_listed_and_not_given_is_an_error_that_says_so() -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.plan(QueryActionRequest, *[lie(QueryActionResponse(0))] * 2)
        with pytest.raises(ProjectError, match="action 1: the board lists the record, but returns nothing"):
            await board.export_project()

    on_fake(work)


@pytest.mark.virtual_only("the test changes the storage of the virtual board itself")
def test_what_is_listed_twice_is_named(caplog: pytest.LogCaptureFixture) -> None:
    twice = OLD_CONTENTS.records[ACTION] + OLD_CONTENTS.records[ACTION][:1]

    async def work(board: Board) -> None:
        with caplog.at_level(logging.WARNING):
            assert await board.export_project() == OLD

    on_board(work, replace(OLD_CONTENTS, records={**OLD_CONTENTS.records, ACTION: twice}))
    assert "virtual:// lists twice and returns once: action 1" in caplog.text


def test_a_plan_says_what_would_change_and_changes_nothing() -> None:
    async def work(board: Board) -> None:
        plan = await board.plan_project(NEW)
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
        neutral = 35  # bytes of the servo parameters that say nothing any more
        assert plan.memory is not None
        assert plan.memory.free_before - plan.memory.free_after == NEW_CONTENTS.size + neutral - OLD_CONTENTS.size
        assert not plan.is_unfinished
        assert not (await board.plan_project(OLD)).changes

    assert on_board(work) == OLD_CONTENTS


@pytest.mark.parametrize("whole", [False, True])
def test_a_plan_knows_the_cost_of_the_import(tmp_path: Path, *, whole: bool) -> None:
    async def work(board: Board) -> None:
        plan = await board.plan_project(NEW, replace=whole)
        before = board.stats.bytes_sent + board.stats.bytes_received
        await board.apply_project(NEW, replace=whole, folder=tmp_path)
        actual = board.stats.bytes_sent + board.stats.bytes_received - before
        assert abs(plan.wire_bytes - actual) < 0.05 * actual

    on_board(work)


def test_a_reading_begins_anew_when_something_was_stored_meanwhile() -> None:
    told: list[Progress] = []

    async def work(board: Board, fake: PipedBoard) -> None:
        def tell(progress: Progress) -> None:
            told.append(progress)
            if len(told) == 3:
                fake.storage.contents = NEW_CONTENTS

        assert await board.export_project(on_progress=tell) == NEW

    on_fake(work)
    assert told[-1] == Progress("reading", 6, 6, "joystick table 7")


def test_an_export_gives_up_when_another_program_goes_on_writing() -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        def tell(progress: Progress) -> None:
            fake.storage.project_id += 1

        with pytest.raises(ProjectError, match="the content kept changing during the reading"):
            await board.export_project(on_progress=tell)

    on_fake(work)


def test_what_cannot_be_understood_is_taken_for_what_is_not_given() -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        undecodable = encode_frame(QueryActionResponse.packet_id, bytes(36) + b"\x05\0", "little")

        def mangle(frame: bytes) -> bytes:
            answer = fake.codec.decode(*FrameParser().feed(frame)[0])
            return undecodable if isinstance(answer, QueryActionResponse) and answer.action_id == 1 else frame

        fake.plan(QueryActionRequest, *[Fate(damage=mangle)] * 100)
        plan = await board.plan_project(OLD)
        assert plan.inconsistencies == ("action 1 is listed and not returned",)
        assert [change.what for change in plan.changes] == ["action 1"]

    on_fake(work)


def test_servo_parameters_that_are_listed_twice_are_a_fault_and_the_last_counts() -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        twice = (ServoParameter(1, 9, "old"), *OLD.servo_parameters)
        fake.plan(QueryServoParameterRequest, *[lie(QueryServoParameterResponse(twice))] * 3)
        plan = await board.plan_project(OLD)
        assert (plan.changes, plan.inconsistencies) == ((), ("servo parameter 1 is listed more than once",))

    on_fake(work)


def test_an_active_table_that_is_not_in_the_project_is_no_difference(tmp_path: Path) -> None:
    """A board can say so, and no board could be told."""
    said = replace(OLD, active_joystick_table=99)

    async def work(board: Board) -> None:
        pinned = PinnedConnection(board)
        plan = await plan_project(pinned, said, on_progress=ignore_progress, unchecked=True)
        assert not plan.differs
        assert not (
            await apply_project(pinned, said, store=BackupStore(tmp_path), on_progress=ignore_progress, unchecked=True)
        ).changed

    on_board(work)


@settings(max_examples=20 * MANY)
@given(storable_projects, st.data())
def test_a_plan_differs_where_something_would_be_written(wanted: Project, data: st.DataObject) -> None:
    records = {kind: tuple(Listed(*one) for one in kind.by_id(wanted).items()) for kind in RECORD_TYPES}
    content = Content(wanted.project_id, wanted.servo_parameters, None, records)
    kind = data.draw(st.sampled_from(RECORD_TYPES))
    match data.draw(st.integers(0, 5)):
        case 1:
            records[kind] += records[kind][:1]
        case 2:
            records[kind] = tuple(Listed(one.record_id, None) for one in records[kind])
        case 3:
            records[kind] = records[kind][1:]
        case 4:
            content.servo_parameters += content.servo_parameters[:1]
        case 5:
            content.project_id ^= 1
    to_do = bool(writes(content, wanted)) or content.project_id != wanted.project_id
    assert to_do == bool(compare(content.readable(), wanted) or content.doubled() or content.missing())


def test_what_no_wire_carries_is_refused_unchecked_too() -> None:
    async def work(board: Board) -> None:
        with pytest.raises(ProjectError, match=r"action 1 cannot be written to a board: .*takes 40 bytes"):
            await board.apply_project(Project(actions=(Action(1, "x" * 40),)), unchecked=True)

    on_board(work)
