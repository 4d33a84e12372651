"""The host is killed, truly, at each step of its work with files: nothing is lost, and the next run goes on."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sys
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from servolink.client import connect
from servolink.virtual import VirtualTransport, serve
from tests import processes
from tests.project.pulled import NEW, NEW_CONTENTS, OLD, OLD_CONTENTS, Make, has_backup, same, undo
from tests.sampling import every, some

_FARTHEST = 60
"""More steps than there are."""


@asynccontextmanager
async def hosts() -> AsyncIterator[Callable[..., Awaitable[int]]]:
    """Give what lets a host import, killed at one step, and returns the status with which it ends."""
    command = (sys.executable, "-m", "tests.project.killed")
    process = await processes.start_async(*command, cwd=Path(__file__).parents[2], stdin=PIPE, stderr=None)
    assert process.stdin is not None
    assert process.stdout is not None
    asked, told = process.stdin, process.stdout

    async def killed(url: str, folder: Path, step: int, how: str) -> int:
        asked.write(f"{url} {folder} {step} {how}\n".encode())
        return int(await told.readline())

    yield killed
    asked.close()
    await process.wait()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("how", ["differences", "replace"])
@every(13)
def test_a_host_that_is_killed_at_any_file_step_loses_nothing(how: str, step: int, tmp_path: Path) -> None:
    async def main() -> int:
        make = Make()
        async with hosts() as killed:
            for at in some(0, _FARTHEST, step):
                board, folder = make.board(OLD_CONTENTS, 1), tmp_path / str(at)
                folder.mkdir()
                async with serve(board, tcp="127.0.0.1:0") as (url,):
                    status = await killed(url, folder, at, how)
                    if status == 0:
                        assert same(board.storage.contents, NEW_CONTENTS)
                        return at
                    assert os.WTERMSIG(status) == signal.SIGKILL
                left, kept = board.storage.contents, shutil.copytree(folder, tmp_path / f"{at}.kept")
                assert same(left, OLD_CONTENTS) or has_backup(folder, OLD)
                async with connect(VirtualTransport(board, url)) as again:
                    await again.apply_project(NEW, folder=folder)
                assert same(board.storage.contents, NEW_CONTENTS)
                board.storage.contents = left
                async with connect(VirtualTransport(board, url)) as again:
                    await undo(again, kept)
                assert same(board.storage.contents, OLD_CONTENTS)
        raise AssertionError("the import never came to its end")

    assert asyncio.run(main()) > 12
