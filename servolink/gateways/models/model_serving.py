"""Server of the tools for language models, on standard input and output or on HTTP of this machine."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import Callable
from contextlib import nullcontext
from socket import socket
from typing import Any, Final

import uvicorn  # pyright: ignore[reportMissingImports]
from mcp.server.mcpserver import MCPServer  # pyright: ignore[reportMissingImports]
from mcp.server.transport_security import TransportSecuritySettings  # pyright: ignore[reportMissingImports]
from starlette.responses import Response  # pyright: ignore[reportMissingImports]
from uvicorn.protocols.http.h11_impl import H11Protocol  # pyright: ignore[reportMissingImports]

from servolink.transports import NetworkPlace, Pace, Stranger, Strangers, accepting, converse

HOST: Final = "127.0.0.1"
PATH: Final = "/mcp"

_CLOSE = {"Connection": "close"}  # another attempt needs another connection
_MOST_BODY = 1024 * 1024  # bytes of a request
_TOKEN_LIMIT = 10.0  # seconds until a connection must have shown the token


async def serve_on_stdio(server: MCPServer) -> None:
    """Serve until the client closes standard input. A client that was killed does not read the last words."""
    try:
        await server.run_stdio_async()
    except* OSError:
        pass


async def serve_on_http(server: MCPServer, port: int, announce: Callable[[str, str], None]) -> None:
    """Serve until cancelled; `announce` gets the address and the token that each request must have.

    Requests with a `Host` or an `Origin` other than this machine are refused (DNS rebinding). Raise OpenError for a
    port in use.
    """
    token = secrets.token_urlsafe(32)
    sockets = await NetworkPlace(HOST, port).listen()
    names = [f"{name}:{sockets[0].getsockname()[1]}" for name in (HOST, "localhost")]
    security = TransportSecuritySettings(
        enable_dns_rebinding_protection=True,
        allowed_hosts=names,
        allowed_origins=[f"http://{name}" for name in names],
    )
    app = server.streamable_http_app(
        streamable_http_path=PATH, transport_security=security, max_request_body_size=_MOST_BODY
    )
    config = uvicorn.Config(app, log_level="warning", lifespan="off", ws="none", timeout_graceful_shutdown=1)
    config.load()
    http = uvicorn.Server(config)
    http.capture_signals = nullcontext  # type: ignore[assignment,method-assign,unused-ignore]  # the command has its own
    turn = asyncio.Lock()

    async def serve(accepted: socket, stranger: Stranger) -> None:
        await converse(_ModelConnection(config, http.server_state, token, stranger, turn), accepted)

    async with (
        server.session_manager.run(),  # not as the lifespan of uvicorn, which logs the end as an error
        accepting(sockets, serve, seconds=_TOKEN_LIMIT),
    ):
        announce(f"http://{NetworkPlace.of(sockets)}{PATH}", token)
        await http.serve([])


class _ModelConnection(H11Protocol):  # type: ignore[misc,unused-ignore]  # without the extra it is Any
    """Connection that is a stranger until a request on it has the token."""

    def __init__(self, config: Any, state: Any, token: str, stranger: Stranger, turn: asyncio.Lock) -> None:
        super().__init__(config, state, {})
        self.closed = asyncio.Event()
        """Set when the connection has ended."""
        self.app = _Guarded(self.app, token, stranger, Pace(turn))

    def connection_lost(self, exc: Exception | None) -> None:
        """Note the end."""
        super().connection_lost(exc)
        self.closed.set()


class _Guarded:
    """Application of one connection, which admits requests with the token."""

    def __init__(self, app: Any, token: str, stranger: Stranger, pace: Pace) -> None:
        self._app = app
        self._expected = f"Bearer {token}".encode()
        self._stranger = stranger
        self._pace = pace

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Serve a request; one without the token gets the status 401, and one connection too many 503."""
        headers = dict(scope["headers"])
        given = headers.get(b"authorization", b"")
        if not secrets.compare_digest(given, self._expected):
            await Response("the token is missing or wrong\n", 401, _CLOSE)(scope, receive, send)
        elif not self._stranger.admit(self._expected, Strangers.most_connections()):
            await Response("too many connections are open; close some\n", 503, _CLOSE)(scope, receive, send)
        else:
            length = int(headers.get(b"content-length", _MOST_BODY if b"transfer-encoding" in headers else 0))
            await self._pace.keep(min(length, _MOST_BODY))
            await self._app(scope, receive, send)
