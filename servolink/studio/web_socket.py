"""Door of the studio for browsers: a WebSocket that shows a token, and then carries the messages of a page."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import msgspec
from aiohttp import WSCloseCode, WSMsgType, web

from servolink.studio import firmware_methods, fleet_methods  # add what a page without a server cannot have
from servolink.studio.gate import Gate
from servolink.studio.page import MOST_MESSAGE, Hello, serve_page
from servolink.studio.studio_methods import Studio
from servolink.transports import Stranger, Strangers

__all__ = ["firmware_methods", "fleet_methods", "serve_web_socket"]

_TOKEN_LIMIT = 5.0  # seconds for the first message
_BAD_TOKEN = 4401  # code for closing the socket
_MOST_REASON = 120  # bytes
_PINGS = (WSMsgType.PING, WSMsgType.PONG)
_PING_PAUSE = 0.1  # seconds between two pings of programs that are no browsers
_FILES = 3  # of a page: its connection, and both ends of its connection with a hub of this process


async def serve_web_socket(studio: Studio, gate: Gate, request: web.Request, stranger: Stranger) -> web.StreamResponse:
    """Talk with a page until it is closed, or the hub ends; admit the connection when the page shows a token."""
    messages = web.WebSocketResponse(max_msg_size=MOST_MESSAGE, compress=False, heartbeat=15, autoping=False)
    await messages.prepare(request)
    line = _WebSocketLine(messages)
    hello = await _hello(messages)
    role = None if hello is None else gate.role_of(hello.token)
    if hello is None or role is None:
        await line.close(_BAD_TOKEN, "open the address that the studio prints")
        return messages
    is_link = studio.is_link(hello.token)
    # Links leave room for each other.
    most = Strangers.most_connections() * 3 // 4 if is_link else Strangers.most_admitted()
    if stranger.admit(hello.token, most, files=_FILES):
        await serve_page(studio, hello, role, line, is_link=is_link)
    else:
        text = "too many pages are open through this link; close some" if is_link else "too many pages are open"
        await line.close(WSCloseCode.TRY_AGAIN_LATER, text)
    return messages


async def _hello(messages: web.WebSocketResponse) -> Hello | None:
    with suppress(TimeoutError, msgspec.MsgspecError, TypeError):
        return msgspec.json.decode(await messages.receive_str(timeout=_TOKEN_LIMIT), type=Hello)
    return None


class _WebSocketLine:
    """Messages of a page over a WebSocket."""

    def __init__(self, messages: web.WebSocketResponse) -> None:
        self._messages = messages
        self._pinged = -_PING_PAUSE

    async def receive(self) -> str | None:
        """Return the next text, and answer pings; None for the end, or for anything else."""
        async for message in self._messages:
            if message.type in _PINGS and self._is_rare_ping():
                if message.type is WSMsgType.PING:
                    await self._messages.pong(message.data)
                continue
            return str(message.data) if message.type is WSMsgType.TEXT else None
        return None

    def _is_rare_ping(self) -> bool:
        """Return whether a ping or pong comes long after the last one; they are not paced."""
        before, self._pinged = self._pinged, asyncio.get_running_loop().time()
        return self._pinged - before >= _PING_PAUSE

    async def send(self, text: str) -> None:
        """Send a text."""
        await self._messages.send_str(text)

    async def close(self, code: int, why: str = "") -> None:
        """Close the WebSocket."""
        await self._messages.close(code=code, message=why.encode()[:_MOST_REASON])
