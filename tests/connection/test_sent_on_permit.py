"""Tests of `servolink.connection.sender`: what waited is sent as soon as there is room, and in order.

And of `servolink.connection.dispatcher`: the short way of the usual response leads where the long one does.
"""

from __future__ import annotations

import asyncio
from random import Random
from typing import Any

import pytest

from servolink.connection.slots import Slots
from servolink.errors import ServolinkError
from servolink.protocol import (
    QueryActionRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    Request,
    SetServoParameterRequest,
    WriteProjectIDRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LOST, PipedBoard, connected, late, turns_of_the_loop

LIST, PROJECT, MEMORY = QueryServoListRequest(), QueryProjectIDRequest(), QueryMemorySizeRequest()
REQUESTS: tuple[Request[Any], ...] = (LIST, PROJECT, MEMORY, QueryActionRequest(1), WriteProjectIDRequest(5))


async def test_a_query_is_sent_in_the_turn_after_the_one_that_makes_room_for_it() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board) as connection:
        tasks = [asyncio.create_task(connection.request(packet)) for packet in (LIST, PROJECT)]
        await turns_of_the_loop(2)
        assert [packet for _, packet in board.sent] == [LIST]
        board.speak(QueryServoListResponse((1,)))
        await turns_of_the_loop(2)
        assert [packet for _, packet in board.sent] == [LIST, PROJECT]
        assert tasks[0].done()
        for task in tasks:
            task.cancel()


@pytest.mark.parametrize("depth", [1, 2, 3])
async def test_packets_leave_in_the_order_in_which_they_were_asked_for_whoever_has_a_time_limit(depth: int) -> None:
    board = PipedBoard()
    packets: list[Request[Any]] = [QueryActionRequest(number) for number in range(20)]
    packets[7] = WriteProjectIDRequest(5)
    async with connected(board, depth=depth) as connection:
        limits = [None if number % 3 else 9.0 for number in range(20)]
        asking = [connection.request(packet, timeout=limit) for packet, limit in zip(packets, limits, strict=True)]
        await asyncio.gather(*asking)
        assert [packet for _, packet in board.sent if packet in packets] == packets


async def test_nothing_that_waits_goes_before_a_stop() -> None:
    board = PipedBoard(usual=LOST)
    stop = SetServoParameterRequest(255, 0, 1)
    async with connected(board, depth=2) as connection:
        lost = asyncio.create_task(connection.request(SetServoParameterRequest(1, 1, 1)))
        await asyncio.sleep(0)
        waiting = asyncio.create_task(connection.request(LIST))
        await asyncio.sleep(0)
        lost.cancel()
        await asyncio.wait((lost,))
        await connection.send_stop(stop)
        assert board.sent[1][1] == stop
        waiting.cancel()


@pytest.mark.parametrize("turns", range(6))
async def test_a_cancel_at_any_time_gives_the_place_to_the_next(turns: int) -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        tasks = [asyncio.create_task(connection.request(packet)) for packet in (LIST, PROJECT, MEMORY)]
        await turns_of_the_loop(2)
        while not tasks[0].done():
            await asyncio.sleep(0.001)
        await turns_of_the_loop(turns)
        tasks[1].cancel()
        assert await tasks[2] is not None
        assert (await connection.request(LIST)).servo_id_list


@pytest.mark.parametrize("depth", [1, 4])
@pytest.mark.parametrize("seed", range(5))
async def test_both_ways_of_a_response_have_the_same_outcome(
    seed: int, depth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    short = await _history(Random(seed), depth)
    monkeypatch.setattr(Slots, "only_origin", lambda slots, lane: None)
    assert await _history(Random(seed), depth) == short
    assert len(set(map(str, short[0]))) > 3


async def _history(random: Random, depth: int) -> tuple[list[object], dict[str, Any], list[Any]]:
    board = PipedBoard()
    for packet in REQUESTS:
        fates = (Fate(), Fate(), Fate(), LOST, late(0.2), Fate(copies=2), Fate(damage=lambda data: data[:-1]))
        board.plan(type(packet), *random.choices(fates, k=40))
    async with connected(board, depth=depth, patience=1.0, learn=True, random=Random(1)) as connection:

        async def ask(after: float, packet: Request[Any]) -> object:
            await asyncio.sleep(after)
            try:
                return await connection.request(packet)
            except ServolinkError as error:
                return str(error)

        asking = [ask(random.choice((0.0, 0.1, random.random())), random.choice(REQUESTS)) for _ in range(60)]
        outcomes = await asyncio.gather(*asking)
        begun = board.sent[0][0]
        return outcomes, connection.stats.as_dict(), [(round(at - begun, 6), packet) for at, packet in board.sent]
