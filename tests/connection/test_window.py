"""Window: how many requests are under way, and how long a stop has to wait for them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from itertools import count, pairwise
from typing import Any

import pytest

from servolink.connection.call import UNKNOWN_SIZE, Lane
from servolink.connection.connection import Connection
from servolink.connection.scheduler import Window
from servolink.connection.times import MOST_OWED, MOST_OWED_IN_BULK
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    ExecuteActionRequest,
    QueryActionRequest,
    QueryServoRequest,
    Request,
    SetServoParameterRequest,
    Step,
)
from tests.client.line_board import SERIAL, LineBoard
from tests.client.piped_board import connected
from tests.virtual_time import run

TELEMETRY = QueryServoRequest(ALL_SERVOS)
WRITE = AddActionRequest(1)
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)


def climbed(window: Window, depth: int) -> Window:
    window.queries.depth = window.writes.depth = depth
    return window


# --- the window alone ---------------------------------------------------------------------------------------------


def test_queries_and_changes_have_their_own_depths_and_beside_a_change_its_depth_holds() -> None:
    window = Window(8, 2, learn=False)
    assert window.climb(TELEMETRY, 0).depth == 8
    assert window.climb(WRITE, 0).depth == 2
    assert window.climb(TELEMETRY, 1).depth == 2
    assert window.climb(ExecuteActionRequest((Step(1, 5, 10),)), 0).depth == 2


def test_a_stop_waits_for_50_ms_of_responses_and_for_100_ms_while_much_is_transferred() -> None:
    window = Window(16, bytes_per_second=1000)
    assert window.fits(round(1000 * MOST_OWED), 1)
    assert not window.fits(round(1000 * MOST_OWED) + 1, 1)
    with window.bulk():
        with window.bulk():
            assert window.fits(round(1000 * MOST_OWED_IN_BULK), 1)
        assert not window.fits(round(1000 * MOST_OWED_IN_BULK) + 1, 1)
    assert not window.fits(round(1000 * MOST_OWED) + 1, 1)


def test_much_that_is_transferred_changes_nothing_where_nothing_is_learnt() -> None:
    window = Window(4, 2, learn=False)
    with window.bulk():
        assert (window.queries.depth, window.writes.depth) == (4, 2)


def test_as_long_as_the_pace_of_the_line_is_unknown_two_may_be_under_way() -> None:
    window = Window(16)
    assert window.fits(10, 1)
    assert not window.fits(15, 2)
    window.heard(100, 0.01)
    assert window.pace == pytest.approx(10_000)
    assert window.fits(15, 2)


def test_the_pace_of_the_line_is_that_of_the_latest_responses_and_not_less_than_what_is_known() -> None:
    window = Window(16, bytes_per_second=500)
    for _ in range(1000):
        window.heard(100, 0.1)
    assert window.pace == pytest.approx(1000)
    for _ in range(500):
        window.heard(100, 1)
    assert window.pace == 500


def test_a_lane_knows_how_long_a_long_response_of_its_kind_is() -> None:
    lane = Lane(1)
    assert lane.size == UNKNOWN_SIZE
    lane.heard(100)
    assert lane.size == 100
    lane.heard(180)
    assert lane.size == 180
    lane.heard(100)
    assert lane.size == 170
    lane.sent(190)
    assert lane.size == 190


# --- on a line ----------------------------------------------------------------------------------------------------


async def ask(connection: Connection, requests: Iterator[Request[Any]], callers: int = 20) -> None:
    """Keep so many requests waiting until the connection ends."""

    async def go_on() -> None:
        for request in requests:
            await connection.request(request)

    await asyncio.gather(*(go_on() for _ in range(callers)), return_exceptions=True)


def telemetry() -> Iterator[Request[Any]]:
    while True:
        yield TELEMETRY


def pairs() -> Iterator[Request[Any]]:
    """Write one action after the other and read it back, each 127 bytes, like an import."""
    for number in count(1):
        yield AddActionRequest(number % 50 + 1, "action", tuple(Step(servo, 5, 10) for servo in range(16)))
        yield QueryActionRequest(number % 50 + 1)


def delays(
    requests: Callable[[], Iterator[Request[Any]]],
    board: LineBoard,
    *,
    bulk: bool = False,
    **options: Any,
) -> list[float]:
    """Return how long after it was sent the board came to each of several stops, in the middle of such a load."""

    async def main() -> list[float]:
        async with connected(board, handshake=True, learn=True, **options) as connection:
            await connection.shake_hands()
            climbed(connection.scheduler.window, 16)
            loop = asyncio.get_running_loop()
            load = loop.create_task(ask(connection, requests()))
            begun = loop.time()
            found: list[float] = []
            with connection.bulk() if bulk else nullcontext():
                for number in range(20):
                    await asyncio.sleep(begun + 1 + 0.137 * number - loop.time())
                    sent = loop.time()
                    await connection.send_stop(STOP)
                    while (handled := [at for at, packet in board.executed if packet == STOP][len(found) :]) == []:
                        await asyncio.sleep(0.001)
                    found.append(handled[0] - sent)
        await load
        return found

    return run(main())


@pytest.mark.parametrize("loss", [0.0, 0.05])
@pytest.mark.parametrize("known", [False, True])
def test_a_stop_in_the_middle_of_a_load_of_depth_16_is_delayed_by_less_than_50_ms(known: bool, loss: float) -> None:
    board = LineBoard(loss=loss)
    if known:
        board.bytes_per_second = SERIAL  # type: ignore[attr-defined]
    found = delays(telemetry, board, depth=16)
    assert 0.02 < max(found) < 0.05


def test_during_an_import_a_stop_is_delayed_by_less_than_100_ms() -> None:
    board = LineBoard()
    found = delays(pairs, board, bulk=True, depth=16, write_depth=16)
    assert 0.04 < max(found) < 0.1


async def test_a_response_that_takes_long_is_alone_on_the_line() -> None:
    board = LineBoard(pace=1000)
    board.bytes_per_second = 1000  # type: ignore[attr-defined]
    async with connected(board, learn=True, depth=16) as connection:
        climbed(connection.scheduler.window, 16)
        await asyncio.gather(*(connection.request(TELEMETRY) for _ in range(10)))
        asked = [at for at, packet in board.sent if packet == TELEMETRY]
        assert all(later - earlier > 0.1 for earlier, later in pairwise(asked))


async def test_who_asks_one_thing_after_the_other_gets_no_more_than_one_under_way() -> None:
    board = LineBoard()
    async with connected(board, learn=True, depth=16, write_depth=16) as connection:
        for requests in (telemetry(), pairs()):
            for _, request in zip(range(100), requests, strict=False):
                await connection.request(request)
        assert connection.scheduler.window.depth == 1


async def test_a_movement_waits_until_as_little_is_under_way_as_for_any_change() -> None:
    board = LineBoard()
    async with connected(board, handshake=True, learn=True, depth=16) as connection:
        await connection.shake_hands()
        load = asyncio.create_task(ask(connection, telemetry()))
        await asyncio.sleep(3)
        assert connection.depth == 2
        await connection.send(ExecuteActionRequest((Step(1, 5, 10),)))
        before = [type(packet) for _, packet in board.sent].index(ExecuteActionRequest)
        assert len([at for at in board.answered_at if at <= board.sent[before][0]]) == before
    await load


async def test_a_depth_of_1_learns_nothing() -> None:
    board = LineBoard()
    async with connected(board, learn=True) as connection:
        await asyncio.gather(*(connection.request(TELEMETRY) for _ in range(100)))
        assert connection.scheduler.window.pace == 0
        assert connection.slots.lanes[TELEMETRY.packet_id + 1].response_size == UNKNOWN_SIZE


@pytest.mark.parametrize("room", [0, 1])
async def test_a_board_that_queues_nothing_loses_next_to_nothing(room: int) -> None:
    board = LineBoard(room=room, turnaround=0.02)
    async with connected(board, learn=True, depth=16) as connection:
        load = asyncio.create_task(ask(connection, telemetry()))
        await asyncio.sleep(60)
        assert len(board.answered_at) > 0.97 * 60 / (0.02 + 0.017 + 0.001)
        assert board.overflows < 0.02 * len(board.answered_at)
    await load


async def test_changes_find_a_depth_of_their_own() -> None:
    board = LineBoard(pace=1e6, turnaround=0)
    board.latency = 0.005
    async with connected(board, learn=True, depth=2, write_depth=8) as connection:
        load = asyncio.create_task(ask(connection, pairs()))
        await asyncio.sleep(5)
        assert (connection.depth, connection.scheduler.window.writes.depth) == (1, 8)
    await load
