"""The other end of a line: a process on another core that answers each request with bytes that it was given."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

from benchmarks.measuring import CORES

_SOURCE = Path(__file__).with_suffix(".c")
_DELAY = int(os.environ.get("RESPONDER_DELAY", "0")) / 1e6  # seconds; of a process that was started here
_FOLDER = tempfile.TemporaryDirectory(prefix="servolink-responder-")

Answers = Mapping[int, bytes] | tuple[int, bytes]
"""By packet id of the request, of frames; or one answer to every so many bytes (0: to every line)."""


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
    """Return the language of the responder."""
    return "Python" if program()[0] == sys.executable else "C"


class Responder:
    """A pseudo-terminal at whose other end requests are answered."""

    def __init__(self, answers: Answers, delay: float = 0.0) -> None:
        """Begin to answer, `delay` seconds after each request, on the first core; those who ask are on the last one."""
        board, self._line = os.openpty()
        tty.setraw(self._line)
        self.path = os.ttyname(self._line)
        """What a client opens."""
        self._process = start(board, answers, delay)
        os.close(board)

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()
        os.close(self._line)


def start(descriptor: int, answers: Answers, delay: float = 0.0) -> subprocess.Popen[bytes]:
    """Answer on a descriptor, which the process inherits, until it ends."""
    environment = {**os.environ, "RESPONDER_DELAY": str(round(delay * 1e6))}
    given = [str(answers[0]), answers[1].hex()] if isinstance(answers, tuple) else _given(answers)
    command = [*program(), str(descriptor), *given]
    process = subprocess.Popen(command, pass_fds=[descriptor], env=environment)  # noqa: S603 - ours
    if CORES:
        os.sched_setaffinity(process.pid, {CORES[0]})
    return process


def _given(answers: Mapping[int, bytes]) -> list[str]:
    return [f"{packet_id}={answer.hex()}" for packet_id, answer in answers.items()]


def _pieces(size: int, answer: bytes) -> Callable[[bytes], bytes]:
    waiting = 0

    def respond(came: bytes) -> bytes:
        nonlocal waiting
        if not size:
            return answer * came.count(b"\n")
        requests, waiting = divmod(waiting + len(came), size)
        return answer * requests

    return respond


def _frames(answers: Mapping[int, bytes]) -> Callable[[bytes], bytes]:
    held = b""

    def respond(came: bytes) -> bytes:
        nonlocal held
        held += came
        found = []
        while len(held) >= 8 and len(held) >= (length := 9 + int.from_bytes(held[6:8], "little")):
            time.sleep(_DELAY)  # for which a board works on each request
            found.append(answers.get(int.from_bytes(held[4:6], "little"), b""))
            held = held[length:]
        return b"".join(found)

    return respond


def _serve(line: int, respond: Callable[[bytes], bytes]) -> None:
    while came := os.read(line, 4096):
        os.write(line, respond(came))


def _pairs(given: list[str]) -> dict[int, bytes]:
    return {int(packet_id): bytes.fromhex(answer) for packet_id, answer in (pair.split("=") for pair in given)}


if __name__ == "__main__":
    if "=" in sys.argv[2]:
        _serve(int(sys.argv[1]), _frames(_pairs(sys.argv[2:])))
    else:
        _serve(int(sys.argv[1]), _pieces(int(sys.argv[2]), bytes.fromhex(sys.argv[3])))
