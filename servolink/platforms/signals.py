"""Termination signals, and their delivery to any kind of event loop."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

if sys.platform == "win32":
    ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)
    """Ctrl-C, termination by another program, and a closed console."""
    SAVING: tuple[signal.Signals, ...] = ()
    """Signals to save the ring of a recorder: no signal on Windows."""
    WAIT: float | None = 0.1
    """Longest wait for a thread, in seconds: on Windows, Ctrl-C does not interrupt such a wait."""
else:
    ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    """Ctrl-C, `kill` and a closed terminal."""
    SAVING: tuple[signal.Signals, ...] = (signal.SIGUSR1,)
    """Signals to save the ring of a recorder."""
    WAIT: float | None = None
    """Longest wait for a thread, in seconds; None for no limit."""


def not_ignored(numbers: Sequence[signal.Signals] = ENDING) -> list[signal.Signals]:
    """Return the signals not ignored by the process; `nohup` and background jobs ignore some signals."""
    return [number for number in numbers if signal.getsignal(number) is not signal.SIG_IGN]


@contextmanager
def handled(
    act: Callable[[], object],
    numbers: Sequence[signal.Signals] = ENDING,
    *,
    again: Callable[[], object] | None = None,
) -> Iterator[None]:
    """Call `act` on the running loop for each signal inside the context; ignored signals stay ignored.

    With `again`, call `act` for the first signal only, and `again` for later signals, even while the loop is busy.
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

    for number in before:  # not with add_signal_handler, absent on Windows
        signal.signal(number, receive)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
