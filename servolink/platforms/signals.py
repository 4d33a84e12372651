"""Signals that end programs, and their way into an event loop of any kind."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

if sys.platform == "win32":
    ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)
    """Ctrl-C, an end asked for by another program, and a closed console."""
    SAVING: tuple[signal.Signals, ...] = ()
    """Signals that save the ring of a recorder; Windows has none."""
    WAIT: float | None = 0.1
    """Seconds that one wait for a thread may take, as Ctrl-C does not interrupt such a wait on Windows."""
else:
    ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    """Ctrl-C, `kill` and a closed terminal."""
    SAVING: tuple[signal.Signals, ...] = (signal.SIGUSR1,)
    """Signals that save the ring of a recorder."""
    WAIT: float | None = None
    """Seconds that one wait for a thread may take; None for no limit."""


def not_ignored(numbers: Sequence[signal.Signals] = ENDING) -> list[signal.Signals]:
    """Return the signals that are not ignored; `nohup` and background jobs ignore some."""
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

    for number in before:  # not with add_signal_handler, which Windows has not
        signal.signal(number, receive)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
