"""Imports to boards with so many records that reading a list costs more than writing what differs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest

from servolink.client import Board
from servolink.project.model import Project
from servolink.protocol import ACTION, Action, AddActionRequest, QueryActionListRequest, QueryActionRequest, Step
from servolink.virtual import AnyType
from tests.client.piped_board import SWALLOWED, PipedBoard, lie, opened
from tests.project.pulled import contents_of, same
from tests.virtual_time import run

MANY = Project(3, actions=tuple(Action(at, f"Action {at}", (Step(1, at, 5),)) for at in range(1, 301)))
CHANGED = msgspec.structs.replace(MANY, actions=(Action(1, "Action 1", (Step(1, 9, 9),)), *MANY.actions[1:]))
SHORTER = msgspec.structs.replace(MANY, actions=MANY.actions[1:])


def imported(target: Project, folder: Path, fake: PipedBoard) -> PipedBoard:
    """Import `target` over MANY."""
    fake.storage.contents = contents_of(MANY)

    async def main() -> None:
        async with opened(fake) as board:
            await board.apply_project(target, folder=folder)

    run(main())
    assert same(fake.storage.contents, contents_of(target))
    return fake


def readings(fake: PipedBoard) -> tuple[int, Counter[int]]:
    """Return how many times the list was asked for, and how many times each action."""
    asked = [packet for _, packet in fake.sent]
    return len(fake.sent_of(QueryActionListRequest)), Counter(
        packet.action_id for packet in asked if isinstance(packet, QueryActionRequest)
    )


def test_what_is_as_it_should_be_is_read_once_and_the_list_too(tmp_path: Path) -> None:
    lists, times = readings(imported(CHANGED, tmp_path, PipedBoard()))
    assert lists == 1
    assert times.pop(1) == 4, "twice before it is deleted, once after that, once after it was added"
    assert set(times.values()) == {1}


def test_a_deletion_is_looked_up(tmp_path: Path) -> None:
    lists, times = readings(imported(SHORTER, tmp_path, PipedBoard()))
    assert (lists, times[1]) == (1, 3)


def test_on_a_board_that_is_silent_about_unknown_ids_the_list_shows_a_deletion(tmp_path: Path) -> None:
    class Silent(PipedBoard):
        def _take(self, packet: Any, frame: bytes) -> None:
            known = {action_id for action_id, _ in self.storage.all(ACTION)}
            if isinstance(packet, QueryActionRequest) and packet.action_id not in known:
                self.plan(QueryActionRequest, SWALLOWED)
            super()._take(packet, frame)

    assert readings(imported(SHORTER, tmp_path, Silent()))[0] == 2


@pytest.mark.virtual_only("the test changes the storage of the virtual board itself")
def test_a_write_that_was_done_and_does_not_show_makes_everything_be_read_again(tmp_path: Path) -> None:
    """It was damaged on the way, and has replaced another record."""
    fake = PipedBoard()
    put, damaged = fake.storage.put, [True]

    def damaging(of: AnyType, records: Mapping[int, bytes], **options: Any) -> bool:
        if of is ACTION and damaged and fake.sent_of(AddActionRequest):
            damaged.clear()
            records = {7: next(iter(records.values()))}
        return put(of, records, **options)

    setattr(fake.storage, "put", damaging)  # noqa: B010 - only this board
    lists, times = readings(imported(CHANGED, tmp_path, fake))
    assert lists >= 2
    assert min(times.values()) >= 2


@pytest.mark.virtual_only("the test changes the storage of the virtual board itself")
def test_a_deletion_that_was_done_and_does_not_show_makes_everything_be_read_again(tmp_path: Path) -> None:
    fake = PipedBoard()
    delete, damaged = fake.storage.delete, [True]

    def damaging(of: AnyType, record_id: int) -> bool:
        if damaged:
            damaged.clear()
            return delete(of, 7)
        return delete(of, record_id)

    setattr(fake.storage, "delete", damaging)  # noqa: B010 - only this board
    assert readings(imported(CHANGED, tmp_path, fake))[0] >= 2


def test_a_list_that_does_not_fit_its_records_is_read_again(tmp_path: Path) -> None:
    async def main() -> None:
        async with opened(fake) as board:
            await plan(board)

    async def plan(board: Board) -> None:
        entries = tuple(ACTION.entries_in(response))
        wrong = msgspec.structs.replace(entries[4], action_caption="Damaged")
        fake.plan(QueryActionListRequest, lie(type(response)((*entries[:4], wrong, *entries[5:]))))
        assert not (await board.plan_project(MANY)).differs

    fake = PipedBoard()
    fake.storage.contents = contents_of(MANY)
    codec, said = fake.codec, list[bytes]()
    fake.attach(said.append).receive(codec.encode(QueryActionListRequest()), 0.0)
    response: Any = codec.decode(30011, said[0][8:-1])
    run(main())
    assert len(fake.sent_of(QueryActionListRequest)) == 3, "until two agree"


@pytest.mark.parametrize("swallowed", [1, 3])
def test_a_write_without_a_response_is_settled_by_its_reading(swallowed: int, tmp_path: Path) -> None:
    fake = PipedBoard()
    fake.plan(AddActionRequest, *[SWALLOWED] * swallowed)
    imported(CHANGED, tmp_path, fake)
    assert len(fake.sent_of(AddActionRequest)) == 1
