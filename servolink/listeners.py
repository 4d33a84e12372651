"""Serve transports, such as connections to a virtual board, over TCP and pseudo-terminals."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable, Coroutine, Iterable, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any, TypeAlias

from servolink.errors import OpenError, TransportError, TransportUnavailable
from servolink.escaping import escape, quote
from servolink.files import reason
from servolink.platforms.process import most_open_files
from servolink.platforms.pseudo_terminals import open_pair
from servolink.tasks import Tasks
from servolink.transports.address import Address
from servolink.transports.base import Transport
from servolink.transports.stream import keep_alive

MAX_WAITING = 1024 * 1024
"""Bytes that may wait in this program for a host to read them."""

_logger = logging.getLogger(__name__)

Connect: TypeAlias = Callable[[], Transport]
"""Makes a new connection to the board that is served."""
Converse: TypeAlias = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Coroutine[Any, Any, None]]
"""Serves one connection, and returns when it has ended."""


# ── one conversation: bytes carried between a stream and a transport ──

_CHUNK = 4096
_PIECE = 96  # enough for a move of 16 servos
_WARNING_PAUSE = 60.0  # seconds between two warnings of the same
_LINGER = 1.0  # seconds for a host to read what it was sent before it closed


async def bridge(
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    connect: Connect,
    *,
    begin: bytes = b"",
    patient: bool = False,
) -> None:
    """Carry bytes both ways until the stream or the transport ends, then close both. `begin` was read before.

    While a host does not read, its requests are not read either; if more than MAX_WAITING waits for it, it is
    disconnected. A `patient` bridge, for lines that do not show whether a host is present, always reads, and drops the
    bytes that have no room.
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
        _abort(writer.transport)


class _StreamReceiver:
    """Writes what the transport receives to the stream."""

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
            # 4 KiB hold hundreds of requests, each with a response of up to 64 KiB. The responses to one piece, of ten
            # requests at most, stay below MAX_WAITING; the next piece waits until the host has read most of them.
            for at in range(0, len(chunk), _PIECE):
                await transport.send(chunk[at : at + _PIECE])
                await asyncio.sleep(0)  # the transport delivers responses in the next turn; other hosts get theirs
                if not patient:
                    await writer.drain()
                # A slow line has taken this piece, and a board knows that its host was not silent in the meantime.
                await transport.send(b"")
            chunk = await reader.read(_CHUNK)
    except (TransportError, OSError):
        return  # one end is gone: the usual end of a conversation


async def _flush(writer: asyncio.StreamWriter) -> None:
    writer.close()
    try:
        async with asyncio.timeout(_LINGER):
            await writer.wait_closed()
    except OSError:  # TimeoutError is one
        return
    finally:
        writer.transport.abort()


class RareWarning:
    """Logs a warning at most once a minute, whatever others do."""

    def __init__(self) -> None:
        """Log the first one."""
        self._now = asyncio.get_running_loop().time
        self._logged_at = -_WARNING_PAUSE

    def log(self, text: str, *args: object) -> None:
        """Log `text % args`, unless the last one was a short time ago."""
        if self._now() - self._logged_at >= _WARNING_PAUSE:
            self._logged_at = self._now()
            _logger.warning(text, *args)


def _abort(pipe: asyncio.WriteTransport) -> None:
    """Close at once; unwritten bytes are lost. asyncio's pipes fail when they are aborted twice."""
    if not pipe.is_closing():
        pipe.abort()


# ── TCP ──

_MAX_PORT = 65535
_BACKLOG = 100
_SEND_BUFFER = 256 * 1024  # in the system, which by itself would give some MiB to each host that does not read
_ACCEPT_PAUSE = 1.0  # seconds between attempts while no connection can be accepted
_PORT_ATTEMPTS = 10
_MOST_CONNECTIONS = 4096  # to one address, where the system has no limit or a high one
_NO_SUCH_FAMILY = {errno.EAFNOSUPPORT, errno.EADDRNOTAVAIL}  # a machine without IPv6


