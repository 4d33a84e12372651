"""Keyboard input, as single keys without echo or as lines, while the event loop keeps running."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress

if sys.platform == "win32":
    import msvcrt
elif sys.platform != "emscripten":
    import termios
    import tty

_LOOK = 0.02  # seconds between polls of a Windows console: no event loop can wait for its keys
_MOST_KEYS = 64  # most keys read in one poll
_ARROWS = {"H": "\x1b[A", "P": "\x1b[B", "M": "\x1b[C", "K": "\x1b[D", "t": "\x1b[1;2C", "s": "\x1b[1;2D"}
"""Escape sequences for the second half of an arrow key in a Windows console.

Ctrl with an arrow is reported as Shift with an arrow, which the console itself never reports.
"""
_INTERRUPT = "\x03"


async def read_line(*, typed_from_now: bool = False) -> str:
    """Return the next line from standard input, a terminal; the last line may have no line end.

    With `typed_from_now`, what was typed before and not read yet is dropped.
    """
    if typed_from_now:
        _forget_typed()
    if sys.platform == "win32":
        return await asyncio.to_thread(sys.stdin.readline)
    else:
        # Not in a thread: a read in a thread cannot be interrupted, and delays the exit of the process.
        loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()
        typed = asyncio.Event()
        loop.add_reader(terminal, typed.set)
        try:
            await typed.wait()
        finally:
            loop.remove_reader(terminal)
        try:
            return os.read(terminal, 4096).decode(errors="replace")  # a terminal returns one line
        except OSError:  # the terminal was closed
            return ""


def _forget_typed() -> None:
    """Drop what was typed and not read yet."""
    if sys.platform == "win32":
        _pressed()
    elif sys.platform != "emscripten":  # no keyboard there
        with suppress(termios.error):  # the terminal was closed
            termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


def begin_keys(typed: Callable[[str], None]) -> Callable[[], None] | None:
    """Call `typed` with each pressed key, without echo, and with an empty text when the keyboard is disconnected.

    Return a function to end these calls; None without a keyboard.
    """
    if sys.stdin is None or not sys.stdin.isatty():
        return None
    if sys.platform == "win32":
        return _poll_console(typed)
    elif sys.platform == "emscripten":
        return None
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
            except OSError:  # the console was closed
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
        """Return the keys pressed since the last poll, encoded as by a terminal."""
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

elif sys.platform != "emscripten":

    def _read_terminal(typed: Callable[[str], None]) -> Callable[[], None] | None:
        loop, terminal = asyncio.get_running_loop(), sys.stdin.fileno()
        try:
            if (
                os.tcgetpgrp(terminal) != os.getpgrp()
            ):  # the system stops a background process when reading from a terminal
                return None
        except OSError:  # standard input belongs to no terminal of the process
            return None

        def read() -> None:
            try:
                data = os.read(terminal, 1024)
            except OSError:
                data = b""
            if not data:  # the terminal was closed
                loop.remove_reader(terminal)
            typed(data.decode(errors="replace"))

        def end() -> None:
            with suppress(termios.error):  # the terminal may be closed already
                termios.tcsetattr(terminal, termios.TCSANOW, before)
            loop.remove_reader(terminal)

        before = termios.tcgetattr(terminal)
        tty.setcbreak(terminal)
        loop.add_reader(terminal, read)
        return end
