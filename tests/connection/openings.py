"""Boards that a connection is opened to, with requests of an earlier program unanswered."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from random import Random
from typing import Any

from servolink.connection.connection import Connection
from servolink.connection.fences import FENCES, LISTS
from servolink.protocol import (
    ALL_SERVOS,
    Packet,
    QueryServoListRequest,
    Request,
    SetServoParameterRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LOST, PipedBoard, connected

FENCE_KINDS = tuple(type(fence) for fence in FENCES)
LIST_KINDS = tuple(type(query) for query in LISTS)
LIST = QueryServoListRequest()
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)


@asynccontextmanager
async def opening(board: PipedBoard, *, seed: int = 1, **options: Any) -> AsyncIterator[Connection]:
    """Open a connection whose handshake begins when somebody wants it."""
    async with connected(board, handshake=True, random=Random(seed), **options) as connection:
        yield connection


async def owe(board: PipedBoard, *requests: tuple[Request[Any], Fate]) -> None:
    """Send what a program sends that is killed before it is answered."""
    for request, fate in requests:
        board.plan(type(request), fate)
        await board.send(board.codec.encode(request))
    board.sent.clear()


def without(board: PipedBoard, *missing: type[Packet]) -> PipedBoard:
    """Let `board` leave requests of these kinds unanswered."""
    board.usual_of |= dict.fromkeys(missing, LOST)
    return board


def kinds(board: PipedBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]
