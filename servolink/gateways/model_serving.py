"""Server of the tools for language models, on standard input and output or on HTTP of this machine."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, Final

import uvicorn  # pyright: ignore[reportMissingImports]
from mcp.server.mcpserver import MCPServer  # pyright: ignore[reportMissingImports]
from mcp.server.transport_security import TransportSecuritySettings  # pyright: ignore[reportMissingImports]
from starlette.responses import Response  # pyright: ignore[reportMissingImports]

from servolink.listeners.tcp import listening_sockets, place_of

HOST: Final = "127.0.0.1"
PATH: Final = "/mcp"


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
    names = [f"{name}:*" for name in (HOST, "localhost")]
    security = TransportSecuritySettings(
        enable_dns_rebinding_protection=True,
        allowed_hosts=names,
        allowed_origins=[f"http://{name}" for name in names],
    )
    app = server.streamable_http_app(streamable_http_path=PATH, transport_security=security)
    config = uvicorn.Config(_Guarded(app, token), log_level="warning", lifespan="off", timeout_graceful_shutdown=1)
    http = uvicorn.Server(config)
    http.capture_signals = nullcontext  # type: ignore[assignment,method-assign,unused-ignore]  # the command has its own
    sockets = await listening_sockets(HOST, port)
    announce(f"http://{place_of(sockets)}{PATH}", token)
    async with server.session_manager.run():  # not as the lifespan of uvicorn, which logs the end as an error
        await http.serve(sockets)


class _Guarded:
    """Application that admits requests with the token."""

    def __init__(self, app: Any, token: str) -> None:
        self._app = app
        self._expected = f"Bearer {token}".encode()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Serve a request; one without the token gets the status 401."""
        given = dict(scope["headers"]).get(b"authorization", b"")
        if secrets.compare_digest(given, self._expected):
            await self._app(scope, receive, send)
        else:
            await Response("the token is missing or wrong\n", 401)(scope, receive, send)
