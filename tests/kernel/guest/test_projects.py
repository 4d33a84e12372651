"""Whole projects over the kernel's real drivers, with the board pulled out in the middle."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest

import servolink
from servolink.project import Progress
from servolink.virtual import BoardKind, VirtualBoard
from tests.kernel.guest.plug import Plug, board_use
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, same

pytestmark = pytest.mark.timeout(180)
RECORD_TYPES = pytest.mark.parametrize("kind", ["serial", "hid", "usb"])
PATIENCE = 30.0  # seconds for an answer in this slow machine


@pytest.fixture
def virtual() -> VirtualBoard:
    board = VirtualBoard(servos=3, kind=BoardKind(on_duplicate="reject", partial_writes=True, bus_powered=True))
    board.storage.contents = OLD_CONTENTS
    return board


@pytest.fixture
def plug(virtual: VirtualBoard) -> Iterator[Plug]:
    with Plug(board_use(virtual)) as plug:
        yield plug


@RECORD_TYPES
def test_a_project_survives_the_board_being_pulled_out(
    plug: Plug, virtual: VirtualBoard, kind: str, tmp_path: Path
) -> None:
    async def begin() -> None:
        def tell(progress: Progress) -> None:
            if progress.phase == "writing" and progress.done == progress.total // 2:
                plug.pull()

        async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
            assert await board.export_project() == OLD
            await board.apply_project(NEW, folder=tmp_path, on_progress=tell)

    async def go_on() -> None:
        async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
            assert await board.has_unfinished_import()
            assert (await board.apply_project(NEW, folder=tmp_path)).resumed
            assert not (await board.plan_project(NEW)).changes

    async def go_back() -> None:
        async with servolink.connect(plug.url(kind), patience=PATIENCE) as board:
            await board.rollback_project(folder=tmp_path)

    with pytest.raises(servolink.ConnectionLost):
        asyncio.run(begin())
    plug.unplug()
    plug.plug_in()
    asyncio.run(go_on())
    assert same(virtual.storage.contents, NEW_CONTENTS)
    asyncio.run(go_back())
    assert same(virtual.storage.contents, OLD_CONTENTS)
