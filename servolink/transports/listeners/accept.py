"""Accept connections, prepare their sockets alike, and keep their tasks until the end."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager
from typing import Any, Protocol, TypeAlias, cast

from servolink.errors import escape
from servolink.support import Tasks
from servolink.transports.listeners.strangers import Stranger, Strangers, strangers_of_network
from servolink.transports.stream import keep_alive

Serve: TypeAlias = Callable[[socket.socket, Stranger], Coroutine[Any, Any, None]]
"""Coroutine function that serves and closes a connection, and admits the stranger for a token, handshake or frame.

OSError means that the client is gone already. To make room, the task of a stranger is cancelled, and must end at once.
"""

_ACCEPT_PAUSE = 0.1  # seconds between attempts while no connection can be accepted: a stop may be waiting
_WARNING_PAUSE = 60.0  # seconds between two warnings of the same
_SEND_BUFFER = 64 * 1024  # bytes in the system; its default gives MiB to each client that does not read
_logger = logging.getLogger(__name__)


@asynccontextmanager
async def accepting(
    listening: Sequence[socket.socket],
    serve: Serve,
    *,
    linger: float = 0.0,
    seconds: float | None = None,
    strangers: Strangers | None = None,
) -> AsyncIterator[None]:
    """Run `serve` with each connection to these sockets; the sockets are closed when the context ends.

    Connections not admitted within `seconds` are dropped, and so are the oldest of too many `strangers`; the default is
    the strangers of all doors to the network. At the end, conversations are cancelled after `linger` seconds.
    """
    conversations = Tasks()
    group = strangers or strangers_of_network()

    def start(connection: socket.socket) -> None:
        def begin(stranger: Stranger) -> asyncio.Task[None]:
            task = conversations.begin(_serve(connection, stranger, serve))
            # A task cancelled before its first step has not closed the connection.
            task.add_done_callback(lambda _: connection.close() if task.cancelled() else None)
            return task

        group.add(begin, seconds)

    tasks = [asyncio.ensure_future(_accept(each, group, start)) for each in listening]
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


async def _accept(listening: socket.socket, strangers: Strangers, start: Callable[[socket.socket], object]) -> None:
    loop, warning = asyncio.get_running_loop(), RareWarning()
    while True:
        try:
            connection, _ = await loop.sock_accept(listening)
        except OSError as error:  # out of descriptors or memory: clients wait in the system until others have gone
            warning.log("no connection can be accepted, trying again: %s", escape(str(error)))
            await asyncio.sleep(_ACCEPT_PAUSE)
            continue
        try:
            await strangers.make_room()
        except BaseException:
            connection.close()
            raise
        start(connection)
        await asyncio.sleep(0)  # accepting a whole backlog at once would keep a stop waiting


async def _serve(connection: socket.socket, stranger: Stranger, serve: Serve) -> None:
    try:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        if connection.family in {socket.AF_INET, socket.AF_INET6}:
            keep_alive(connection, idle=60, interval=15, count=4)
            # asyncio does this only for sockets with a protocol number, which accepted ones lack.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        await serve(connection, stranger)
    except OSError:
        connection.close()


class ServedProtocol(Protocol):
    """Object to which asyncio passes the bytes of a connection."""

    closed: asyncio.Event
    """Set when the connection has ended."""


async def converse(protocol: ServedProtocol, accepted: socket.socket) -> None:
    """Let `protocol`, an asyncio protocol, handle an accepted connection until its end."""
    loop = asyncio.get_running_loop()
    pipe, _ = await loop.connect_accepted_socket(lambda: cast("asyncio.Protocol", protocol), accepted)
    try:
        await protocol.closed.wait()
    finally:
        pipe.abort()


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
