"""Proofs of requests: when they end, and what a loss of the connection ends.

Module: servolink.connection.connection, servolink.connection.repeats.
"""

from __future__ import annotations

import asyncio

import pytest

from servolink.connection.repeats import HeardContents
from servolink.errors import ConnectionLost, RequestTimeout
from servolink.motion import Ticket
from servolink.protocol import (
    Packet,
    QueryMemorySizeResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoRequest,
    SetAngleUnitRequest,
)
from tests.client.piped_board import LOST, PipedBoard, connected, late, now

STRAY = QueryMemorySizeResponse(1, 2)


async def test_no_answer_from_the_time_of_proofs_is_taken_when_they_end() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for project_id in range(3):
            board.storage.project_id = project_id
            board.speak(STRAY)
            assert (await connection.request(QueryProjectIDRequest())).project_id == project_id
            assert connection.repeats.is_proving
            board.storage.project_id = project_id + 10
            await asyncio.sleep(11)
            assert (await connection.request(QueryProjectIDRequest())).project_id == project_id + 10
            assert not connection.repeats.is_proving


async def test_the_wait_for_a_further_answer_ends_with_the_connection() -> None:
    board = PipedBoard()
    board.usual_of[QueryServoRequest] = late(0.1)
    async with connected(board, late_copies=True) as connection:
        for _ in range(3):
            await connection.request(QueryServoRequest(1))
        board.forget_plans()  # the usual time twice is waited for, though this answer comes sooner
        asking = asyncio.create_task(connection.request(QueryServoRequest(1)))
        await asyncio.sleep(0.05)
        assert not asking.done()
        board.vanish()
        begun = now()
        await asyncio.wait((asking,))
        assert now() == begun


async def test_pauses_between_the_proofs_of_one_request_end_with_the_connection() -> None:
    board = PipedBoard()
    async with connected(board, late_copies=True) as connection:
        asking = asyncio.create_task(connection.request(QueryProjectIDRequest()))
        while not asking.done() and len(board.sent_of(QueryProjectIDRequest)) < 6:  # the pauses have grown
            await asyncio.sleep(0.003)
            board.speak(QueryProjectIDResponse(len(board.sent) + 50))
        await asyncio.sleep(0.05)
        board.vanish()
        begun = now()
        with pytest.raises(ConnectionLost):
            await asking
        assert now() == begun


async def test_a_repeated_query_is_answered_in_the_order_of_its_sendings() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        board.speak(STRAY)
        await asyncio.sleep(0.01)
        board.plan(QueryProjectIDRequest, LOST)
        board.storage.project_id = 7
        assert (await connection.request(QueryProjectIDRequest())).project_id == 7
        assert connection.repeats.is_proving


async def test_a_request_without_an_answer_to_the_fence_behind_it_is_not_proved() -> None:
    board = PipedBoard()
    async with connected(board, late_copies=True) as connection:
        board.usual_of[QueryServoRequest], board.usual = board.usual, LOST
        with pytest.raises(RequestTimeout, match="QueryServoRequest"):
            await connection.request(QueryServoRequest(1))
        assert board.sent_of(QueryServoRequest)


async def test_a_command_is_prepared_before_it_is_proved() -> None:
    board = PipedBoard()
    prepared: list[Packet] = []

    async def prepare(packet: Packet, ticket: Ticket) -> None:
        prepared.append(packet)

    async with connected(board, late_copies=True) as connection:
        connection.preparations = (prepare,)
        await connection.request(motion := SetAngleUnitRequest(1, 0))
        assert prepared == [motion]


def test_only_the_latest_contents_are_known() -> None:
    heard = HeardContents()
    for number in range(5_000):
        heard.add((30011, number.to_bytes(2, "little")), now=0.0)
    heard.add((30011, (4_999).to_bytes(2, "little")), now=0.1)
    assert heard.is_copy
    heard.add((30011, bytes(2)), now=0.1)
    assert not heard.is_copy
