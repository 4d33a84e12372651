"""Boards that come back by themselves."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from servolink import (
    Board,
    connect,
)


@asynccontextmanager
async def connected(url: str = "virtual://", **options: object) -> AsyncIterator[Board]:
    async with connect(url, reconnect=True, **options) as board:  # type: ignore[arg-type]
        yield board


async def until(board: Board, state: str) -> None:
    async for now in board.states():
        if now == state:
            return
