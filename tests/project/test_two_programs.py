"""Imports to one board from more than one program."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from msgspec.structs import replace

from servolink.client import Board, connect
from servolink.errors import ProjectError
from servolink.project.model import UNFINISHED
from servolink.project.transfer.results import Progress
from servolink.protocol import QueryProjectIDRequest, QueryProjectIDResponse
from servolink.virtual import VirtualTransport
from tests.client.piped_board import PipedBoard, lie
from tests.project.boards import (
    OTHER,
    OTHER_CONTENTS,
    on_fake,
    writing,
)
from tests.project.pulled import NEW, NEW_CONTENTS, OLD_CONTENTS, Make, same
from tests.virtual_time import run


def test_two_programs_that_import_to_one_board_leave_one_project_or_say_that_it_is_unfinished(tmp_path: Path) -> None:
    async def both(turns: int, folder: Path) -> bool:
        """Return whether the first import was still going on when the second began."""
        virtual = Make().board(OLD_CONTENTS, 1)
        lines = [VirtualTransport(virtual), VirtualTransport(virtual)]
        async with connect(lines[0]) as one, connect(lines[1]) as two:
            first = asyncio.ensure_future(one.apply_project(NEW, folder=folder))
            for _ in range(turns):
                await asyncio.sleep(0)
            overlap = not first.done()
            ended = await asyncio.gather(first, two.apply_project(OTHER, folder=folder), return_exceptions=True)
            for error in ended:
                assert not isinstance(error, BaseException) or isinstance(error, ProjectError)
            left = virtual.storage.contents
            assert left.project_id in UNFINISHED or same(left, NEW_CONTENTS) or same(left, OTHER_CONTENTS), turns
            assert (await one.apply_project(NEW, folder=folder)).changed != same(left, NEW_CONTENTS)
        assert same(virtual.storage.contents, NEW_CONTENTS)
        return overlap

    turns = 0
    while run(both(turns, tmp_path / str(turns))):
        turns += 5
    assert turns > 100


def test_an_import_ends_when_another_one_has_put_its_marker_on_the_board(tmp_path: Path) -> None:
    virtual = Make().board(OLD_CONTENTS, 1)

    def tell(progress: Progress) -> None:
        if writing(progress):
            virtual.storage.project_id = UNFINISHED.start + 7

    async def main() -> None:
        async with connect(VirtualTransport(virtual)) as board:
            with pytest.raises(ProjectError, match=r"another program has begun to import to virtual://"):
                await board.apply_project(NEW, folder=tmp_path, on_progress=tell)

    run(main())
    assert virtual.storage.project_id == UNFINISHED.start + 7


def test_an_import_puts_its_marker_back_when_something_else_has_changed_it(tmp_path: Path) -> None:
    virtual = Make().board(OLD_CONTENTS, 1)
    seen: set[int] = set()

    def tell(progress: Progress) -> None:
        if progress.phase == "writing" and progress.done == progress.total - 1:
            seen.add(virtual.storage.project_id)
            virtual.storage.contents = replace(OTHER_CONTENTS, project_id=0)

    async def main() -> None:
        async with connect(VirtualTransport(virtual)) as board:
            with pytest.raises(ProjectError, match="does not accept"):
                await board.apply_project(NEW, folder=tmp_path, on_progress=tell)
            assert await board.has_unfinished_import()

    run(main())
    assert len(seen) == 1
    assert seen == {virtual.storage.project_id}


def test_nothing_is_begun_while_another_program_writes(tmp_path: Path) -> None:
    async def work(board: Board, fake: PipedBoard) -> None:
        fake.plan(QueryProjectIDRequest, *[lie(QueryProjectIDResponse(6))] * 2)
        with pytest.raises(ProjectError, match="another program is writing to the board"):
            await board.apply_project(NEW, folder=tmp_path)

    assert on_fake(work).storage.contents == OLD_CONTENTS
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["begun-fake_board"]
