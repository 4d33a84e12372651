"""Deadlines: one timer, which a stalled loop cannot deceive and a flood cannot hold up."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from servolink.connection.dispatcher import DeadlineTimer
from tests.client.fake_board import now, turns_of_the_loop
from tests.virtual_time import VirtualTimeLoop, run


class Clock:
    """Deadlines, and when they were said to have passed."""

    def __init__(self) -> None:
        self.received = 0
        self.passed: list[float] = []
        self.received_then: list[int] = []
        self.deadlines = DeadlineTimer(self._note, lambda: self.received)

    def _note(self, now: float) -> None:
        self.passed.append(now)
        self.received_then.append(self.received)


@contextmanager
def line(clock: Clock, piece: int) -> Iterator[socket.socket]:
    """Give the far end of a line from which `clock` receives `piece` bytes in a turn of the loop."""
    near, far = socket.socketpair()
    with near, far:
        near.setblocking(False)
        loop = asyncio.get_running_loop()

        def read() -> None:
            clock.received += len(near.recv(piece))

        loop.add_reader(near, read)
        try:
            yield far
        finally:
            loop.remove_reader(near)


def stall(seconds: float) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.stall(seconds)


def test_a_deadline_passes_exactly_then() -> None:
    async def main() -> None:
        clock, begun = Clock(), now()
        clock.deadlines.arm(begun + 1.5)
        await asyncio.sleep(1.4999)
        assert clock.passed == []
        await asyncio.sleep(1)
        assert clock.passed == [begun + 1.5]

    run(main())


def test_a_timer_that_comes_early_by_what_the_clock_does_not_resolve_is_not_set_again() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop._clock_resolution = 1 / 64  # type: ignore[attr-defined]  # that of Windows
        clock, begun = Clock(), now()
        clock.deadlines.arm(begun + 1.5)
        await asyncio.sleep(1.49)
        await turns_of_the_loop(6)
        assert clock.passed == [begun + 1.5]

    run(main())


def test_the_earliest_of_several_counts() -> None:
    async def main() -> None:
        clock, begun = Clock(), now()
        for seconds in (2, 1, 3):
            clock.deadlines.arm(begun + seconds)
        await asyncio.sleep(5)
        assert clock.passed == [begun + 1]  # who was told arms the next

    run(main())


def test_a_deadline_can_be_set_while_one_is_passing() -> None:
    async def main() -> None:
        clock, begun = Clock(), now()
        clock.deadlines.arm(begun + 1)
        asyncio.get_running_loop().call_at(begun + 1, clock.deadlines.arm, begun + 2)
        await asyncio.sleep(5)
        assert clock.passed == [begun + 1, begun + 2]

    run(main())


def test_none_passes_after_stop_which_may_come_twice() -> None:
    async def main() -> None:
        clock = Clock()
        clock.deadlines.arm(now() + 1)
        clock.deadlines.stop()
        clock.deadlines.stop()
        await asyncio.sleep(5)
        assert clock.passed == []

    run(main())


@pytest.mark.parametrize("piece", [1, 3, 4096])
def test_after_a_stall_all_that_has_arrived_is_read_first(piece: int) -> None:
    async def main() -> None:
        clock = Clock()
        with line(clock, piece) as far:
            clock.deadlines.arm(now() + 1)
            await asyncio.sleep(0.5)
            far.send(bytes(40))
            stall(10)
            await asyncio.sleep(1)
        assert clock.received_then == [40]

    run(main())


def test_a_line_that_never_falls_silent_does_not_put_a_deadline_off_for_ever() -> None:
    async def main() -> None:
        clock = Clock()
        clock.deadlines.arm(now() + 1)
        await asyncio.sleep(1)
        with line(clock, 8) as far:
            for _ in range(10_000):
                if clock.passed:
                    break
                far.send(bytes(8))
                await asyncio.sleep(0)
        assert clock.received > 50 * 8
        assert len(clock.passed) == 1

    run(main())
