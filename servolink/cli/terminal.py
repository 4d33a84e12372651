"""Single keys, while standard input is a terminal that is ours."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress


@contextmanager
def single_keys(typed: Callable[[str], None]) -> Iterator[bool]:
    """Call `typed` with what is typed, at once and unseen; yield False where there is no keyboard to read from."""
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
    tty.setcbreak(terminal)
    loop.add_reader(terminal, read)
    try:
        yield True
    finally:
        loop.remove_reader(terminal)
        with suppress(termios.error):  # it may be gone
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)


def _own_terminal() -> int | None:
    """Return standard input if it is a terminal with us in front; in the background reading it would stop us."""
    if sys.platform == "win32" or sys.stdin is None:
        return None
    try:
        descriptor = sys.stdin.fileno()
        return descriptor if os.tcgetpgrp(descriptor) == os.getpgrp() else None
    except OSError:  # no terminal, or not ours
        return None


ENDING = (signal.SIGINT, signal.SIGTERM) if sys.platform == "win32" else (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C, `kill` and, where there is such a thing, a closed terminal."""


def not_ignored(numbers: Sequence[signal.Signals] = ENDING) -> list[signal.Signals]:
    """Return the signals that are not ignored: `nohup` and background jobs start programs with some that are."""
    return [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]


@contextmanager
def handled(act: Callable[[], object], numbers: Sequence[signal.Signals] = ENDING) -> Iterator[None]:
    """Call `act` on the running loop for each signal that arrives meanwhile; ignored signals stay ignored."""
    loop = asyncio.get_running_loop()
    before = {number: signal.getsignal(number) for number in not_ignored(numbers)}
    for number in before:
        signal.signal(number, lambda *_: loop.call_soon_threadsafe(act))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
