"""Bridges between hosts on TCP or a pseudo-terminal and transports, such as a virtual board."""

from __future__ import annotations

import asyncio
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import ExitStack, asynccontextmanager, suppress
from io import FileIO
from typing import Any, TypeAlias

from servolink.errors import TransportError, quote
from servolink.support import PseudoTerminal
from servolink.transports.base import Transport
from servolink.transports.listeners.accept import RareWarning, accepting
from servolink.transports.listeners.strangers import Stranger, Strangers
from servolink.transports.listeners.tcp import NetworkPlace

MAX_WAITING = 1024 * 1024
"""Unread bytes above which a host is disconnected."""

Connect: TypeAlias = Callable[[], Transport]
"""Function that returns a new transport to the served board."""
Converse: TypeAlias = Callable[[asyncio.StreamReader, asyncio.StreamWriter, Stranger], Coroutine[Any, Any, None]]
"""Coroutine function that serves a connection until the end and, like `Serve`, admits the stranger."""

_CHUNK = 4096
_COPIED = 64 * 1024
_PIECE = 96  # enough for a move of 16 servos
_LINGER = 1.0  # seconds for a host to read the rest
_logger = logging.getLogger(__name__)


async def bridge(
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    connect: Connect,
    *,
    begin: bytes = b"",
    patient: bool = False,
) -> None:
    """Carry bytes both ways until stream or transport ends, then close the transport. `begin` was read before.

    Reading pauses while the host does not read, and a host with more than MAX_WAITING unread bytes is disconnected. A
    `patient` bridge, for lines that do not show whether a host is present, always reads, and drops bytes without room.
    """
    receiver = _StreamReceiver(writer, patient=patient)
    transport = connect()
    try:
        await transport.open(receiver)
        reading = asyncio.ensure_future(_pass_requests(reader, writer, transport, begin, patient=patient))
        try:
            await asyncio.wait((reading, receiver.ended), return_when=asyncio.FIRST_COMPLETED)
        finally:
            reading.cancel()
            await asyncio.wait((reading,))
        if not patient:
            await _flush(writer)
    except TransportError as error:
        _logger.warning("a host was disconnected: %s", error)
    finally:
        await transport.close()


class _StreamReceiver:
    """Receiver that writes the bytes of a transport to the stream."""

    def __init__(self, writer: asyncio.StreamWriter, *, patient: bool) -> None:
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._writer = writer
        self._patient = patient

    def data(self, chunk: bytes) -> None:
        if self._writer.transport.get_write_buffer_size() <= MAX_WAITING:
            self._writer.write(chunk)
        elif not self._patient:
            self._writer.transport.abort()
            self.lost(None)

    def lost(self, error: Exception | None) -> None:
        if not self.ended.done():
            self.ended.set_result(None)


async def _pass_requests(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, transport: Transport, begin: bytes, *, patient: bool
) -> None:
    try:
        chunk = begin or await reader.read(_CHUNK)
        while chunk:
            # 4 KiB hold hundreds of requests, each with a response of up to 64 KiB. One piece holds ten requests at
            # most, with responses below MAX_WAITING; the next piece waits until the host has read most of them.
            for at in range(0, len(chunk), _PIECE):
                await transport.send(chunk[at : at + _PIECE])
                await asyncio.sleep(0)  # responses come in the next turn, and other hosts have their turn
                if not patient:
                    await writer.drain()
                # Wait until a slow line has taken the piece; the board sees that its host was not silent meanwhile.
                await transport.send(b"")
            chunk = await reader.read(_CHUNK)
    except (TransportError, OSError):
        return  # usual end of a conversation


async def _flush(writer: asyncio.StreamWriter) -> None:
    writer.close()
    try:
        async with asyncio.timeout(_LINGER):
            await writer.wait_closed()
    except OSError:  # TimeoutError is one
        return
    finally:
        writer.transport.abort()


def _abort(pipe: asyncio.WriteTransport) -> None:
    """Close at once; unwritten bytes are lost. asyncio's pipes fail when they are aborted twice."""
    if not pipe.is_closing():
        pipe.abort()


