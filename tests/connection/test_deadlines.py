"""Deadlines: one timer, which a stalled loop cannot deceive and a flood cannot hold up."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from servolink.connection import deadlines
from servolink.connection.deadlines import DeadlineTimer, ResponseTimes
from servolink.protocol import AddActionRequest, QueryProjectIDRequest, QueryServoListRequest, Request
from tests.client.piped_board import now, turns_of_the_loop
from tests.proofs.reliability.lossy import LOSSY, outcome
from tests.virtual_time import VirtualTimeLoop


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


async def test_a_deadline_passes_exactly_then() -> None:
    clock, begun = Clock(), now()
    clock.deadlines.arm(begun + 1.5)
    await asyncio.sleep(1.4999)
    assert clock.passed == []
    await asyncio.sleep(1)
    assert clock.passed == [begun + 1.5]


async def test_a_timer_that_comes_early_by_what_the_clock_does_not_resolve_is_not_set_again() -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop._clock_resolution = 1 / 64  # type: ignore[attr-defined]  # that of Windows
    clock, begun = Clock(), now()
    clock.deadlines.arm(begun + 1.5)
    await asyncio.sleep(1.49)
    await turns_of_the_loop(6)
    assert clock.passed == [begun + 1.5]


async def test_the_earliest_of_several_counts() -> None:
    clock, begun = Clock(), now()
    for seconds in (2, 1, 3):
        clock.deadlines.arm(begun + seconds)
    await asyncio.sleep(5)
    assert clock.passed == [begun + 1]  # who was told arms the next


async def test_a_deadline_can_be_set_while_one_is_passing() -> None:
    clock, begun = Clock(), now()
    clock.deadlines.arm(begun + 1)
    asyncio.get_running_loop().call_at(begun + 1, clock.deadlines.arm, begun + 2)
    await asyncio.sleep(5)
    assert clock.passed == [begun + 1, begun + 2]


async def test_none_passes_after_stop_which_may_come_twice() -> None:
    clock = Clock()
    clock.deadlines.arm(now() + 1)
    clock.deadlines.stop()
    clock.deadlines.stop()
    await asyncio.sleep(5)
    assert clock.passed == []


@pytest.mark.parametrize("piece", [1, 3, 4096])
async def test_after_a_stall_all_that_has_arrived_is_read_first(piece: int) -> None:
    clock = Clock()
    with line(clock, piece) as far:
        clock.deadlines.arm(now() + 1)
        await asyncio.sleep(0.5)
        far.send(bytes(40))
        stall(10)
        await asyncio.sleep(1)
    assert clock.received_then == [40]


async def test_a_line_that_never_falls_silent_does_not_put_a_deadline_off_for_ever() -> None:
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


async def test_a_flood_that_takes_long_to_parse_does_not_put_a_deadline_off() -> None:
    clock, begun, turns = Clock(), now(), 0
    clock.deadlines.arm(begun + 1)
    while not clock.passed and turns < 1000:
        turns += 1
        clock.received += 256 * 1024
        stall(0.2)
        await asyncio.sleep(0)
    assert clock.received_then[0] - 5 * 256 * 1024 >= 1024 * 1024  # what came before the deadline
    assert clock.passed[0] - begun < 3.5


# --- how long responses take --------------------------------------------------------------------------------------


QUERY, OTHER_QUERY, COMMAND = QueryServoListRequest(), QueryProjectIDRequest(), AddActionRequest(1)


def timeout(times: ResponseTimes, request: Request[Any], tries: int = 0, *, after_write: bool = False) -> float:
    return times.timeout(request, tries, after_write=after_write)


def measured(*seconds: float, request: Request[Any] = QUERY) -> ResponseTimes:
    times = ResponseTimes()
    for each in seconds:
        times.record(request.packet_id, each)
    return times


def test_at_first_a_query_has_a_quarter_of_a_second_and_what_is_sent_once_a_whole_one() -> None:
    assert timeout(ResponseTimes(), QUERY) == 0.25
    assert timeout(ResponseTimes(), COMMAND) == 1.0


def test_each_try_after_the_second_takes_half_as_long_again() -> None:
    times = ResponseTimes()
    assert [timeout(times, QUERY, tries) for tries in range(4)] == [0.25, 0.25, 0.375, 0.5625]
    assert timeout(times, QUERY, 10_000) < float("inf")


def test_what_follows_a_change_has_half_a_second_at_least() -> None:
    assert timeout(ResponseTimes(), QUERY, after_write=True) == 0.5
    assert timeout(ResponseTimes(), COMMAND, after_write=True) == 1.0


def test_each_kind_is_estimated_for_itself_and_a_new_one_by_the_quickest() -> None:
    times = measured(0.1)
    assert timeout(times, QUERY) == pytest.approx(0.3)  # 0.1 + 4 * 0.05
    assert timeout(times, OTHER_QUERY) == pytest.approx(0.24)
    times.record(COMMAND.packet_id, 0.01)
    assert timeout(times, OTHER_QUERY) == pytest.approx(0.15)


@pytest.mark.parametrize(("seconds", "expected"), [(0.0, 0.04), (0.001, 0.041), (0.4, 0.5), (60.0, 0.5)])
def test_the_estimate_has_a_margin_of_40_ms_and_ends_at_half_a_second(seconds: float, expected: float) -> None:
    assert timeout(measured(seconds), QUERY) == expected
    assert timeout(measured(seconds, request=COMMAND), COMMAND) == expected


def test_the_margin_grows_with_each_late_response_and_is_forgotten_slowly() -> None:
    times = measured(0.001)
    margins = []
    for _ in range(5):
        times.late()
        times.record(OTHER_QUERY.packet_id, 0.001)
        margins.append(timeout(times, OTHER_QUERY) - 0.001)
    assert margins == pytest.approx([0.0784, 0.1537, 0.294, 0.294, 0.294], abs=1e-3)
    for _ in range(200):
        times.record(QUERY.packet_id, 0.001)
    assert timeout(times, QUERY) == pytest.approx(0.041, abs=1e-3)


def test_an_even_line_is_trusted_more_and_more_and_a_hiccup_less() -> None:
    even = measured(*[0.2] * 4)
    trusted = timeout(even, QUERY)
    assert trusted == pytest.approx(0.2 + 4 * 0.1 * 0.75**3)
    even.record(QUERY.packet_id, 0.4)
    assert timeout(even, QUERY) > trusted + 0.04


def test_with_longer_tries_a_query_took_longer_on_a_lossy_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(deadlines, "LEAST_MARGIN", 0.1)
    _, seconds = outcome(LOSSY, 1, 8000, 1)
    assert seconds[-1] > 0.5
