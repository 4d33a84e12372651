"""Timers that keep a board going."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from contextvars import Context
from typing import TypeVarTuple

from servolink.protocol import ButtonEventResponse
from servolink.virtual.board import VirtualBoard
from servolink.virtual.transport import BoardDriver
from tests.virtual.host import Host
from tests.virtual_time import VirtualTimeLoop

Ts = TypeVarTuple("Ts")


class EarlyLoop(VirtualTimeLoop):
    """Timers fire a microsecond early, as real ones may; counts them."""

    timers = 0

    def call_at(
        self, when: float, callback: Callable[[*Ts], object], *args: *Ts, context: Context | None = None
    ) -> asyncio.TimerHandle:
        self.timers += 1
        assert self.timers < 100, "it sets timers without end"
        return super().call_at(when - 1e-6, callback, *args, context=context)


def _run(main: Callable[[EarlyLoop], Coroutine[None, None, None]]) -> None:
    loop = EarlyLoop()
    with asyncio.Runner(loop_factory=lambda: loop) as runner:
        runner.run(main(loop))


def test_a_timer_that_fires_early_does_what_was_due() -> None:
    async def main(loop: EarlyLoop) -> None:
        board = VirtualBoard()
        host = Host(board)
        host.session.subscribed = True
        driver = BoardDriver(board)
        board.press_button(1, loop.time())
        await asyncio.sleep(1)
        assert host.heard == [
            ButtonEventResponse(1, ButtonEventResponse.PRESS),
            ButtonEventResponse(1, ButtonEventResponse.LONG_PRESS),
        ]
        driver.stop()

    _run(main)


def test_stopped_it_sets_no_more_timers() -> None:
    async def main(loop: EarlyLoop) -> None:
        board = VirtualBoard()
        driver = BoardDriver(board)
        board.press_button(1, loop.time())
        driver.stop()
        before = loop.timers
        board.release_button(1, loop.time())
        board.press_button(1, loop.time())
        assert loop.timers == before > 0
        assert board.next_due(loop.time()) is not None

    _run(main)