async def forward(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, to: tuple[str, int], *, begin: bytes
) -> None:
    """Carry bytes both ways between a host and a server at `to`, until one side ends. `begin` was read before.

    Neither side is read faster than the other one reads. Raise OSError if the server is not reached.
    """
    from_server, to_server = await asyncio.open_connection(*to)
    try:
        to_server.write(begin)
        ways = [asyncio.ensure_future(_copy(reader, to_server)), asyncio.ensure_future(_copy(from_server, writer))]
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.wait(ways)
        await _flush(writer)
    finally:
        to_server.transport.abort()


async def _copy(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with suppress(OSError):
        while chunk := await reader.read(_COPIED):
            writer.write(chunk)
            await writer.drain()


@asynccontextmanager
async def serve_network(connect: Connect, host: str, port: int, *, begins_with: bytes = b"") -> AsyncIterator[str]:
    """Serve each host that connects to `host` and `port` with its own transport; yield the URL.

    A host whose first bytes are not `begins_with` is disconnected before any byte is used: a web page can make the
    browser connect to any port of this machine, and send any bytes behind a line of HTTP.
    """
    warning = RareWarning()

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, stranger: Stranger) -> None:
        begin = await _beginning(reader, begins_with)
        if begin.startswith(begins_with) and stranger.admit("frames", Strangers.most_connections()):
            await bridge(reader, writer, connect, begin=begin)
        elif begin.startswith(begins_with):
            warning.log("a host was disconnected: %d hosts are connected already", Strangers.most_connections())
        elif begin:
            warning.log("a host was disconnected: its first bytes are %s, not of this protocol", quote(begin[:16]))

    async with listen(converse, host, port) as place:
        yield f"tcp://{place}"


async def _beginning(reader: asyncio.StreamReader, expected: bytes) -> bytes:
    """Return the first bytes: `expected` and perhaps more, or any other bytes with which the host began."""
    begin = b""
    with suppress(OSError):
        while len(begin) < len(expected) and expected.startswith(begin) and (chunk := await reader.read(_CHUNK)):
            begin += chunk
    return begin


@asynccontextmanager
async def listen(converse: Converse, host: str, port: int, *, seconds: float | None = None) -> AsyncIterator[str]:
    """Run `converse` for each host that connects to `host` and `port`; yield the place as HOST:PORT.

    `*` is every address of this machine, all with the same port. A host that is not admitted within `seconds` is
    disconnected. Raise OpenError if the place is not available.
    """

    async def serve(connection: socket.socket, stranger: Stranger) -> None:
        reader, writer = await asyncio.open_connection(sock=connection)
        try:
            await converse(reader, writer, stranger)
        finally:
            writer.transport.abort()

    listening = await NetworkPlace(host, port).listen()
    async with accepting(listening, serve, seconds=seconds):
        yield str(NetworkPlace.of(listening))


@asynccontextmanager
async def serve_terminal(connect: Connect) -> AsyncIterator[str]:
    """Serve a conversation over a new pseudo-terminal; yield its URL.

    Like a board on a serial line, the conversation outlives its hosts. Raise TransportUnavailable on Windows.
    """
    controller, terminal, name = PseudoTerminal.open_pair()
    with ExitStack() as line:
        # Our own descriptor of the other end keeps the line up, and raw, when a host closes the terminal.
        line.callback(os.close, terminal)
        source = line.enter_context(open(controller, "rb", buffering=0))
        sink = line.enter_context(open(os.dup(controller), "wb", buffering=0))
        reader, writer = await _streams(source, sink, line)
        serving = asyncio.ensure_future(bridge(reader, writer, connect, patient=True))
        serving.add_done_callback(lambda _: line.close())
        try:
            yield f"serial://{name}"
        finally:
            serving.cancel()
            await asyncio.wait((serving,))


async def _streams(source: FileIO, sink: FileIO, line: ExitStack) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Return streams on two files; closing `line` ends them."""
    loop = asyncio.get_running_loop()
    reader = asyncio.StreamReader()
    upward, _ = await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), source)
    line.callback(upward.close)
    unread = asyncio.StreamReader()
    downward, protocol = await loop.connect_write_pipe(lambda: asyncio.StreamReaderProtocol(unread), sink)
    line.callback(_abort, downward)
    return reader, asyncio.StreamWriter(downward, protocol, None, loop)
