"""A stand-in for `connect` that leads through a hub: tests of the client run on it unchanged."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import AsyncExitStack
from typing import Any

from servolink.client import Board, connect
from servolink.hub.hub import share
from servolink.protocol import Codec
from tests.hub.local_transport import LocalTransport

UPSTREAM = ("byte_order", "caption_encoding", "transmission_mode", "patience", "depth", "write_depth", "profile")
"""Options of the connection between hub and board; all are those of the program, too."""


class connect_through_hub:  # noqa: N801 - stands for `connect`
    """Connect a hub to the board and a program to the hub."""

    def __init__(self, url: Any = None, *, handshake: bool = True, **options: Any) -> None:
        self._url = url
        self._options = options
        self._upstream = {name: options[name] for name in UPSTREAM if name in options}
        self._stack = AsyncExitStack()

    async def open(self) -> Board:
        enter = self._stack.enter_async_context
        upstream = await enter(connect(self._url, angle_unit=None, **self._upstream))
        hub = await enter(share(upstream, name="rex"))
        codec = Codec(upstream.codec.byte_order, upstream.codec.caption_encoding)
        options: dict[str, Any] = self._options | {"byte_order": codec.byte_order}
        board = await enter(connect(LocalTransport(hub, codec=codec), **options))
        vars(board)["_hub"] = self._stack  # which would end with this object
        return board

    def __await__(self) -> Generator[Any, None, Board]:
        return self.open().__await__()

    async def __aenter__(self) -> Board:
        return await self.open()

    async def __aexit__(self, *error: object) -> None:
        await self._stack.aclose()
