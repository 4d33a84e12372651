"""The other end of a pseudo-terminal: a process on another core that answers each request with the same bytes."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import tty
from collections.abc import Callable
from functools import cache
from pathlib import Path

from benchmarks.measuring import CORES

_SOURCE = Path(__file__).with_suffix(".c")
_FOLDER = tempfile.TemporaryDirectory(prefix="servolink-responder-")


@cache
def program() -> list[str]:
    """Return the command of the responder: in C where a compiler is found, in Python where not."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        return [sys.executable, __file__]
    compiled = Path(_FOLDER.name, "responder")
    subprocess.run([compiler, "-O2", "-o", compiled, _SOURCE], check=True)  # noqa: S603 - our own source
    return [str(compiled)]


def language() -> str:
    """Return what the responder is written in."""
    return "Python" if program()[0] == sys.executable else "C"


class Responder:
    """A pseudo-terminal at whose other end each request of `size` bytes (0: each line) is answered by `answer`."""

    def __init__(self, size: int, answer: bytes) -> None:
        """Begin to answer, on the first core; those who ask are on the last one."""
        board, self._line = os.openpty()
        tty.setraw(self._line)
        self.path = os.ttyname(self._line)
        """What a client opens."""
        command = [*program(), str(board), str(size), answer.hex()]
        self._process = subprocess.Popen(command, pass_fds=[board])  # noqa: S603 - our own program
        if CORES:
            os.sched_setaffinity(self._process.pid, {CORES[0]})
        os.close(board)

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        os.close(self._line)


def _requests(size: int) -> Callable[[bytes], int]:
    """Return what tells how many requests are complete with the next bytes."""
    waiting = 0

    def complete(came: bytes) -> int:
        nonlocal waiting
        if not size:
            return came.count(b"\n")
        requests, waiting = divmod(waiting + len(came), size)
        return requests

    return complete


def _respond(line: int, size: int, answer: bytes) -> None:
    complete = _requests(size)
    while came := os.read(line, 4096):
        for _ in range(complete(came)):
            os.write(line, answer)


if __name__ == "__main__":
    _respond(int(sys.argv[1]), int(sys.argv[2]), bytes.fromhex(sys.argv[3]))
