"""Hosts that import a project and kill themselves at one step of their work with files.

`python -m tests.project.killed` reads lines `URL FOLDER STEP REPLACE`, forks such a host for each, and prints how it
ended. The steps are what the system is asked to do in FOLDER.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from pathlib import Path
from typing import Any

from servolink.client import connect
from tests.project.pulled import NEW

_STEPS = {"open", "os.mkdir", "os.rename", "os.remove"}


class Killer:
    """Kills this process before one step."""

    def __init__(self, folder: Path, step: int) -> None:
        self._folder = str(folder)
        self._left = step

    def install(self) -> None:
        """Watch all that follows."""
        sys.addaudithook(self._hear)
        os.fsync = self._sync

    def _hear(self, event: str, args: tuple[Any, ...]) -> None:
        if event in _STEPS and str(args[0]).startswith(self._folder):
            self._count()

    def _sync(self, fd: Any) -> None:
        self._count()  # and nothing else: what the system has taken outlives a program

    def _count(self) -> None:
        self._left -= 1
        if self._left < 0:
            os.kill(os.getpid(), signal.SIGKILL)


async def main(url: str, folder: Path, replace: bool) -> None:
    """Import."""
    async with connect(url) as board:
        await board.apply_project(NEW, replace=replace, folder=folder)


def status_of(url: str, folder: str, step: str, how: str) -> int:
    """Return how a host ends, as `os.waitpid` has it."""
    host = os.fork()
    if not host:
        Killer(Path(folder), int(step)).install()
        asyncio.run(main(url, Path(folder), how == "replace"))
        os._exit(0)
    return os.waitpid(host, 0)[1]


if __name__ == "__main__":
    for line in sys.stdin:
        print(status_of(*line.split()), flush=True)
