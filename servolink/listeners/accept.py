"""Accept connections, prepare their sockets alike, and keep their tasks until the end."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from typing import Any, TypeAlias

from servolink.escaping import escape
from servolink.platforms.process import most_open_files
from servolink.tasks import Tasks
from servolink.transports.stream import keep_alive

Serve: TypeAlias = Callable[[socket.socket], Coroutine[Any, Any, None]]
"""Coroutine function that serves and closes one connection. OSError means that the client is gone already."""

_ACCEPT_PAUSE = 1.0  # seconds between attempts while no connection can be accepted
_WARNING_PAUSE = 60.0  # seconds between two warnings of the same
_MOST_CONNECTIONS = 4096  # connections to an address, where the system has no limit or a high one
_SEND_BUFFER = 64 * 1024  # bytes in the system; its default gives MiB to each client that does not read
_logger = logging.getLogger(__name__)


@asynccontextmanager
async def accepting(listening: Sequence[socket.socket], serve: Serve, *, linger: float = 0.0) -> AsyncIterator[None]:
    """Run `serve` with each connection to these sockets; the sockets are closed when the context ends.

    At the end, conversations that do not end within `linger` seconds are cancelled.
    """
    conversations = Tasks()

    def start(connection: socket.socket) -> None:
        task = conversations.begin(_serve(connection, serve))
        task.add_done_callback(lambda _: connection.close() if task.cancelled() else None)  # perhaps before it began

    tasks = [asyncio.ensure_future(_accept(each, start)) for each in listening]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        for each in listening:
            each.close()
        await conversations.close(linger=linger)
        await asyncio.sleep(0)  # in which asyncio closes aborted connections


async def _accept(listening: socket.socket, start: Callable[[socket.socket], None]) -> None:
    loop, warning = asyncio.get_running_loop(), RareWarning()
    while True:
        try:
            connection, _ = await loop.sock_accept(listening)
        except OSError as error:  # out of descriptors or memory: clients wait in the system until others have gone
            warning.log("no connection can be accepted, trying again each second: %s", escape(str(error)))
            await asyncio.sleep(_ACCEPT_PAUSE)
        else:
            start(connection)


async def _serve(connection: socket.socket, serve: Serve) -> None:
    try:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        if connection.family in {socket.AF_INET, socket.AF_INET6}:
            keep_alive(connection, idle=60, interval=15, count=4)
            # asyncio does this only for sockets with a protocol number, which accepted ones lack.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        await serve(connection)
    except OSError:
        connection.close()


def most_connections() -> int:
    """Return the most connections that strangers may have to an address: a quarter of the open files allowed.

    Strangers could otherwise take all files of this process, and nobody could connect to stop the board.
    """
    files = most_open_files()
    return _MOST_CONNECTIONS if files is None else min(max(files // 4, 1), _MOST_CONNECTIONS)


class RareWarning:
    """Warning that is logged at most once a minute, however often the cause recurs."""

    def __init__(self) -> None:
        self._now = asyncio.get_running_loop().time
        self._logged_at = -_WARNING_PAUSE

    def log(self, text: str, *args: object) -> None:
        """Log `text % args`, unless a warning was logged less than a minute ago."""
        if self._now() - self._logged_at >= _WARNING_PAUSE:
            self._logged_at = self._now()
            _logger.warning(text, *args)
