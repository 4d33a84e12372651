"""After a silence everything can be settled again: fences must not leave an open slot on every lane that they use."""

from __future__ import annotations

import pytest

from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    AddActionRequest,
    ClearAllDataRequest,
    Packet,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LOST, PipedBoard, connected, late


@pytest.mark.parametrize("depth", [1, 4])
async def test_a_packet_that_must_be_alone_is_sent_after_a_silence(depth: int) -> None:
    """Each fence used to take another lane; then none was ever exact, and the setting was not sent for 3 s."""
    board = PipedBoard()
    async with connected(board, depth=depth, patience=5.0) as connection:
        await connection.request(QueryProjectIDRequest())
        board.usual = LOST
        with pytest.raises(RequestTimeout):
            await connection.request(QueryServoRequest(1), timeout=0.01)
        for _ in range(6):
            with pytest.raises(RequestTimeout):  # each sends a fence first
                await connection.request(SetAngleUnitRequest(1, 0), timeout=0.6)
        board.usual = Fate()
        await connection.request(SetAngleUnitRequest(1, 0), timeout=0.5)
        await connection.request(ClearAllDataRequest(), timeout=0.5)


async def test_one_kind_of_fence_is_enough() -> None:
    """With an open slot on its lane its response is never exact; the list of servos then is."""
    board = PipedBoard()
    async with connected(board) as connection:
        connection._sender.fences.queries = (QueryProjectIDRequest(),)
        board.plan(QueryServoRequest, LOST)
        board.plan(QueryProjectIDRequest, LOST)
        for packet in (QueryServoRequest(1), QueryProjectIDRequest()):
            with pytest.raises(RequestTimeout):
                await connection.request(packet, timeout=0.01)
        await connection.request(SetAngleUnitRequest(1, 0), timeout=0.9)
        sent: list[type[Packet]] = [type(packet) for _, packet in board.sent]
        assert QueryServoListRequest in sent


async def test_late_fences_are_no_reason_to_ask_again() -> None:
    """Each of them used to send the query once more, while its response was under way."""
    board = PipedBoard()
    async with connected(board) as connection:
        board.plan(QueryServoRequest, late(0.9))
        board.plan(QueryMemorySizeRequest, *3 * [late(0.9)])
        with pytest.raises(RequestTimeout):
            await connection.request(QueryServoRequest(1), timeout=0.05)
        await connection.request(QueryServoRequest(1))
        assert [type(packet) for _, packet in board.sent].count(QueryServoRequest) == 2


async def test_a_late_fence_does_not_hide_the_response_that_follows() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        board.plan(AddActionRequest, late(0.2), late(0.6))
        board.plan(QueryMemorySizeRequest, late(0.8))
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1, "one"), timeout=0.05)
        assert (await connection.request(AddActionRequest(2, "two"))).result == 1
