"""Taps: they hear every byte and every outcome, on all connections to a board, and cost nothing while there is none."""

from __future__ import annotations

import pytest

from servolink.client import connect
from servolink.connection.taps import Tap
from servolink.errors import ConnectionLost, MotionRefused, RequestTimeout
from servolink.protocol import Codec, ExecuteActionRequest, FrameParser, Packet, QueryServoRequest
from tests.client.piped_board import PipedBoard, connected, opened


class Ears(Tap):
    """Keeps what it hears."""

    def __init__(self) -> None:
        self.bytes_sent = bytearray()
        self.bytes_received = bytearray()
        self.outcomes: list[tuple[Packet, object]] = []

    def sent(self, data: bytes) -> None:
        self.bytes_sent += data

    def received(self, data: bytes) -> None:
        self.bytes_received += data

    def ended(self, packet: Packet, outcome: object, seconds: float) -> None:
        assert seconds >= 0
        self.outcomes.append((packet, outcome))

    def packets(self, heard: bytearray) -> list[Packet]:
        codec = Codec()
        return [codec.decode(*frame) for frame in FrameParser("little").feed(bytes(heard))]


async def test_it_hears_what_is_counted() -> None:
    async with connected(PipedBoard()) as connection:
        ears = Ears()
        end = connection.taps.add(ears)
        sent, received = connection.stats.bytes_sent, connection.stats.bytes_received
        response = await connection.request(QueryServoRequest(1))
        assert len(ears.bytes_sent) == connection.stats.bytes_sent - sent
        assert len(ears.bytes_received) == connection.stats.bytes_received - received
        assert ears.packets(ears.bytes_sent) == [QueryServoRequest(1)]
        assert ears.packets(ears.bytes_received) == [response]
        end()
        end()
        await connection.request(QueryServoRequest(1))
        assert ears.packets(ears.bytes_sent) == [QueryServoRequest(1)]


async def test_it_hears_what_became_of_commands_and_of_failed_queries() -> None:
    board = PipedBoard()
    async with opened(board, angle_limits=(-30, 30), patience=0.1) as client:
        await client.servos()
        ears = Ears()
        client.connection.taps.add(ears)
        await client.move({1: 10}, speed=90)
        with pytest.raises(MotionRefused):
            await client.move({1: 90}, speed=90)
        await client.stop()
        kinds = [type(packet).__name__ for packet, _ in ears.outcomes]
        assert kinds[0] == "ExecuteActionRequest"
        assert "SetServoParameterRequest" in kinds
        assert sum(isinstance(packet, ExecuteActionRequest) for packet, _ in ears.outcomes) == 1
        ears.outcomes.clear()
        await client.servos()
        assert ears.outcomes == []
        board.vanish()
        with pytest.raises((RequestTimeout, ConnectionLost)):
            await client.servos()
        ((packet, outcome),) = ears.outcomes
        assert isinstance(packet, QueryServoRequest)
        assert isinstance(outcome, RequestTimeout | ConnectionLost)


async def test_it_hears_the_first_byte_of_each_connection() -> None:
    board, ears = PipedBoard(), Ears()
    connecting = connect(board)
    connecting.taps.add(ears)
    async with connecting as client:
        assert len(ears.bytes_sent) == client.stats.bytes_sent > 0
        assert len(ears.bytes_received) == client.stats.bytes_received > 0
