"""ResponseWatchdog: what becomes of the deadlines while bytes come, or none."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from servolink.connection.connection import Connection
from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    ALL_SERVOS,
    HEADER,
    AddActionRequest,
    ButtonEventResponse,
    ClearAllDataRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    QueryServoResponse,
    Request,
    WriteProjectIDRequest,
)
from servolink.testing import Fate
from servolink.transports import Receiver
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, connected, now
from tests.virtual_time import VirtualTimeLoop

ALL = QueryServoRequest(ALL_SERVOS)


def false_start(servos: int) -> bytes:
    """Return the header of an answer with that many servos, of which nothing follows."""
    return HEADER["little"].pack(b"\x13\x4c\x05\x1d", QueryServoResponse.packet_id, 1 + 11 * servos)


class SlowLine(PipedBoard):
    """Every answer comes in pieces, one every `pause` seconds, and no more than `pieces` of them."""

    def __init__(self, *, size: int, pause: float, pieces: int = 1_000_000, servos: int = 200) -> None:
        super().__init__(servos=servos)
        self.size, self.pause, self.pieces = size, pause, pieces

    def deliver(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        for number, at in enumerate(range(0, len(data), self.size)):
            if number < self.pieces:
                loop.call_later(number * self.pause, super().deliver, data[at : at + self.size])


class WiredBoard(PipedBoard):
    """Answers come over a real line, `piece` bytes in a turn of the loop, which stalls as soon as one has arrived."""

    def __init__(self, piece: int, stall: float) -> None:
        super().__init__()
        self.piece, self.stall = piece, stall
        self.near, self.far = socket.socketpair()
        self.near.setblocking(False)

    async def open(self, receiver: Receiver) -> None:
        await super().open(receiver)
        asyncio.get_running_loop().add_reader(self.near, lambda: receiver.data(self.near.recv(self.piece)))

    async def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self.near)
        self.near.close()
        self.far.close()
        await super().close()

    def deliver(self, data: bytes) -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        self.far.sendall(data)
        loop.stall(self.stall)


@asynccontextmanager
async def wired(piece: int, stall: float, **options: Any) -> AsyncIterator[tuple[WiredBoard, Connection]]:
    board = WiredBoard(piece, stall)
    async with connected(board, **options) as connection:
        yield board, connection


# --- a stalled loop -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("piece", [1, 5, 4096])
@pytest.mark.parametrize("packet", [QueryServoListRequest(), WriteProjectIDRequest(1), ClearAllDataRequest(), ALL])
async def test_a_response_that_arrived_in_time_is_no_timeout_however_long_the_loop_was_busy(
    piece: int, packet: Request[Any]
) -> None:
    async with wired(piece, stall=60) as (board, connection):
        assert await connection.request(packet)
        assert now() > 1050
        assert connection.stats.timeouts == connection.stats.fences == 0
        assert len(board.sent) == 1


@pytest.mark.parametrize("piece", [1, 5, 4096])
@pytest.mark.parametrize("packet", [QueryServoListRequest(), AddActionRequest(1)])
async def test_a_response_to_a_fence_that_arrived_in_time_counts_however_long_the_loop_was_busy(
    piece: int, packet: Request[Any]
) -> None:
    async with wired(piece, stall=60) as (board, connection):
        board.plan(type(packet), LOST)
        with pytest.raises((OutcomeUnknown, RequestTimeout)):
            await connection.request(packet, timeout=0.1)
        assert await connection.request(packet)
        assert connection.stats.fences == 1
        assert len(board.sent) == 3


async def test_a_response_that_comes_after_its_deadline_is_late_though_the_loop_was_busy() -> None:
    async with wired(4096, stall=0) as (board, connection):
        board.plan(AddActionRequest, SWALLOWED)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.call_later(0.5, loop.stall, 30)
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1))


async def test_a_flood_of_events_puts_no_deadline_off() -> None:
    async with wired(22, stall=0) as (board, connection):
        board.plan(AddActionRequest, SWALLOWED)
        waiting = asyncio.create_task(connection.request(AddActionRequest(1)))
        await asyncio.sleep(0.999_999)
        event = board.codec.encode(ButtonEventResponse(1, 1))
        for _ in range(5_000):
            board.far.send(event)
            await asyncio.sleep(0 if now() >= 1001 else 1e-6)
            if connection.stats.timeouts:
                break
        assert connection.stats.timeouts == 1
        waiting.cancel()
        assert connection.stats.events_received > 10


# --- partial frames -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("starts", [1, 2, 3])
async def test_false_starts_that_hold_a_good_response_back_are_given_up_at_its_deadline(starts: int) -> None:
    board = PipedBoard()
    noise = b"".join(false_start(250 - number) for number in range(starts))
    board.plan(QueryServoListRequest, Fate(damage=lambda frame: noise + frame))
    async with connected(board) as connection:
        begun = now()
        assert (await connection.request(QueryServoListRequest())).servo_id_list == (1, 2, 3, 4)
        assert now() == begun + 0.25
        assert connection.stats.timeouts == connection.stats.retries == 0
        assert connection.stats.skipped["incomplete"] > 0


async def test_a_short_silence_gives_up_nothing() -> None:
    board = SlowLine(size=10, pause=0.2, servos=1)
    async with connected(board) as connection:
        assert len((await connection.request(ALL)).servos) == 1
        assert sum(connection.stats.skipped.values()) == 0


async def test_a_long_response_that_is_still_arriving_at_its_deadline_is_waited_for() -> None:
    board = SlowLine(size=22, pause=0.05)
    async with connected(board) as connection:
        begun = now()
        assert len((await connection.request(ALL)).servos) == 200
        assert 4 < now() - begun < 6
        assert connection.stats.timeouts == 0
        assert len(board.sent) == 1


async def test_who_is_cancelled_leaves_a_long_response_time_to_arrive() -> None:
    board = SlowLine(size=22, pause=0.05)
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(ALL))
        await asyncio.sleep(0.5)
        waiting.cancel()
        board.size = 4096
        assert len((await connection.request(QueryServoListRequest())).servo_id_list) == 200
        assert connection.stats.timeouts == connection.stats.fences == 0


async def test_a_response_that_stops_arriving_is_given_up_at_the_next_deadline() -> None:
    board = SlowLine(size=220, pause=0.2, pieces=4)
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(ALL))
        begun = now()
        await asyncio.sleep(1.1)
        first, second = board.sent_of(QueryServoRequest)
        assert first == begun
        assert second == pytest.approx(begun + 1)  # pieces at 0, 0.2, 0.4, 0.6: seen at 0.25, 0.5, 0.75, not at 1
        waiting.cancel()


async def test_a_trickle_is_not_waited_for_for_ever() -> None:
    board = SlowLine(size=8, pause=0.1)
    async with connected(board) as connection:
        waiting = asyncio.create_task(connection.request(ALL))
        await asyncio.sleep(1.5)
        assert len(board.sent) > 1
        waiting.cancel()


async def test_the_response_to_something_else_that_arrives_in_pieces_is_waited_for_too() -> None:
    """It shows that the board is at work, and at its end whether the response that is due was lost."""
    board = SlowLine(size=22, pause=0.02)
    board.plan(QueryServoListRequest, LOST)
    async with connected(board, depth=2) as connection:
        begun = now()
        servo_ids, states = await asyncio.gather(connection.request(QueryServoListRequest()), connection.request(ALL))
        assert len(states.servos) == len(servo_ids.servo_id_list) == 200
        assert board.sent[2][0] == pytest.approx(begun + 2, abs=0.1)
        assert connection.stats.timeouts == 0


async def test_another_response_that_is_arriving_moves_no_deadline() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, Fate(damage=lambda frame: false_start(200) + bytes(1000)))
    async with connected(board) as connection:
        begun = now()
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1))
        assert board.sent[1][0] == begun + 1  # a fence


async def test_something_else_that_has_just_begun_to_arrive_is_waited_for_as_long_as_more_of_it_comes() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, SWALLOWED)
    async with connected(board) as connection:
        begun = now()
        waiting = asyncio.create_task(connection.request(AddActionRequest(1)))
        await asyncio.sleep(0.98)
        board.deliver(false_start(200))
        await asyncio.sleep(0.04)
        assert len(board.sent) == 1
        board.deliver(bytes(8))
        with pytest.raises(OutcomeUnknown):
            await waiting
        assert board.sent[1][0] == pytest.approx(begun + 1.07)  # a fence, after 50 ms without a byte


async def test_something_else_that_arrives_for_ever_puts_a_deadline_off_by_a_second_at_most() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, SWALLOWED)
    async with connected(board) as connection:
        begun = now()
        waiting = asyncio.create_task(connection.request(AddActionRequest(1)))
        await asyncio.sleep(0.9)
        board.deliver(false_start(200))
        for number in range(200):
            asyncio.get_running_loop().call_later(number * 0.02, board.deliver, bytes(1))
        with pytest.raises(OutcomeUnknown):
            await waiting
        assert begun + 1.5 < board.sent[1][0] <= begun + 2.1  # a fence


async def test_each_of_several_on_the_line_has_its_own_deadline() -> None:
    board = PipedBoard(usual=LOST)
    async with connected(board, depth=3) as connection:
        begun = now()
        ends: list[float] = []

        async def ask(packet: Request[Any], timeout: float) -> None:
            with pytest.raises((RequestTimeout, OutcomeUnknown)):
                await connection.request(packet, timeout=timeout)
            ends.append(now() - begun)

        await asyncio.gather(
            ask(QueryProjectIDRequest(), 0.75),
            ask(AddActionRequest(1), 0.25),
            ask(QueryMemorySizeRequest(), 0.5),
        )
        assert ends == [0.25, 0.5, 0.75]
