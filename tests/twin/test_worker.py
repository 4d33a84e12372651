"""The process with the physics: jobs take turns, errors come back, and it starts again after its end.

Module: servolink.twin.worker.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import aclosing
from pathlib import Path
from typing import Any

import pytest

from servolink.errors import ProjectError, TwinError
from servolink.twin import worker as worker_module
from servolink.twin.worker import NICENESS, Worker


def count(until: int) -> Iterator[int]:
    yield from range(until)


def niceness() -> int:
    """Return the niceness of this process, 0 where the system has none."""
    return os.nice(0) if hasattr(os, "nice") else 0


def facts() -> Iterator[tuple[int, int]]:
    yield os.getpid(), niceness()


def work_for_ever(begun: Path) -> Iterator[int]:
    yield os.getpid()
    begun.open("wb").close()
    while True:
        pass


def refuse() -> Iterator[int]:
    yield 1
    raise ProjectError("macro 1 'M': runs itself")


def test_jobs_take_turns_and_their_errors_come_back() -> None:
    async def main() -> None:
        worker = Worker()
        said = list[str]()

        async def note(name: str, until: int, *, is_background: bool = False) -> None:
            async for piece in worker.run(count, until, is_background=is_background):
                said.append(f"{name}{piece}")

        try:
            ((process, found_niceness),) = [found async for found in worker.run(facts)]
            assert process != os.getpid()
            if hasattr(os, "nice"):
                assert found_niceness == min(19, niceness() + NICENESS)
            await asyncio.gather(note("b", 3, is_background=True), note("a", 3))
            assert sorted(said) == ["a0", "a1", "a2", "b0", "b1", "b2"]
            assert said.index("a2") < said.index("b1"), "the background waits"
            found: list[Any] = []
            with pytest.raises(ProjectError, match="runs itself"):
                found += [piece async for piece in worker.run(refuse)]
            async with aclosing(worker.run(count, 10**9)) as endless:
                assert await anext(endless) == 0
                os.kill(process, signal.SIGTERM)
                with pytest.raises(TwinError, match="was ended"):
                    _ = [piece async for piece in endless]
            ((other, _),) = [found async for found in worker.run(facts)]
            assert other != process
        finally:
            await worker.close()
        assert os.waitpid(other, 0)[1] == 0, "it ends with the pipe"

    asyncio.run(main())


@pytest.mark.skipif(sys.platform == "win32", reason="needs a named pipe")
def test_the_end_of_the_program_ends_a_piece_that_takes_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker_module, "_PATIENCE", 0.05)
    begun = tmp_path / "begun"
    os.mkfifo(begun)

    async def main() -> None:
        worker = Worker()
        async with asyncio.timeout(60), aclosing(worker.run(work_for_ever, begun)) as endless:
            process = await anext(endless)
            waiting = asyncio.ensure_future(anext(endless))
            await asyncio.to_thread(begun.read_bytes)
            await worker.close()
            with pytest.raises(TwinError, match="was ended"):
                await waiting
        assert os.waitpid(process, 0)[1] == signal.SIGTERM

    asyncio.run(main())
