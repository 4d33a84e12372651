"""The terminal: questions that wait for nobody, and its cursor, whatever ends the process."""

from __future__ import annotations

import asyncio
import io
import os
import sys
import threading
from collections.abc import Callable, Coroutine
from contextlib import AbstractContextManager
from types import SimpleNamespace
from typing import Any

import pytest
from rich.console import Console

from servolink.cli.screen import live
from servolink.cli.screen.terminal import confirm, confirm_motion, end_process, keys_in, wait_for_enter
from servolink.connection import Stats

_BOARD: Any = SimpleNamespace(stats=Stats())
HIDDEN, SHOWN = "\x1b[?25l", "\x1b[?25h"


@pytest.mark.skipif(sys.platform == "win32", reason="a console cannot be waited for there")
@pytest.mark.parametrize("ask", [confirm, confirm_motion, wait_for_enter])
def test_a_question_that_is_left_leaves_no_thread_that_reads(
    ask: Callable[[str], Coroutine[Any, Any, bool]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Python waits for such a thread before it exits, and nothing interrupts it."""
    ours, theirs = os.openpty()

    async def main() -> set[threading.Thread]:
        asking = asyncio.create_task(ask("Really?"))
        for _ in range(3):
            await asyncio.sleep(0)
        asking.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asking
        left = set(threading.enumerate()) - before
        os.write(ours, b"\n")  # for a thread that does read
        return left

    with open(theirs, encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        before = set(threading.enumerate())
        try:
            assert asyncio.run(main()) == set()
        finally:
            os.close(ours)
    assert capsys.readouterr().err.endswith("\n"), "the next message starts a line"


@pytest.mark.skipif(sys.platform == "win32", reason="a console has no other end there")
def test_what_was_typed_before_a_question_about_a_motion_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    ours, theirs = os.openpty()

    async def main() -> bool:
        os.write(ours, b"y\n")  # for an earlier question, which has ended
        asking = asyncio.create_task(confirm_motion("May the robot move?"))
        for _ in range(3):
            await asyncio.sleep(0)
        os.write(ours, b"n\n")
        return await asking

    with open(theirs, encoding="utf-8") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        assert not asyncio.run(main())
    os.close(ours)


@pytest.mark.parametrize(
    "display",
    [live.live_bars, lambda: live.counting("queries", 3), lambda: live.shown_progress(_BOARD)],
    ids=["servos", "measurement", "import"],
)
def test_the_cursor_is_shown_again_by_a_process_that_ends_at_once(
    display: Callable[[], AbstractContextManager[object]], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = io.StringIO()
    monkeypatch.setattr(live, "is_terminal", lambda: True)
    monkeypatch.setattr(live, "console", lambda **_: Console(file=drawn, force_terminal=True, width=80))
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(os, "_exit", lambda code: None)
    with display():
        assert drawn.getvalue().rfind(HIDDEN) > drawn.getvalue().rfind(SHOWN)
        end_process(130)
        assert drawn.getvalue().rfind(SHOWN) > drawn.getvalue().rfind(HIDDEN)  # type: ignore[unreachable]


def test_typed_keys_have_names() -> None:
    typed = "a \r\x1b\t\x1b[A\x1b[B\x1b[D\x1b[C\x1b[1;2D\x1b[1;2C\x1b[15~+"
    wanted = "a space enter esc tab up down left right shift-left shift-right +"
    assert keys_in(typed) == wanted.split(), "keys without a meaning, such as F1, are left out"
    assert keys_in("") == ["esc"], "the terminal is gone"
