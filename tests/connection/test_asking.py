"""Connection.ask: queries for which no task waits.

Module: servolink.connection.connection.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Literal

import pytest

from servolink.connection.connection import Connection
from servolink.connection.times import FIRST_TRY
from servolink.errors import ConnectionLost, RequestTimeout
from servolink.protocol import (
    HEADER,
    MAGIC,
    Query,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoResponse,
)
from servolink.testing import Fate
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, connected, late
from tests.virtual_time import run

QUERY = QueryServoListRequest()


class Asked:
    """What came of what was asked."""

    def __init__(self, connection: Connection) -> None:
        self.outcomes: list[Any] = []
        self.contents: list[bytes | None] = []
        self._connection = connection

    def ask(self, packet: Query[Any] = QUERY) -> bool:
        """Ask, and return whether it was sent."""
        return self._connection.ask(packet, self._done)

    def _done(self, outcome: object, content: bytes | None) -> None:
        self.outcomes.append(outcome)
        self.contents.append(content)


def asking(use: Callable[[Asked, PipedBoard], Awaitable[None]], **options: Any) -> None:
    async def main() -> None:
        fake = PipedBoard()
        async with connected(fake, **options) as connection:
            await use(Asked(connection), fake)

    run(main())


@pytest.mark.parametrize("depth", [1, 4])
def test_the_response_is_there_as_soon_as_it_is_read(depth: int) -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        for _ in range(300):
            assert asked.ask()
            await asyncio.sleep(0.01)
        assert asked.outcomes == [QueryServoListResponse((1, 2, 3, 4))] * 300
        assert asked.contents == [bytes((4, 1, 2, 3, 4))] * 300

    asking(use, depth=depth)


def test_what_must_wait_is_not_sent() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        assert [asked.ask(), asked.ask()] == [True, False]
        await asyncio.sleep(0.01)
        assert [asked.ask(), len(fake.sent)] == [True, 2]

    asking(use)


async def test_more_can_be_asked_from_within_the_response() -> None:
    transport = VirtualTransport(VirtualBoard(2))
    connection = Connection(transport)
    await connection.open(handshake=False)
    heard = list[object]()

    def done(outcome: object, content: bytes | None) -> None:
        heard.append(outcome)
        if len(heard) < 5:
            assert connection.ask(QUERY, done)

    assert connection.ask(QUERY, done)
    await asyncio.sleep(1)
    assert heard == [QueryServoListResponse((1, 2))] * 5
    await connection.close()


def test_a_lost_query_is_repeated() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        fake.plan(QueryServoListRequest, LOST, SWALLOWED)
        assert asked.ask()
        await asyncio.sleep(2)
        assert asked.outcomes == [QueryServoListResponse((1, 2, 3, 4))]
        assert len(fake.sent_of(QueryServoListRequest)) == 3

    asking(use)
    asking(use, depth=4)


def test_a_query_is_given_up_like_any_other() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        fake.usual_of[QueryMemorySizeRequest] = SWALLOWED
        assert asked.ask(QueryMemorySizeRequest())
        await asyncio.sleep(10)
        assert [type(outcome) for outcome in asked.outcomes] == [RequestTimeout]
        assert asked.ask(QueryProjectIDRequest())
        await asyncio.sleep(1)
        assert asked.outcomes[1:] == [QueryProjectIDResponse(0)]

    asking(use)


def test_a_response_behind_a_false_start_is_there_once_that_is_given_up() -> None:
    false_start = HEADER["little"].pack(MAGIC, QueryServoResponse.packet_id, 1 + 11 * 200)

    async def use(asked: Asked, fake: PipedBoard) -> None:
        fake.plan(QueryServoListRequest, Fate(damage=lambda frame: false_start + frame))
        assert asked.ask()
        await asyncio.sleep(FIRST_TRY + 0.01)
        assert asked.outcomes == [QueryServoListResponse((1, 2, 3, 4))]
        assert len(fake.sent) == 1

    asking(use)


def test_a_late_response_is_taken_for_no_other() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        fake.plan(QueryServoListRequest, late(1.0))
        assert asked.ask()
        await asyncio.sleep(3)
        assert len(asked.outcomes) == 1

    asking(use)


def test_the_end_of_the_connection_is_an_error_for_all() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        assert asked.ask()
        assert asked.ask(QueryProjectIDRequest())
        fake.vanish()
        await asyncio.sleep(0.1)
        assert [type(outcome) for outcome in asked.outcomes] == [ConnectionLost] * 2
        with pytest.raises(ConnectionLost):
            asked.ask()

    asking(use, depth=2)


def test_many_equal_queries_at_once_have_fences_between_them() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        for _ in range(10):
            while asked.ask():
                pass
            await asyncio.sleep(0.1)
        assert asked.outcomes == [QueryServoListResponse((1, 2, 3, 4))] * len(asked.outcomes)
        assert len(asked.outcomes) == len(fake.sent_of(QueryServoListRequest)) > 100
        assert len(fake.sent) > len(asked.outcomes)

    asking(use, depth=16)


def test_a_line_that_takes_its_time_is_waited_for() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        fake.taking = asyncio.Event()
        assert asked.ask()
        await asyncio.sleep(0.01)
        fake.taking.set()
        await asyncio.sleep(0.01)
        assert asked.outcomes == [QueryServoListResponse((1, 2, 3, 4))]

    asking(use)


def test_a_line_that_is_lost_while_it_takes_a_query_is_an_error() -> None:
    class Failing(asyncio.Event):
        async def wait(self) -> Literal[True]:
            await asyncio.sleep(0.05)
            raise ConnectionLost("the device is gone")

    async def use(asked: Asked, fake: PipedBoard) -> None:
        fake.plan(QueryServoListRequest, SWALLOWED)
        fake.taking = Failing()
        assert asked.ask()
        await asyncio.sleep(0.1)
        assert [str(outcome) for outcome in asked.outcomes] == [
            f"the connection to {fake.url} is gone: the device is gone"
        ]

    asking(use)


def test_a_line_that_takes_nothing_any_more_is_an_error() -> None:
    async def use(asked: Asked, fake: PipedBoard) -> None:
        fake.gone = OSError("unplugged")  # who writes notices first
        assert asked.ask()
        await asyncio.sleep(0.1)
        assert [type(outcome) for outcome in asked.outcomes] == [ConnectionLost]
        with pytest.raises(ConnectionLost):
            asked.ask()

    asking(use)
