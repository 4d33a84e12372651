"""A virtual board in a program of its own, which can be killed and started again."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

from tests.processes import finish, start


class BoardProgram:
    """A board at one port of this machine that keeps what it stores in a file."""

    def __init__(self, folder: Path, *options: str) -> None:
        """Start it at a free port. `options` are those of `servolink virtual`."""
        self._options = ("--state", str(folder / "board.state"), *options)
        self._program = self._started(0)

    def kill(self) -> None:
        """Take its power away."""
        finish(self._program, signal.SIGKILL)

    def start(self, *options: str) -> None:
        """Start it again, with what it had stored, and with further options."""
        self._options += options
        self._program = self._started(int(self.url.rpartition(":")[2]))

    def _started(self, port: int) -> subprocess.Popen[str]:
        place = ("--tcp", f"127.0.0.1:{port}")
        program = start([sys.executable, "-m", "servolink", "virtual", *place, *self._options])
        assert program.stdout is not None
        self.url = program.stdout.readline().split()[-1]
        return program
