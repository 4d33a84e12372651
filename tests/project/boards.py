"""Boards for the tests of imports: virtual ones, and those of which tests plan the answers."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from servolink.client import Board, connect
from servolink.project.model import UNFINISHED
from servolink.project.transfer.results import Progress, ProgressCallback
from servolink.virtual import Contents, VirtualBoard, VirtualTransport
from tests.client.piped_board import PipedBoard, opened
from tests.project.pulled import NEW, OLD, OLD_CONTENTS, Make, contents_of
from tests.virtual_time import run

OTHER = msgspec.structs.replace(OLD, project_id=5, actions=OLD.actions[:1])
OTHER_CONTENTS = contents_of(OTHER)
HERE, THERE = "virtual://here", "virtual://there"


async def stopped(
    begin: Callable[[ProgressCallback], Coroutine[Any, Any, object]], when: Callable[[Progress], bool]
) -> None:
    """Begin something and cancel it at the moment of which it is told."""

    def tell(progress: Progress) -> None:
        if when(progress):
            task.cancel()

    task = asyncio.ensure_future(begin(tell))
    with pytest.raises(asyncio.CancelledError):
        await task


async def stopped_import(
    board: Board, folder: Path, when: Callable[[Progress], bool], *, replace: bool = False
) -> None:
    """Begin to import NEW and cancel it."""
    await stopped(lambda tell: board.apply_project(NEW, folder=folder, on_progress=tell, replace=replace), when)


def writing(progress: Progress) -> bool:
    """Return whether half of it is written."""
    return progress.phase == "writing" and 2 * progress.done >= progress.total


def clearing(progress: Progress) -> bool:
    """Return whether everything is about to be deleted."""
    return progress.phase == "clearing"


def unfinished(contents: Contents = OLD_CONTENTS) -> Contents:
    """Return the contents of a board on which another computer has begun an import."""
    return replace(contents, project_id=UNFINISHED.start + 7)


async def cleared(virtual: VirtualBoard, folder: Path, url: str = HERE) -> None:
    """Interrupt an import of NEW when everything, the project id too, has just been deleted."""
    async with connect(VirtualTransport(virtual, url)) as board:
        task = asyncio.ensure_future(board.apply_project(NEW, replace=True, folder=folder))
        while virtual.storage.project_id:
            await asyncio.sleep(0)
        task.cancel()
    assert virtual.storage.contents.size == 0


def on_board(work: Any, contents: Contents = OLD_CONTENTS, make: Make | None = None, **options: Any) -> Contents:
    """Let `work` use a connected board; return what the board holds then."""

    async def main() -> Contents:
        virtual = (make or Make()).board(contents, 1)
        async with connect(VirtualTransport(virtual), **options) as board:
            await work(board)
        return virtual.storage.contents

    return run(main())


def on_fake(work: Any, **options: Any) -> PipedBoard:
    """Let `work` use a connected fake board, which has OLD stored."""
    fake = PipedBoard(servos=3)
    fake.storage.contents = OLD_CONTENTS

    async def main() -> None:
        async with opened(fake, **options) as board:
            await work(board, fake)

    run(main())
    return fake
