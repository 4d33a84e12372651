"""The terminal: questions, single keys, signals, and its state before and after."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import NoReturn

from servolink.cli.output import print_error
from servolink.escaping import escape

_cleanups: list[Callable[[], object]] = []


@contextmanager
def cleanup(act: Callable[[], object]) -> Iterator[None]:
    """Call `act` at the end, also when the process ends at once (see `end_process`)."""
    _cleanups.append(act)
    try:
        yield
    finally:
        _cleanups.remove(act)
        act()


def end_process(code: int) -> NoReturn:
    """End the process without waiting for anything but the calls promised by `cleanup`."""
    for act in reversed(_cleanups):
        with suppress(Exception):  # the terminal may be gone
            act()
    os._exit(code)


def can_ask() -> bool:
    """Return whether somebody can be asked: standard input and standard error are a terminal."""
    return bool(sys.stdin and sys.stdin.isatty() and sys.stderr and sys.stderr.isatty())


async def confirm(question: str) -> bool:
    """Ask `question` on standard error and return whether the answer is yes; Ctrl-D is a no.

    Call it only if `can_ask()`. The loop and signals keep working meanwhile.
    """
    print(f"{escape(question)} [y/N] ", end="", file=sys.stderr, flush=True)
    try:
        answer = await _line()
    except asyncio.CancelledError:
        print_error("")  # the next message starts a line
        raise
    if not answer.endswith("\n"):
        print_error("")
    return answer.strip().lower() in ("y", "yes")


async def wait_for_enter(request: str) -> bool:
    """Print `request` on standard error and return whether Enter alone was pressed; Ctrl-D is a no.

    Call it only if `can_ask()`.
    """
    print(escape(request), end="", file=sys.stderr, flush=True)
    return await _line() == "\n"


async def _line() -> str:
    if sys.platform == "win32":
        return await asyncio.to_thread(sys.stdin.readline)
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


@contextmanager
def single_keys(typed: Callable[[str], None]) -> Iterator[bool]:
    """Call `typed` with each key, without echo. Yield False, and call nothing, if there is no keyboard to read."""
    terminal = _own_terminal()
    if sys.platform == "win32" or terminal is None:
        yield False
        return
    import termios
    import tty

    loop = asyncio.get_running_loop()

    def read() -> None:
        try:
            data = os.read(terminal, 1024)
        except OSError:
            data = b""
        if not data:  # the terminal is gone
            loop.remove_reader(terminal)
        typed(data.decode(errors="replace"))

    before = termios.tcgetattr(terminal)

    def restore() -> None:
        with suppress(termios.error):  # it may be gone
            termios.tcsetattr(terminal, termios.TCSANOW, before)

    with cleanup(restore):
        tty.setcbreak(terminal)
        loop.add_reader(terminal, read)
        try:
            yield True
        finally:
            loop.remove_reader(terminal)


_KEY = re.compile(r"\x1b[\[O][0-9;]*[A-Za-z~]|.", re.DOTALL)
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left", "1;2C": "shift-right", "1;2D": "shift-left"}
_NAMES = {"\x1b": "esc", "\r": "enter", "\n": "enter", "\t": "tab", " ": "space"}


def keys_in(text: str) -> list[str]:
    """Return the keys of a text that `single_keys` passed on: characters, and names such as `up`, `enter` and `esc`.

    Other keys that are typed as several characters are left out. A terminal that is gone counts as `esc`.
    """
    keys = [_NAMES.get(one, one) if len(one) == 1 else _ARROWS.get(one[2:], "") for one in _KEY.findall(text)]
    return [key for key in keys if key] if text else ["esc"]


def _own_terminal() -> int | None:
    """Return standard input if it is a terminal with this process in its foreground.

    A background process that reads from a terminal is stopped.
    """
    if sys.platform == "win32" or sys.stdin is None:
        return None
    try:
        descriptor = sys.stdin.fileno()
        return descriptor if os.tcgetpgrp(descriptor) == os.getpgrp() else None
    except OSError:  # no terminal, or not ours
        return None


ENDING = (signal.SIGINT, signal.SIGTERM) if sys.platform == "win32" else (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, `kill` and, except on Windows, a closed terminal."""


def not_ignored(numbers: Sequence[signal.Signals] = ENDING) -> list[signal.Signals]:
    """Return the signals that are not ignored: `nohup` and background jobs start programs with some that are."""
    return [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]


@contextmanager
def handled(
    act: Callable[[], object],
    numbers: Sequence[signal.Signals] = ENDING,
    *,
    again: Callable[[], object] | None = None,
) -> Iterator[None]:
    """Call `act` on the running loop for each signal that arrives meanwhile; ignored signals stay ignored.

    With `again`, call `act` for the first signal only, and `again` for further ones: at once, even if the loop is busy.
    """
    loop = asyncio.get_running_loop()
    before = {number: signal.getsignal(number) for number in not_ignored(numbers)}
    received = False

    def receive(*_: object) -> None:
        nonlocal received
        if received and again is not None:
            again()
        received = True
        loop.call_soon_threadsafe(act)

    for number in before:
        signal.signal(number, receive)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
