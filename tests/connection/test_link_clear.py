"""Link: ClearAllData overlaps nothing, and nothing follows it before it is known to be over."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from servolink.connection.connection import FENCES, Connection
from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.protocol.editing import QueryProjectIDRequest, WriteProjectIDRequest
from servolink.protocol.packet import Packet
from servolink.protocol.records import Step
from servolink.protocol.servos import ExecuteActionRequest, QueryServoListRequest
from servolink.protocol.settings import ClearAllDataRequest
from tests.client.fake_board import SWALLOWED, FakeBoard, late, linked, now
from tests.virtual_time import run

FENCE_KINDS = tuple(type(fence) for fence in FENCES)
FOLLOWERS = [
    pytest.param(lambda link: link.request(QueryServoListRequest()), id="query"),
    pytest.param(lambda link: link.request(WriteProjectIDRequest(2)), id="change"),
    pytest.param(lambda link: link.send(ExecuteActionRequest((Step(1, 0, 1),))), id="movement"),
]


def kinds(board: FakeBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]


def test_nothing_overlaps_clear_all_data() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(ClearAllDataRequest, late(0.5))
        async with linked(board, window=4) as link:
            await asyncio.gather(
                link.request(QueryProjectIDRequest()),
                link.request(ClearAllDataRequest()),
                link.request(QueryServoListRequest()),
                link.send(ExecuteActionRequest((Step(1, 0, 1),))),
            )
            times = {type(packet): at for at, packet in board.sent}
            assert times[ClearAllDataRequest] > times[QueryProjectIDRequest]
            assert times[QueryServoListRequest] >= times[ClearAllDataRequest] + 0.5
            assert times[ExecuteActionRequest] >= times[ClearAllDataRequest] + 0.5

    run(main())


@pytest.mark.parametrize("follow", FOLLOWERS)
def test_nothing_is_sent_after_an_unanswered_clear_all_data_before_a_fence(
    follow: Callable[[Connection], Awaitable[object]],
) -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(ClearAllDataRequest, late(2.5))
        async with linked(board) as link:
            begun = now()
            with pytest.raises(OutcomeUnknown):
                await link.request(ClearAllDataRequest())
            await follow(link)
            at, packet = board.sent[-1]
            assert type(packet) not in FENCE_KINDS
            assert at >= begun + 2.5
            assert set(kinds(board)[1:-1]) <= set(FENCE_KINDS)
            assert link.stats.fences >= 1

    run(main())


@pytest.mark.parametrize("follow", FOLLOWERS)
def test_nothing_at_all_is_sent_when_no_fence_after_clear_all_data_is_answered(
    follow: Callable[[Connection], Awaitable[object]],
) -> None:
    async def main() -> None:
        board = FakeBoard(usual=SWALLOWED)
        async with linked(board) as link:
            with pytest.raises(OutcomeUnknown):
                await link.request(ClearAllDataRequest())
            with pytest.raises(RequestTimeout, match="not sent"):
                await follow(link)
            assert set(kinds(board)[1:]) <= set(FENCE_KINDS)

    run(main())


def test_clear_all_data_whose_caller_was_cancelled_still_goes_alone() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(ClearAllDataRequest, late(0.5))
        async with linked(board, window=4) as link:
            clearing = asyncio.create_task(link.request(ClearAllDataRequest()))
            await asyncio.sleep(0.1)
            clearing.cancel()
            begun = now()
            await link.request(WriteProjectIDRequest(2))
            assert board.sent[-1][0] == pytest.approx(begun + 0.4)

    run(main())
