"""Connections of the studio: few without a token, so that a flood of them keeps nobody from stopping the board."""

from __future__ import annotations

import asyncio
import logging
from functools import partial
from socket import socket
from typing import Any, TypeAlias

from aiohttp import web

from servolink.listeners.accept import most_connections

HEADERS = {
    # Forbids other origins, inline code and frames.
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
        "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "Cache-Control": "no-cache",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), microphone=(), geolocation=()",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of each response."""
HEAD_LIMIT = 10.0
"""Seconds until the first request must have come; browsers also connect in advance."""
MOST_STRANGERS = 256
"""Most connections without a token, and at most a quarter of the open files allowed; the oldest make room."""
_OPTIONS: dict[str, Any] = {"access_log": None, "keepalive_timeout": 15.0}  # seconds for another request
_SERVER_ERROR = 500
_logger = logging.getLogger(__name__)

_Timers: TypeAlias = "dict[PageConnection, asyncio.TimerHandle]"


class Connections:
    """Connections to the server. Any program that reaches the port can open them, and the hub needs descriptors too."""

    def __init__(self) -> None:
        self._strangers: _Timers = {}  # the oldest first
        self._most = min(MOST_STRANGERS, most_connections())

    async def serve(self, server: web.Server, accepted: socket) -> None:
        """Let `server` handle an accepted connection."""
        loop = asyncio.get_running_loop()
        try:
            await loop.connect_accepted_socket(partial(PageConnection, self._strangers, server, loop), accepted)
        except OSError:
            accepted.close()  # the browser is gone already
            return
        while len(self._strangers) > self._most:
            next(iter(self._strangers)).drop()

    def close(self) -> None:
        """Drop the connections without a token."""
        for connection in list(self._strangers):
            connection.drop()


class PageConnection(web.RequestHandler):
    """Connection of a browser: one of the strangers, until a page on it shows a token."""

    def __init__(self, strangers: _Timers, server: web.Server, loop: asyncio.AbstractEventLoop) -> None:
        """Prepare to join `strangers` when the connection is made."""
        super().__init__(server, loop=loop, **_OPTIONS)
        self._strangers = strangers
        self._clock = loop

    def heard(self) -> None:
        """Cancel the limit for the first request: it has come."""
        if (limit := self._strangers.get(self)) is not None:
            limit.cancel()

    def admit(self) -> None:
        """Keep the connection, however many strangers come: its page has a token."""
        self.heard()
        self._strangers.pop(self, None)

    def drop(self) -> None:
        """End the connection at once, with what the browser has not read yet."""
        self.admit()
        if self.transport is not None:
            self.transport.abort()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Join the strangers."""
        super().connection_made(transport)
        self._strangers[self] = self._clock.call_later(HEAD_LIMIT, self.drop)

    def connection_lost(self, exc: BaseException | None) -> None:
        """Leave the strangers."""
        self.admit()
        super().connection_lost(exc)

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = _SERVER_ERROR,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        """Return the response to a request that is malformed, too long, or failed in the studio."""
        if isinstance(exc, ConnectionResetError):  # gone, or dropped to make room, before the response began
            _logger.debug("a request for %r was not answered: the connection has ended", request.path)
        elif status >= _SERVER_ERROR:
            _logger.error("a request for %r failed", request.path, exc_info=exc)
        text = "the studio cannot handle this request\n"
        response = web.Response(status=status, text=text, headers=HEADERS)
        response.force_close()
        return response

    def log_exception(self, *args: object, **_: object) -> None:
        """Log what a client alone can cause, such as a body that ends in the middle, for developers only."""
        _logger.debug(*args)
