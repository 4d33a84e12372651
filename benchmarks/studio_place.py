"""Where the studio is measured: a virtual board, a studio in a process of its own, and Chromium."""

from __future__ import annotations

import json
import os
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TypeAlias

from servolink.boards import hubs

_BROWSER = ["--no-sandbox", "--disable-quic", "--disable-background-networking", "--disable-gpu", "--disable-3d-apis"]
_PROBE = Path(__file__).with_name("studio_probe.js")
_WINDOW = {"width": 1440, "height": 900}
_TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100

Seen: TypeAlias = tuple[float, dict[int, int]]
"""The clock when the board was moved, and the targets; none if it was stopped."""


class Place:
    """A studio that runs, and what its board is sent."""

    def __init__(self, program: subprocess.Popen[str], url: str, seen: queue.SimpleQueue[Seen]) -> None:
        """Measure this program, which serves at `url`."""
        self.url = url
        self.seen = seen
        self._process = Path("/proc", str(program.pid))

    @property
    def origin(self) -> str:
        """The address of the page without the token."""
        return self.url.partition("/#")[0]

    @property
    def token(self) -> str:
        """The secret that lets a page do everything."""
        return self.url.partition("token=")[2]

    def cpu(self) -> float:
        """Return the seconds of CPU that the program has used."""
        user, system = (self._process / "stat").read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / _TICKS

    def memory(self) -> float:
        """Return the MB that the program has in memory."""
        found = re.search(r"VmRSS:\s+(\d+)", (self._process / "status").read_text())
        return int(found[1]) * 1024 / 1e6 if found else 0.0

    def seen_until_now(self) -> list[Seen]:
        """Return what the board was sent since the last call."""
        return [self.seen.get() for _ in range(self.seen.qsize())]


@contextmanager
def studio() -> Iterator[Place]:
    """Run a studio, which shares a virtual board in another process; both end with the block."""
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="servolink-studio-"))
        for name in ("XDG_RUNTIME_DIR", "XDG_DATA_HOME", "XDG_CONFIG_HOME"):
            stack.enter_context(_set(name, folder))
        board = stack.enter_context(started("benchmarks.studio_board"))
        address = json.loads(_line(board))
        seen: queue.SimpleQueue[Seen] = queue.SimpleQueue()
        listener = threading.Thread(target=_listen, args=(board, seen))
        listener.start()
        stack.callback(listener.join)
        stack.callback(board.terminate)  # ends the listener
        program = stack.enter_context(started("servolink", "--board", address, "studio", "--no-browser"))
        yield Place(program, address_of(program), seen)


@contextmanager
def started(module: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a module in a process of its own, which ends with the block."""
    command = [sys.executable, "-m", module, *arguments]
    with subprocess.Popen(  # noqa: S603 - our own program
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as program:
        try:
            yield program
        finally:
            program.terminate()


def address_of(program: subprocess.Popen[str]) -> str:
    """Return the address that a studio prints."""
    return _line(program).split()[1]


def shared_board() -> str:
    """Return the address at which other programs find the board."""
    return next(iter(hubs.candidates())).url


@contextmanager
def chromium() -> Iterator[Any]:
    """Run Chromium. Raise ImportError without Playwright, RuntimeError without Chromium."""
    from playwright.sync_api import sync_playwright

    found = shutil.which("chromium") or shutil.which("google-chrome")
    if found is None:
        raise RuntimeError("Chromium is not installed")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=_BROWSER)
        yield browser
        browser.close()


@contextmanager
def page_of(browser: Any, url: str) -> Iterator[Any]:
    """Open the studio in a page with the probe, and wait until it shows the servos."""
    page = browser.new_page(viewport=_WINDOW, locale="en-GB")
    page.add_init_script(path=_PROBE)
    page.goto(url)
    page.locator(".sv").first.wait_for()
    yield page
    page.close()


def _line(program: subprocess.Popen[str]) -> str:
    assert program.stdout is not None  # noqa: S101 - it is a pipe
    return program.stdout.readline()


def _listen(board: subprocess.Popen[str], seen: queue.SimpleQueue[Seen]) -> None:
    while line := _line(board):
        time, targets = json.loads(line)
        seen.put((time, {int(servo_id): angle for servo_id, angle in targets.items()}))


@contextmanager
def _set(name: str, value: str) -> Iterator[None]:
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
