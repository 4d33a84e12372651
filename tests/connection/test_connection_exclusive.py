"""What must go alone overlaps nothing, and nothing follows it before it is known to be over."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.connection.connection import Connection
from servolink.connection.fences import FENCES
from servolink.connection.times import SLOW_PATIENCE
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    ClearAllDataRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    QueryProjectIDRequest,
    QueryServoListRequest,
    Request,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    TransmissionModeSettingRequest,
)
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, connected, late, now

FENCE_KINDS = tuple(type(fence) for fence in FENCES)
ALONE: list[Request[Any]] = [
    ClearAllDataRequest(),
    TransmissionModeSettingRequest(1),
    SetAngleUnitRequest(ALL_SERVOS, 0),
    ExecuteMacroRequest(1),
    SetServoParameterRequest(ALL_SERVOS, 1, 1),
]
FOLLOWERS = [
    pytest.param(lambda connection: connection.request(QueryServoListRequest()), id="query"),
    pytest.param(lambda connection: connection.request(AddActionRequest(2)), id="change"),
    pytest.param(lambda connection: connection.send(ExecuteActionRequest((Step(1, 0, 1),))), id="movement"),
]


def kinds(board: PipedBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]


@pytest.mark.parametrize("exclusive", ALONE, ids=lambda packet: type(packet).__name__)
async def test_nothing_overlaps_it(exclusive: Request[Any]) -> None:
    board = PipedBoard()
    board.plan(type(exclusive), late(0.1))
    async with connected(board, depth=4) as connection:
        await asyncio.gather(
            connection.request(QueryProjectIDRequest()),
            connection.request(exclusive),
            connection.request(QueryServoListRequest()),
            connection.send(ExecuteActionRequest((Step(1, 0, 1),))),
        )
        times = {type(packet): at for at, packet in board.sent}
        assert times[type(exclusive)] > times[QueryProjectIDRequest]
        assert times[QueryServoListRequest] >= times[type(exclusive)] + 0.1
        assert times[ExecuteActionRequest] >= times[type(exclusive)] + 0.1


@pytest.mark.parametrize("exclusive", ALONE, ids=lambda packet: type(packet).__name__)
async def test_it_waits_for_the_last_of_several_fences(exclusive: Request[Any]) -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, LOST)
    for kind in FENCE_KINDS:
        board.plan(kind, late(0.4), late(0.3))
    async with connected(board) as connection:
        with pytest.raises(RequestTimeout):
            await connection.request(QueryServoListRequest(), timeout=0.05)
        await connection.request(exclusive)
        fences = [at for at, packet in board.sent if isinstance(packet, FENCE_KINDS)]
        assert len(fences) == 2
        assert board.sent_of(type(exclusive)) == [pytest.approx(fences[1] + 0.3)]


@pytest.mark.parametrize("exclusive", ALONE, ids=lambda packet: type(packet).__name__)
async def test_two_of_them_do_not_overlap_and_what_was_not_sent_yet_counts(exclusive: Request[Any]) -> None:
    board = PipedBoard()
    async with connected(board, depth=4) as connection:
        await asyncio.gather(connection.request(exclusive), connection.request(exclusive))
        first, second = board.sent_of(type(exclusive))
        assert second > first


@pytest.mark.parametrize("exclusive", ALONE, ids=lambda packet: type(packet).__name__)
async def test_not_even_a_fence_that_is_due_goes_beside_it(exclusive: Request[Any]) -> None:
    board = PipedBoard()
    async with connected(board, depth=4) as connection:
        connection.slots.unproved = 16  # as many equal queries leave it, after which a fence is due
        await connection.request(exclusive)
        assert board.sent == [(1000.0, exclusive)]


async def test_deleting_everything_may_take_half_a_minute() -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(SLOW_PATIENCE - 1))
    async with connected(board) as connection:
        assert (await connection.request(ClearAllDataRequest())).result == 1
        assert board.executed_of(ClearAllDataRequest) == [ClearAllDataRequest()]


async def test_deleting_everything_may_take_as_long_as_the_patience_if_that_is_longer() -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(50))
    async with connected(board, patience=60) as connection:
        assert (await connection.request(ClearAllDataRequest())).result == 1


@pytest.mark.parametrize("follow", FOLLOWERS)
async def test_nothing_follows_it_before_it_or_a_fence_is_answered(
    follow: Callable[[Connection], Awaitable[object]],
) -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(2.5))
    async with connected(board) as connection:
        begun = now()
        with pytest.raises(OutcomeUnknown):
            await connection.request(ClearAllDataRequest(), timeout=1)
        await follow(connection)
        at, packet = board.sent[-1]
        assert type(packet) not in FENCE_KINDS
        assert at >= begun + 2.5
        assert set(kinds(board)[1:-1]) <= set(FENCE_KINDS)
        assert connection.stats.fences >= 1


@pytest.mark.parametrize("follow", FOLLOWERS)
async def test_nothing_follows_it_if_no_fence_is_answered(
    follow: Callable[[Connection], Awaitable[object]],
) -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with connected(board) as connection:
        with pytest.raises(OutcomeUnknown):
            await connection.request(ClearAllDataRequest(), timeout=1)
        begun = now()
        with pytest.raises(RequestTimeout, match=r"not sent in 3\.0 s"):
            await follow(connection)
        assert now() == pytest.approx(begun + 3)
        with pytest.raises(ConnectionLost, match="has sent nothing for"):
            await follow(connection)
        assert set(kinds(board)[1:]) <= set(FENCE_KINDS)


@pytest.mark.parametrize("depth", [1, 4])
async def test_a_lost_one_is_over_when_a_fence_is_answered(depth: int) -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, LOST)
    async with connected(board, depth=depth) as connection:
        begun = now()
        with pytest.raises(OutcomeUnknown):
            await connection.request(ClearAllDataRequest())
        assert now() < begun + 1.1  # one second for the response, then a fence
        assert [kind in FENCE_KINDS for kind in kinds(board)] == [False, True]


async def test_one_whose_caller_was_cancelled_still_goes_alone() -> None:
    board = PipedBoard()
    board.plan(ClearAllDataRequest, late(0.5))
    async with connected(board, depth=4) as connection:
        clearing = asyncio.create_task(connection.request(ClearAllDataRequest()))
        await asyncio.sleep(0.1)
        clearing.cancel()
        begun = now()
        await connection.request(AddActionRequest(2))
        assert board.sent[-1][0] == pytest.approx(begun + 0.4)
