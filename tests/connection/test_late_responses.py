"""Many requests to a board that answers late and loses responses, with random cancels: no wrong response."""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest

from servolink.connection.connection import Connection
from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    Codec,
    FrameParser,
    QueryActionRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoRequest,
    Request,
    Response,
    WriteProjectIDRequest,
)
from tests.client.numbered_board import CALL, NumberedBoard, numbered
from tests.virtual_time import run

TIMEOUT = 0.25
LATE, LOST = 0.03, 0.01
KINDS: tuple[Request[Any], ...] = (
    QueryProjectIDRequest(),
    QueryMemorySizeRequest(),
    QueryRemainPowerRequest(),
    QueryActionRequest(1),
    QueryActionRequest(2),
    QueryServoRequest(3),
    WriteProjectIDRequest(4),
)


class PlainClient:
    """What one writes first: a future per response id, a time limit, the same retries."""

    def __init__(self, transport: NumberedBoard) -> None:
        self._transport = transport
        self._codec = Codec()
        self._parser = FrameParser()
        self._futures: dict[int, asyncio.Future[Response]] = {}
        self._turn = asyncio.Lock()

    def data(self, chunk: bytes, /) -> None:
        for packet_id, content in self._parser.feed(chunk):
            future = self._futures.pop(packet_id, None)
            if future is not None and not future.done():
                packet = self._codec.decode(packet_id, content)
                assert isinstance(packet, Response)
                future.set_result(packet)

    def lost(self, error: Exception | None, /) -> None:
        assert error is None

    async def request(self, packet: Request[Any]) -> Response:
        async with self._turn:
            for _ in range(3):
                future: asyncio.Future[Response] = asyncio.get_running_loop().create_future()
                self._futures[packet.packet_id + 1] = future
                await self._transport.send(self._codec.encode(packet))
                await asyncio.wait((future,), timeout=TIMEOUT)
                if future.done():
                    return future.result()
            raise RequestTimeout("no answer", packet)


async def converse(client: Any, board: NumberedBoard, requests: int, seed: int) -> dict[str, int]:
    """Ask one thing after another, cancel some, and count the answers by whether they are right."""
    outcomes: dict[str, int] = dict.fromkeys(("right", "wrong", "unanswered", "cancelled"), 0)
    chance = random.Random(seed)

    async def ask(call: int, packet: Request[Any]) -> None:
        CALL.set(call)
        sent_before = len(board.sent_by)
        try:
            answer = await client.request(packet)
        except (RequestTimeout, OutcomeUnknown):
            outcomes["unanswered"] += 1
            return
        own = (n for n in range(sent_before, len(board.sent_by)) if board.sent_by[n] == call)
        right = any(answer == numbered(packet, n) for n in own if type(board.sent[n - 1][1]) is type(packet))
        outcomes["right" if right else "wrong"] += 1

    for call in range(1, requests + 1):
        task = asyncio.create_task(ask(call, chance.choice(KINDS)))
        if chance.random() < 0.02:
            await asyncio.sleep(chance.uniform(0, 0.01))
            task.cancel()
        await asyncio.wait((task,))
        outcomes["cancelled"] += task.cancelled()
        await asyncio.sleep(0.005 if chance.random() < 0.5 else 0)
    return outcomes


async def with_connection(requests: int, seed: int) -> tuple[dict[str, int], Any]:
    board = NumberedBoard(late=LATE, lost=LOST, seed=seed)
    connection = Connection(board)
    await connection.open()
    outcomes = await converse(connection, board, requests, seed)
    await connection.close()
    return outcomes, connection.stats


async def with_plain_client(requests: int, seed: int) -> dict[str, int]:
    board = NumberedBoard(late=LATE, lost=LOST, seed=seed)
    client = PlainClient(board)
    await board.open(client)
    outcomes = await converse(client, board, requests, seed)
    await asyncio.sleep(5)
    return outcomes


@pytest.mark.parametrize("requests", [2_000, pytest.param(30_000, marks=pytest.mark.slow)])
def test_no_wrong_answer_in_many_requests_where_a_plain_future_per_id_has_many(requests: int) -> None:
    ours, stats = run(with_connection(requests, seed=1))
    plain = run(with_plain_client(requests, seed=1))
    print(f"{requests} requests, 3 % late, 1 % lost, 2 % cancelled: slots {ours}; a future per id {plain}")

    many = requests // 1000
    assert ours["wrong"] == 0
    assert plain["wrong"] > many
    assert sum(ours.values()) == requests
    assert ours["unanswered"] == 0
    assert ours["cancelled"] > many
    assert stats.fences > many
    assert stats.late_responses > many
