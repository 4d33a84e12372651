"""Event loop in real time for Pyodide: what `asyncio.run` and `asyncio.Runner` take there in the tests.

That of Pyodide is the loop of JavaScript, which goes on only when Python has returned, while a test runs its loop to
the end.
"""

from __future__ import annotations

import asyncio
import selectors
import time
import warnings

from servolink.testing import VirtualTimeLoop


class PlainLoop(VirtualTimeLoop):
    """Loop without sockets that waits for its timers."""

    def __init__(self) -> None:
        super().__init__(lambda _: selectors.DefaultSelector())

    def time(self) -> float:
        """Return the time of the system in seconds."""
        return time.monotonic()


def install() -> None:
    """Replace the loop of JavaScript, which counts as running from the start."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # nothing else tells `asyncio.Runner` which loop to make

        class Policy(asyncio.DefaultEventLoopPolicy):
            """Maker of plain loops."""

            _loop_factory = PlainLoop

        asyncio.set_event_loop_policy(Policy())
    asyncio.run = asyncio.runners.run
    asyncio._set_running_loop(None)
