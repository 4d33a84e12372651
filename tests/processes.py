"""Programs that tests start and wait for: each leads a session of its own, and nothing of it outlives its test."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

LIMIT = 240.0
"""Seconds after which a program that does not end has failed, however busy the machine is."""

_REAPER = """
import os, signal, sys
groups = set()
for line in iter(sys.stdin.readline, ""):
    (groups.add if line[0] == "+" else groups.discard)(int(line[1:]))
for group in groups:
    try:
        os.killpg(group, signal.SIGKILL)
    except OSError:
        pass
"""
"""Kills the process groups that are left once the tests have ended, even if they were killed themselves."""


class _Sessions:
    """The programs that have not been ended yet."""

    def __init__(self) -> None:
        self._left: dict[int, subprocess.Popen[Any] | None] = {}
        self._reaper: subprocess.Popen[str] | None = None

    def add(self, leader: int, process: subprocess.Popen[Any] | None = None) -> None:
        self._left[leader] = process
        self._tell(f"+{leader}")

    def end(self, leader: int) -> None:
        """Kill what is left of a session."""
        if leader not in self._left:
            return
        with suppress(ProcessLookupError, PermissionError):  # PermissionError: only a zombie is left, on macOS
            os.killpg(leader, signal.SIGKILL)
        if process := self._left.pop(leader):
            process.wait()
            for stream in (process.stdin, process.stdout, process.stderr):
                if stream is not None:
                    with suppress(OSError):  # what was written and never read
                        stream.close()
        self._tell(f"-{leader}")

    @contextmanager
    def ending(self) -> Iterator[None]:
        """End at the end what was started in here."""
        before = set(self._left)
        try:
            yield
        finally:
            for leader in set(self._left) - before:
                self.end(leader)

    def close(self) -> None:
        """End everything."""
        for leader in list(self._left):
            self.end(leader)
        if self._reaper is not None:
            self._reaper.communicate()
            self._reaper = None

    def _tell(self, line: str) -> None:
        if self._reaper is None:
            self._reaper = subprocess.Popen(
                (sys.executable, "-I", "-S", "-c", _REAPER), stdin=subprocess.PIPE, text=True, start_new_session=True
            )
        assert self._reaper.stdin is not None
        print(line, file=self._reaper.stdin, flush=True)


sessions = _Sessions()


def start(command: Sequence[str], **options: Any) -> subprocess.Popen[str]:
    """Start a program that nobody types to, with `options` of Popen; it ends with the test at the latest."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    text = {"encoding": "utf-8", "errors": "surrogateescape"}
    process = subprocess.Popen(command, **{**pipes, **text, **options}, start_new_session=True)
    sessions.add(process.pid, process)
    return process


def finish(
    process: subprocess.Popen[str],
    by: signal.Signals | None = None,
    *,
    typed: str | None = None,
    limit: float = LIMIT,
) -> tuple[str, str]:
    """Wait until a program ends, after sending it a signal or the last it reads; return what it still printed."""
    if by is not None:
        process.send_signal(by)
    try:
        out, err = process.communicate(typed, timeout=limit)
    finally:
        sessions.end(process.pid)
    return out or "", err or ""


def until(holds: Callable[[], object]) -> None:
    """Return when something holds that other programs or threads, or the system, bring about and tell nobody."""
    end = time.monotonic() + LIMIT
    while not holds():
        assert time.monotonic() < end, f"waited {LIMIT:g} s in vain"
        time.sleep(0.01)


def run(
    command: Sequence[str], typed: str | None = None, *, check: bool = False, limit: float = LIMIT, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end."""
    if typed is not None:
        options["stdin"] = subprocess.PIPE
    process = start(command, **options)
    out, err = finish(process, typed=typed, limit=limit)
    assert not check or process.returncode == 0, f"{' '.join(command)} ended with {process.returncode}: {err or out}"
    return subprocess.CompletedProcess(command, process.returncode, out, err)


async def start_async(*command: str, **options: Any) -> asyncio.subprocess.Process:
    """Start a program as `start` does, for tests that run on a loop."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = await asyncio.create_subprocess_exec(*command, **{**pipes, **options}, start_new_session=True)
    sessions.add(process.pid)
    return process