def host_and_port(text: str) -> tuple[str, int]:
    """Split `HOST:PORT`. Port 0 means any free port. Raise TransportUnavailable if `text` is something else."""
    address = Address.parse(f"tcp://{text}")
    if not address.host or address.path or "?" in text or not address.port.isdecimal():
        raise TransportUnavailable(f"{quote(text)} must be HOST:PORT, as in 127.0.0.1:0")
    if int(address.port) > _MAX_PORT:
        raise TransportUnavailable(f"a port must be 0..{_MAX_PORT}, not {address.port}")
    return address.host, int(address.port)


@asynccontextmanager
async def serve_network(connect: Connect, host: str, port: int, *, begins_with: bytes = b"") -> AsyncIterator[str]:
    """Serve each host that connects to `host` and `port` with a transport of its own; yield the URL.

    A host whose first bytes are not `begins_with` is disconnected before any of them is used: a web page can make the
    browser connect to any port of this machine, and send what it likes behind a line of HTTP.
    """
    warning = RareWarning()

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        begin = await _beginning(reader, begins_with)
        if begin.startswith(begins_with):
            await bridge(reader, writer, connect, begin=begin)
            return
        if begin:
            warning.log("a host was disconnected: it began with %s, not as this protocol does", quote(begin[:16]))
        _abort(writer.transport)

    async with listen(converse, host, port) as place:
        yield f"tcp://{place}"


async def _beginning(reader: asyncio.StreamReader, wanted: bytes) -> bytes:
    """Return the first bytes: `wanted` and perhaps more, or what else the host began with before it paused or left."""
    begin = b""
    with suppress(OSError):
        while len(begin) < len(wanted) and wanted.startswith(begin) and (chunk := await reader.read(_CHUNK)):
            begin += chunk
    return begin


@asynccontextmanager
async def listen(converse: Converse, host: str, port: int) -> AsyncIterator[str]:
    """Run `converse` for each host that connects to `host` and `port`; yield the place as HOST:PORT.

    `*` is every address of this machine, all with the same port. Raise OpenError if the place cannot be had.
    """
    conversations = Tasks()

    def start(connection: socket.socket) -> None:
        conversations.begin(_converse(connection, converse))

    listening = await listening_sockets(host, port)
    try:
        async with accepting(listening, start):
            yield place_of(listening)
    finally:
        await conversations.close()


@asynccontextmanager
async def accepting(listening: Sequence[socket.socket], start: Callable[[socket.socket], None]) -> AsyncIterator[None]:
    """Call `start` with each connection to these sockets within this context, which closes them."""
    tasks = [asyncio.ensure_future(_accept(each, start)) for each in listening]
    try:
        yield
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)
        for each in listening:
            each.close()


