"""Connections of servers on HTTP: strangers until a handler admits them."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from socket import socket
from typing import Any

from aiohttp import web

from servolink.transports.listeners.accept import accepting, converse
from servolink.transports.listeners.pacing import Pace
from servolink.transports.listeners.strangers import Stranger

ANSWER_LIMIT = 60.0
"""Seconds from a request of a stranger to the next request."""
_OPTIONS: dict[str, Any] = {"access_log": None, "keepalive_timeout": 15.0}  # seconds for another request
_SERVER_ERROR = 500
_logger = logging.getLogger(__name__)


class HttpServing:
    """Serves accepted connections by an aiohttp server; errors are answered with `headers`."""

    HEAD_LIMIT = 10.0
    """Seconds until the first request must have come; browsers also connect in advance."""

    def __init__(self, server: web.Server, headers: Mapping[str, str]) -> None:
        """Serve no connection yet."""
        self._server = server
        self._headers = headers
        self._turn = asyncio.Lock()

    @staticmethod
    def connection_of(request: web.BaseRequest) -> HttpConnection:
        """Return the connection of a request."""
        connection = request.protocol
        assert isinstance(connection, HttpConnection)  # noqa: S101 - narrows the type
        return connection

    def accepting(self, listening: Sequence[socket]) -> AbstractAsyncContextManager[None]:
        """Serve each connection to these sockets; the sockets are closed when the context ends."""
        return accepting(listening, self.serve, seconds=self.HEAD_LIMIT)

    async def serve(self, accepted: socket, stranger: Stranger) -> None:
        """Serve a connection until its end."""
        loop = asyncio.get_running_loop()
        await converse(HttpConnection(stranger, Pace(self._turn), self._headers, self._server, loop=loop), accepted)


class HttpConnection(web.RequestHandler):
    """Connection of a browser or another client."""

    def __init__(
        self,
        stranger: Stranger,
        pace: Pace,
        headers: Mapping[str, str],
        server: web.Server,
        *,
        loop: asyncio.AbstractEventLoop,
    ) -> None:
        """Prepare for the connection of `stranger`, whose requests keep `pace`."""
        super().__init__(server, loop=loop, **_OPTIONS)
        self.stranger = stranger
        """Place among the connections of this process."""
        self.closed = asyncio.Event()
        """Set when the connection has ended."""
        self._pace = pace
        self._headers = headers

    async def heard(self) -> None:
        """Give a stranger the time for a request that has come; return when the request may be handled."""
        self.stranger.allow(ANSWER_LIMIT)
        await self._pace.keep(0)

    def connection_lost(self, exc: BaseException | None) -> None:
        """Note the end."""
        super().connection_lost(exc)
        self.closed.set()

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = _SERVER_ERROR,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        """Return the response to a request that is malformed, too long, or failed in the server."""
        if isinstance(exc, ConnectionResetError):  # gone, or dropped to make room, before the response began
            _logger.debug("a request for %r was not answered: the connection has ended", request.path)
        elif status >= _SERVER_ERROR:
            _logger.error("a request for %r failed", request.path, exc_info=exc)
        response = web.Response(status=status, text="this request cannot be handled\n", headers=self._headers)
        response.force_close()
        return response

    def log_exception(self, *args: object, **_: object) -> None:
        """Log what a client alone can cause, such as a body that ends in the middle, for developers only."""
        _logger.debug(*args)
