"""Requests without a response, and damaged responses."""

from __future__ import annotations

from typing import Any

from servolink.connection.connection import Connection
from servolink.connection.fences import FENCES
from servolink.protocol import (
    Packet,
    QueryProjectIDRequest,
    QueryServoListRequest,
    Request,
)
from tests.client.piped_board import PipedBoard

PROJECT = QueryProjectIDRequest()
LIST = QueryServoListRequest()
FENCE_KINDS = tuple(type(fence) for fence in FENCES)


def cut_content(frame: bytes) -> bytes:
    """Return a frame with right length and sum whose count field says one more than there is."""
    content = bytearray(frame[8:-1])
    content[0] += 1
    body = frame[:8] + bytes(content)
    return body + bytes((sum(body) & 0xFF,))


async def ask_for_ever(connection: Connection, packet: Request[Any]) -> None:
    while True:
        await connection.request(packet)


def kinds(board: PipedBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]
