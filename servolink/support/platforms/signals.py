"""Termination signals, and their delivery to any kind of event loop."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum

WAIT = 0.1 if sys.platform == "win32" else None
"""Longest wait for a thread, in seconds, as Ctrl-C does not interrupt such a wait on Windows; None for no limit."""


_Numbers = tuple[signal.Signals, ...]

if sys.platform == "win32":
    _ENDING: _Numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)
    _SAVING: _Numbers = ()
else:
    _ENDING: _Numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    _SAVING: _Numbers = (signal.SIGUSR1,)


class Signals(Enum):
    """Signals for one purpose."""

    ENDING = _ENDING
    """Ctrl-C, termination by another program, and a closed terminal."""
    SAVING = _SAVING
    """Signal to save the ring of a recorder; no signal on Windows."""

    def not_ignored(self) -> list[signal.Signals]:
        """Return the signals not ignored by the process; `nohup` and background jobs ignore some signals."""
        return [number for number in self.value if signal.getsignal(number) is not signal.SIG_IGN]

    @contextmanager
    def handled(self, act: Callable[[], object], *, again: Callable[[], object] | None = None) -> Iterator[None]:
        """Call `act` on the running loop for each signal inside the context; ignored signals stay ignored.

        With `again`, call `act` for the first signal only, and `again` for later signals, even while the loop is busy.
        """
        loop = asyncio.get_running_loop()
        before = {number: signal.getsignal(number) for number in self.not_ignored()}
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
