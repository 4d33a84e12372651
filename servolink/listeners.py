"""Carries bytes between a stream and a transport, both ways, until one of them ends."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import ExitStack, asynccontextmanager
from io import FileIO
from typing import Any, TypeAlias

from servolink.errors import OpenError, TransportError, TransportUnavailable
from servolink.escaping import escape
from servolink.transports.address import Address
from servolink.transports.base import Transport

Connect = Callable[[], Transport]
"""Makes a new connection to the board that is served."""
MOST_WAITING = 1024 * 1024
"""Bytes that may wait for a host to read them."""

_CHUNK = 4096
_LINGER = 1.0  # seconds for a host to read what it was sent before it closed


async def bridge(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, connect: Connect, *, patient: bool = False
) -> None:
    """Carry bytes until the stream or the transport ends, then close both.

    A host that does not read is not heard until it does, and disconnected when too much waits for it. With
    `patient`, for lines that cannot tell whether anybody is there, it is heard, and what has no room is lost.
    """
    transport = connect()
    mouth = _Mouth(writer, patient=patient)
    try:
        await transport.open(mouth)
        reading = asyncio.ensure_future(_read(reader, writer, transport, patient=patient))
        try:
            await asyncio.wait((reading, mouth.ended), return_when=asyncio.FIRST_COMPLETED)
        finally:
            reading.cancel()
            await asyncio.wait((reading,))
        if not patient:
            await _flush(writer)
    finally:
        await transport.close()
        end(writer.transport)


def end(pipe: asyncio.WriteTransport) -> None:
    """Close at once, what is not written is lost; asyncio's pipes cannot bear to be told twice."""
    if not pipe.is_closing():
        pipe.abort()


class _Mouth:
    """Writes what the transport brings to the stream."""

    def __init__(self, writer: asyncio.StreamWriter, *, patient: bool) -> None:
        self.ended: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._writer = writer
        self._patient = patient

    def data(self, chunk: bytes) -> None:
        # The answers to one chunk may exceed the limit by any amount: a host that asks a lot at once does nothing
        # wrong.
        if self._writer.transport.get_write_buffer_size() <= MOST_WAITING:
            self._writer.write(chunk)
        elif not self._patient:
            self._writer.transport.abort()
            self.lost(None)

    def lost(self, error: Exception | None) -> None:
        if not self.ended.done():
            self.ended.set_result(None)


async def _read(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, transport: Transport, *, patient: bool
) -> None:
    try:
        while chunk := await reader.read(_CHUNK):
            await transport.send(chunk)
            await asyncio.sleep(0)  # lets the answers out, which drain() is to wait for
            if not patient:
                await writer.drain()
    except (TransportError, OSError):
        return  # either end is gone, which is how every conversation ends


async def _flush(writer: asyncio.StreamWriter) -> None:
    writer.close()
    try:
        async with asyncio.timeout(_LINGER):
            await writer.wait_closed()
    except OSError:  # TimeoutError is one
        return
    finally:
        writer.transport.abort()


Converse: TypeAlias = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]
"""Serves one connection, and returns when it has ended."""

_HIGHEST_PORT = 65535


def host_and_port(text: str) -> tuple[str, int]:
    """Split `HOST:PORT`; port 0 means any free one; TransportUnavailable says what is wrong."""
    address = Address.parse(f"tcp://{text}")
    if not address.host or address.path or address.options or not address.port.isdecimal():
        raise TransportUnavailable(f"{escape(text)!r} is not HOST:PORT, as in 127.0.0.1:0")
    if int(address.port) > _HIGHEST_PORT:
        raise TransportUnavailable(f"port {address.port} is outside 0..{_HIGHEST_PORT}")
    return address.host, int(address.port)


@asynccontextmanager
async def serve_network(connect: Connect, host: str, port: int) -> AsyncIterator[str]:
    """Serve a conversation to each host that connects to `host` and `port`, and give the URL."""
    async with listen(lambda reader, writer: bridge(reader, writer, connect), host, port) as place:
        yield f"tcp://{place}"


@asynccontextmanager
async def listen(converse: Converse, host: str, port: int) -> AsyncIterator[str]:
    """Let each host that connects to `host` and `port` converse, and give the place as HOST:PORT."""
    conversations: set[asyncio.Task[None]] = set()

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        conversation = asyncio.ensure_future(converse(reader, writer))
        conversations.add(conversation)
        conversation.add_done_callback(conversations.discard)

    place = f"{escape(host)}:{port}"
    try:
        server = await asyncio.start_server(accept, host, port)
    except OSError as error:
        raise OpenError(f"cannot listen at {place}: {escape(str(error))}; try another port, or 0") from error
    except UnicodeError as error:
        raise OpenError(f"cannot listen at {place}: no host can have this name; write its IP address") from error
    try:
        name, number = server.sockets[0].getsockname()[:2]
        yield f"[{name}]:{number}" if ":" in name else f"{name}:{number}"
    finally:
        server.close()
        for conversation in conversations:
            conversation.cancel()
        if conversations:
            await asyncio.wait(set(conversations))
        await server.wait_closed()


AVAILABLE = sys.platform != "win32"
"""Whether this system has pseudo-terminals."""


@asynccontextmanager
async def serve_terminal(connect: Connect) -> AsyncIterator[str]:
    """Serve one conversation over a new pseudo-terminal and give its URL.

    Like a board on a serial line it does not notice when hosts come and go.
    """
    if sys.platform == "win32":
        raise TransportUnavailable("pseudo-terminals do not exist on Windows; serve the board over TCP")
    import tty

    ours, theirs = os.openpty()
    with ExitStack() as line:
        # Their end is held as long as ours: without it the line goes down, and loses its raw mode, when a host
        # closes it.
        line.callback(os.close, theirs)
        source = line.enter_context(open(ours, "rb", buffering=0))
        sink = line.enter_context(open(os.dup(ours), "wb", buffering=0))
        tty.setraw(theirs)
        name = os.ttyname(theirs)
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
    line.callback(end, downward)
    return reader, asyncio.StreamWriter(downward, protocol, None, loop)