def most_connections() -> int:
    """Return how many connections strangers may have to one address: a quarter of the files this process may open.

    Whoever may connect could take all of them otherwise, and nobody could stop the board any more.
    """
    files = most_open_files()
    return _MOST_CONNECTIONS if files is None else min(max(files // 4, 1), _MOST_CONNECTIONS)


def place_of(listening: Sequence[socket.socket]) -> str:
    """Return where sockets listen, as HOST:PORT."""
    return _place(*listening[0].getsockname()[:2])


def _place(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


async def listening_sockets(host: str, port: int) -> list[socket.socket]:
    """Return sockets that listen at all addresses of `host`, with one port for all of them.

    `*` is every address of this machine. Raise OpenError if the place cannot be had.
    """
    place = _place(host, port)
    try:
        found = await asyncio.get_running_loop().getaddrinfo(
            None if host == "*" else host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )
        addresses = list(dict.fromkeys((family, address) for family, _, _, _, address in found))
        for _ in range(_PORT_ATTEMPTS - 1 if port == 0 else 0):
            try:
                return _bind(addresses, port)
            except OSError:  # the port that was free for one address is perhaps not free for the next one
                continue
        return _bind(addresses, port)
    except OSError as error:
        raise OpenError(f"cannot listen at {place}: {error}; {_remedy(error)}") from error
    except UnicodeError as error:
        raise OpenError(f"cannot listen at {place}: no host can have this name; write its IP address") from error


def _remedy(error: OSError) -> str:
    if isinstance(error, socket.gaierror) or error.errno in _NO_SUCH_FAMILY:
        return "it must be an address of this machine, such as 127.0.0.1, or * for all of them"
    return "try another port, or 0"


def _bind(addresses: Iterable[tuple[socket.AddressFamily, Any]], port: int) -> list[socket.socket]:
    with ExitStack() as bound:
        listening: list[socket.socket] = []
        missing: OSError | None = None
        for family, (host, _, *rest) in addresses:
            try:
                one = socket.create_server((host, port, *rest), family=family, backlog=_BACKLOG)
            except OSError as error:
                if error.errno not in _NO_SUCH_FAMILY:
                    raise
                missing = error
                continue
            bound.callback(one.close)
            one.settimeout(0)
            listening.append(one)
            port = one.getsockname()[1]
        if missing is not None and not listening:
            raise missing
        bound.pop_all()
        return listening


async def _accept(listening: socket.socket, start: Callable[[socket.socket], None]) -> None:
    loop, warning = asyncio.get_running_loop(), RareWarning()
    while True:
        try:
            connection, _ = await loop.sock_accept(listening)
        except OSError as error:  # out of descriptors or memory: hosts wait in the system until others have gone
            warning.log("no connection can be accepted, trying again each second: %s", escape(str(error)))
            await asyncio.sleep(_ACCEPT_PAUSE)
        else:
            start(connection)


async def _converse(connection: socket.socket, converse: Converse) -> None:
    try:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        keep_alive(connection, idle=60, interval=15, count=4)
        reader, writer = await asyncio.open_connection(sock=connection)
    except BaseException as error:
        connection.close()
        if isinstance(error, OSError):
            return  # the host is gone already
        raise
    await converse(reader, writer)


# ── pseudo-terminals ──

_TERMINALS = "/dev/"


@asynccontextmanager
async def serve_terminal(connect: Connect) -> AsyncIterator[str]:
    """Serve one conversation over a new pseudo-terminal; yield its URL.

    Like a board on a serial line it does not notice when hosts come and go. Raise TransportUnavailable on Windows.
    """
    ours, theirs, name = open_pair()
    with ExitStack() as line:
        # Their end is held open as long as ours: without it the line goes down, and is no longer raw, when a host
        # closes it.
        line.callback(os.close, theirs)
        source = line.enter_context(open(ours, "rb", buffering=0))
        sink = line.enter_context(open(os.dup(ours), "wb", buffering=0))
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


@contextmanager
def linked_terminal(link: Path, terminal: str) -> Iterator[Path]:
    """Make a symbolic link to a terminal within this context; one that was left there is replaced. Raise OpenError."""
    if link.is_symlink() and not _target(link).startswith(_TERMINALS):
        raise OpenError(f"{link} is a link to something else than a terminal; choose another name")
    if link.exists() and not link.is_symlink():
        raise OpenError(f"{link} is there already; choose another name")
    temporary = link.with_name(f".servolink-{os.urandom(8).hex()}")
    try:
        temporary.symlink_to(terminal)
        try:
            temporary.replace(link)
        except OSError:
            temporary.unlink()
            raise
    except OSError as error:
        raise OpenError(f"{link}: no link can be made there: {reason(error)}") from error
    try:
        yield link
    finally:
        with suppress(OSError):
            if _target(link) == terminal:  # or else it is another hub's by now
                link.unlink()


def _target(link: Path) -> str:
    return os.readlink(link)  # noqa: PTH115 - as it is written
