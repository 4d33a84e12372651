"""Connections: those to the studio's server that have sent no request are few, and closed after a while.

Every program that reaches the port can open connections, and each takes a descriptor that the hub here needs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from socket import socket

from aiohttp.web import RequestHandler

HEAD_LIMIT = 10.0
"""Seconds in which the first request must have come; browsers also connect in advance."""
MOST_SILENT = 32
"""Connections without a request; when there are more, the oldest are closed."""


class Connections:
    """Serves the connections to a server."""

    def __init__(self) -> None:
        """Start without any."""
        self._silent: dict[RequestHandler, asyncio.TimerHandle] = {}  # the oldest first

    async def serve(self, make: Callable[[], RequestHandler], accepted: socket) -> None:
        """Let a handler that `make` returns serve a connection."""
        loop = asyncio.get_running_loop()
        try:
            _, handler = await loop.connect_accepted_socket(make, accepted)
        except OSError:
            accepted.close()  # the browser is gone already
            return
        self._silent[handler] = loop.call_later(HEAD_LIMIT, self._drop, handler)
        while len(self._silent) > MOST_SILENT:
            self._drop(next(iter(self._silent)))

    def heard(self, handler: RequestHandler) -> None:
        """Keep a connection: a request has come."""
        if (timer := self._silent.pop(handler, None)) is not None:
            timer.cancel()

    def close(self) -> None:
        """Forget all of them."""
        for handler in list(self._silent):
            self.heard(handler)

    def _drop(self, handler: RequestHandler) -> None:
        self.heard(handler)
        handler.force_close()
