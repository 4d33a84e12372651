"""The keyboard: single keys without echo, and lines, while an event loop goes on."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress

if sys.platform == "win32":
    import msvcrt
else:
    import termios
    import tty

_LOOK = 0.02  # seconds between looks at the keys of a Windows console, for which no event loop can wait
_MOST_KEYS = 64  # at one look
_ARROWS = {"H": "\x1b[A", "P": "\x1b[B", "M": "\x1b[C", "K": "\x1b[D", "t": "\x1b[1;2C", "s": "\x1b[1;2D"}
"""Escape sequences for the second half of an arrow key in a Windows console.

Ctrl with an arrow becomes Shift with it, which the console does not report.
"""
_INTERRUPT = "\x03"


async def read_line() -> str:
    """Return the next line from standard input, which must be a terminal; without a line end at the end of input."""
    if sys.platform == "win32":
        return await asyncio.to_thread(sys.stdin.readline)
    else:
        # Not in a thread: nothing interrupts its read, and the process waits for the thread before it exits.
        loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()
        typed = asyncio.Event()
        loop.add_reader(terminal, typed.set)
        try:
            await typed.wait()
        finally:
            loop.remove_reader(terminal)
        try:
            return os.read(terminal, 4096).decode(errors="replace")  # a terminal returns one line
        except OSError:  # it is gone
            return ""


def begin_keys(typed: Callable[[str], None]) -> Callable[[], None] | None:
    """Call `typed` with each pressed key, without echo, and with an empty text when the keyboard is gone.

    Return a function that ends these calls; None without a keyboard.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        return None
    if sys.platform == "win32":
        return _poll_console(typed)
    else:
        return _read_terminal(typed)


if sys.platform == "win32":

    def _poll_console(typed: Callable[[str], None]) -> Callable[[], None]:
        loop = asyncio.get_running_loop()
        timer: asyncio.TimerHandle

        def look() -> None:
            nonlocal timer
            try:
                text = _pressed()
            except OSError:  # the console is gone
                typed("")
                return
            timer = loop.call_later(_LOOK, look)
            if text:
                typed(text)

        def end() -> None:
            timer.cancel()

        timer = loop.call_later(0, look)
        return end

    def _pressed() -> str:
        """Return the keys that were pressed since the last look, as a terminal would type them."""
        keys = ""
        for _ in range(_MOST_KEYS):
            if not msvcrt.kbhit():
                break
            key = msvcrt.getwch()
            if key in {"\x00", "\xe0"} and msvcrt.kbhit():  # without a second half, \xe0 is the letter à
                key = _ARROWS.get(msvcrt.getwch(), "")
            keys += key
        if _INTERRUPT in keys:  # pressed while a key was read; a signal otherwise
            signal.raise_signal(signal.SIGINT)
        return keys.replace(_INTERRUPT, "")

else:

    def _read_terminal(typed: Callable[[str], None]) -> Callable[[], None] | None:
        loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()
        try:
            if os.tcgetpgrp(terminal) != os.getpgrp():  # a background process that reads from a terminal is stopped
                return None
        except OSError:  # standard input is not the terminal of this process
            return None

        def read() -> None:
            try:
                data = os.read(terminal, 1024)
            except OSError:
                data = b""
            if not data:  # the terminal is gone
                loop.remove_reader(terminal)
            typed(data.decode(errors="replace"))

        def end() -> None:
            with suppress(termios.error):  # it may be gone
                termios.tcsetattr(terminal, termios.TCSANOW, before)
            loop.remove_reader(terminal)

        before = termios.tcgetattr(terminal)
        tty.setcbreak(terminal)
        loop.add_reader(terminal, read)
        return end
