"""Link: what an earlier connection to the same board was owed is not taken for an answer to the next one."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Any

import pytest

from servolink.connection.connection import FENCES, MORE_FENCES, Connection
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout
from servolink.protocol.editing import (
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.protocol.packet import Packet, Request
from servolink.protocol.servos import ExecuteActionExRequest
from servolink.protocol.settings import ClearAllDataRequest
from tests.client.fake_board import LOST, FakeBoard, linked, now, turns_of_the_loop
from tests.virtual_time import run

FENCE_KINDS = tuple(type(fence) for fence in FENCES)
MORE_KINDS = tuple(type(fence) for fence in MORE_FENCES)


async def left_unanswered(*requests: Request[Any], before: Connection | None = None) -> Connection:
    """Return a closed link on which these were asked and not answered."""
    board = FakeBoard(usual=LOST)
    async with linked(board, before=before) as link:
        for request in requests:
            with suppress(RequestTimeout, OutcomeUnknown):
                await link.request(request, timeout=0.01, retries=0)
        assert [packet for _, packet in board.sent] == list(requests)
    return link


def kinds(board: FakeBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]


def test_an_answer_that_the_connection_before_was_owed_is_dropped() -> None:
    async def main() -> None:
        before = await left_unanswered(WriteProjectIDRequest(1))
        board = FakeBoard()
        async with linked(board, before=before) as link:
            asyncio.get_running_loop().call_later(0.002, board.speak, WriteProjectIDResponse(0))
            assert (await link.request(WriteProjectIDRequest(2))).result == 1
            assert kinds(board)[0] in FENCE_KINDS
            assert kinds(board)[1:] == [WriteProjectIDRequest]
            assert link.stats.late_responses == 1
            assert link.stats.fences == 1

    run(main())


def test_what_still_waited_when_the_connection_was_lost_is_owed_to_the_next_one() -> None:
    async def main() -> None:
        lost = FakeBoard(usual=LOST)
        async with linked(lost) as before:
            asking = asyncio.create_task(before.request(QueryProjectIDRequest()))
            await turns_of_the_loop(2)
            lost.vanish()
            with pytest.raises(ConnectionLost):
                await asking
        board = FakeBoard()
        async with linked(board, before=before) as link:
            asyncio.get_running_loop().call_later(0.002, board.speak, QueryProjectIDResponse(77))
            assert (await link.request(QueryProjectIDRequest())).project_id == board.virtual.storage.contents.project_id
            assert link.stats.fences == 1

    run(main())


def test_what_the_connection_before_was_not_owed_costs_no_fence() -> None:
    async def main() -> None:
        before = await left_unanswered(WriteProjectIDRequest(1))
        board = FakeBoard()
        async with linked(board, before=before) as link:
            await link.request(QueryProjectIDRequest())
            await link.request(WriteProjectIDRequest(2))
            assert link.stats.fences == 0

    run(main())


def test_where_all_fences_are_owed_other_queries_serve() -> None:
    async def main() -> None:
        before = await left_unanswered(*FENCES)
        board = FakeBoard()
        async with linked(board, before=before) as link:
            begun = now()
            await link.request(QueryProjectIDRequest())
            assert now() < begun + 0.1
            assert kinds(board)[0] in MORE_KINDS
            assert kinds(board)[1:] == [QueryProjectIDRequest]

    run(main())


def test_a_clearing_that_is_owed_holds_back_what_is_never_answered() -> None:
    async def main() -> None:
        lost = FakeBoard(usual=LOST)
        async with linked(lost) as before:
            with pytest.raises(OutcomeUnknown):
                await before.request(ClearAllDataRequest())
        board = FakeBoard()
        async with linked(board, before=before) as link:
            await link.send(ExecuteActionExRequest(1))
            assert kinds(board)[0] in FENCE_KINDS
            assert kinds(board)[1:] == [ExecuteActionExRequest]

    run(main())


def test_what_is_owed_is_handed_on_until_it_is_answered_or_leaves_no_fence() -> None:
    async def main() -> None:
        first = await left_unanswered(*FENCES)
        second = await left_unanswered(before=first)
        board = FakeBoard()
        async with linked(board, before=second) as link:
            await link.request(QueryProjectIDRequest())
            assert link.stats.fences == 1

        third = await left_unanswered(*MORE_FENCES, before=second)
        board = FakeBoard()
        async with linked(board, before=third) as link:
            await link.request(QueryProjectIDRequest())
            assert link.stats.fences == 0

    run(main())


def test_a_connection_without_any_fence_asks_nothing_that_it_could_be_wrong_about() -> None:
    async def main() -> None:
        before = await left_unanswered(*FENCES, *MORE_FENCES)
        board = FakeBoard()
        async with linked(board, before=before) as link:
            with pytest.raises(RequestTimeout, match="not sent"):
                await link.request(QueryProjectIDRequest(), timeout=10)
            with pytest.raises(ConnectionLost, match="the board answered none of the queries"):
                await link.request(QueryProjectIDRequest())
            assert board.sent == []
        async with linked(board := FakeBoard(), before=link) as after:
            await after.request(QueryProjectIDRequest())
            assert kinds(board) == [QueryProjectIDRequest]

    run(main())
