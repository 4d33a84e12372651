"""Timers for times that have passed, which the event loop of Pyodide refuses."""

from __future__ import annotations

import asyncio
import sys
from typing import Any

import pytest

from servolink.support.platforms.timers import call_at
from tests.virtual_time import VirtualTimeLoop


class PyodideLoop(VirtualTimeLoop):
    """An event loop whose time moves on with each look at it, and which refuses times that have passed."""

    def time(self) -> float:
        self.now += 1e-6
        return self.now

    def call_later(  # type: ignore[override]
        self, delay: float, callback: Any, *args: Any, **options: Any
    ) -> asyncio.TimerHandle:
        if delay < 0:
            raise ValueError("Can't schedule in the past")
        return super().call_at(self.now + delay, callback, *args, **options)

    def call_at(  # type: ignore[override]
        self, when: float, callback: Any, *args: Any, **options: Any
    ) -> asyncio.TimerHandle:
        return self.call_later(when - self.time(), callback, *args, **options)


@pytest.mark.parametrize(("system", "loop"), [(sys.platform, VirtualTimeLoop), ("emscripten", PyodideLoop)])
def test_timers_end_at_their_times_and_those_that_have_passed_at_once(
    system: str, loop: type[VirtualTimeLoop], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", system)
    called: list[tuple[str, float]] = []

    async def main() -> None:
        running = asyncio.get_running_loop()
        began = running.time()

        def call(name: str) -> None:
            called.append((name, round(running.time() - began, 2)))

        call_at(running, began + 0.5, call, "later")
        call_at(running, began, call, "now")
        call_at(running, began - 5, call, "before")
        call_at(running, began + 0.2, call, "cancelled").cancel()
        await asyncio.sleep(1)

    with asyncio.Runner(loop_factory=loop) as runner:
        runner.run(main())
    assert sorted(called) == [("before", 0), ("later", 0.5), ("now", 0)]
