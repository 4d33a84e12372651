"""Virtual time for the tests of servolink itself."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

from servolink.testing import VirtualTimeLoop, run

__all__ = ["VirtualClock", "VirtualTimeLoop", "run"]

T = TypeVar("T")


class VirtualClock:
    """Virtual time that goes on from one loop to the next, for commands that run one after the other."""

    def __init__(self) -> None:
        self.now = 1000.0
        """Seconds at the end of the latest loop."""

    def run(self, main: Coroutine[Any, Any, T]) -> T:
        """Stand in for `asyncio.run`."""
        with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
            loop = runner.get_loop()
            assert isinstance(loop, VirtualTimeLoop)
            loop.now = self.now
            try:
                return runner.run(main)
            finally:
                self.now = loop.now
