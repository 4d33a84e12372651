"""Listening for hosts: at which ports, and what hosts that fail, vanish or come too many do to the others."""

from __future__ import annotations

import asyncio
import errno
import re
import socket
from itertools import pairwise
from typing import Any

import pytest

from servolink import listeners
from servolink.errors import OpenError, TransportUnavailable
from servolink.listeners import host_and_port, listening_sockets
from servolink.protocol.codec import Codec
from servolink.protocol.editing import AddActionRequest
from servolink.protocol.record_types import ACTION
from servolink.protocol.records import Step
from servolink.protocol.servos import QueryServoListRequest, QueryServoListResponse
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from servolink.transports.stream import keep_alive
from servolink.virtual.board import VirtualBoard
from servolink.virtual.serve import serve
from servolink.virtual.transport import VirtualTransport
from tests.virtual.receiving import ANY_PORT, GUARD, Heard, ask, client
from tests.virtual_time import run

LIST = QueryServoListRequest()
ANSWER = QueryServoListResponse((1, 2, 3))


@pytest.mark.skipif("sys.platform == 'win32'")
@pytest.mark.parametrize(("files", "most"), [(96, 24), (1, 1), (1024, 256), (1 << 20, 4096), (None, 4096)])
def test_an_address_takes_a_quarter_of_the_files(files: int | None, most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    import resource

    limit = resource.RLIM_INFINITY if files is None else files
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    assert listeners.most_connections() == most


def test_a_host_that_does_not_read_keeps_nothing_open_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "_LINGER", 0.0)

    async def main() -> None:
        ours, theirs = MemoryTransport.pair()
        async with listeners.serve_network(lambda: ours, "127.0.0.1", 0) as url:
            with socket.socket() as line:
                line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                line.connect(host_and_port(url.removeprefix("tcp://")))
                line.sendall(Codec().encode(LIST))
                heard = Heard()
                await theirs.open(heard)
                await heard.until(1)
                await theirs.send(bytes(5 * 1024 * 1024))
                await theirs.close()
                async with asyncio.timeout(GUARD):
                    while len(asyncio.all_tasks()) > 2:  # this one and the one that accepts
                        await asyncio.sleep(0)

    asyncio.run(main())


class _SlowWriter:
    """The stream to a host that reads for the first time a second after it was sent something."""

    def __init__(self) -> None:
        self.transport = self

    def write(self, data: bytes) -> None:
        pass

    async def drain(self) -> None:
        await asyncio.sleep(1)

    def get_write_buffer_size(self) -> int:
        return 0

    def close(self) -> None:
        pass

    async def wait_closed(self) -> None:
        pass

    def is_closing(self) -> bool:
        return True

    def abort(self) -> None:
        pass


def test_a_long_request_is_whole_although_its_host_reads_late() -> None:
    board = VirtualBoard(servos=16)
    steps = tuple(Step(servo_id, 30, 10) for servo_id in board.servos)
    frames = [Codec().encode(AddActionRequest(action_id, "Bow", steps)) for action_id in range(1, 101)]
    assert len(frames[0]) > 96, "or it is passed on in one piece"

    async def main() -> None:
        reader, writer = asyncio.StreamReader(), _SlowWriter()
        reader.feed_data(b"".join(frames))
        reader.feed_eof()
        writing: Any = writer
        await listeners.bridge(reader, writing, lambda: VirtualTransport(board))

    run(main())
    assert [action_id for action_id, _ in board.storage.contents.records[ACTION]] == [*range(1, 101)]


def test_a_host_that_is_gone_before_it_is_served_harms_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    gone = [True]

    def fail_once(line: socket.socket, **times: int) -> None:
        if gone:
            gone.clear()
            raise OSError(errno.EINVAL, "Invalid argument")
        keep_alive(line, **times)

    async def main() -> None:
        async with serve(VirtualBoard(servos=3), tcp=ANY_PORT) as (url,):
            reader, writer = await client(url)
            async with asyncio.timeout(GUARD):
                assert await reader.read() == b""
            writer.close()
            transport, heard = create(url), Heard()
            await transport.open(heard)
            assert await ask(transport, heard, LIST) == ANSWER
            await transport.close()

    monkeypatch.setattr(listeners, "keep_alive", fail_once)
    asyncio.run(main())


def test_the_system_holds_little_for_a_host_and_notices_when_it_vanishes(monkeypatch: pytest.MonkeyPatch) -> None:
    options: list[int] = []

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        line = writer.get_extra_info("socket")
        options.append(line.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE))
        options.append(line.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF))
        writer.close()

    async def main() -> None:
        async with listeners.listen(converse, "127.0.0.1", 0) as place:
            reader, writer = await client(place)
            async with asyncio.timeout(GUARD):
                assert await reader.read() == b""
            writer.close()

    asyncio.run(main())
    assert options[0] == 1
    assert options[1] <= 1024 * 1024


def test_connections_that_cannot_be_accepted_are_told_once_and_accepted_later(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(listeners, "_ACCEPT_PAUSE", 0.0)
    failing = [OSError(errno.EMFILE, "Too many open files")] * 50

    async def main() -> None:
        loop = asyncio.get_running_loop()
        accept = loop.sock_accept

        async def sock_accept(listening: socket.socket) -> Any:
            if failing:
                raise failing.pop()
            return await accept(listening)

        monkeypatch.setattr(loop, "sock_accept", sock_accept)
        async with serve(VirtualBoard(servos=3), tcp=ANY_PORT) as (url,):
            transport, heard = create(url), Heard()
            await transport.open(heard)
            assert await ask(transport, heard, LIST) == ANSWER
            await transport.close()

    asyncio.run(main())
    assert not failing
    assert [record.getMessage() for record in caplog.records] == [
        "no connection can be accepted, trying again each second: [Errno 24] Too many open files"
    ]


def test_accepting_is_tried_each_second_and_its_failure_is_told_each_minute(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    attempts: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        async def sock_accept(listening: socket.socket) -> Any:
            attempts.append(loop.time())
            if len(attempts) == 150:
                raise asyncio.CancelledError
            raise OSError(errno.EMFILE, "Too many open files")

        monkeypatch.setattr(loop, "sock_accept", sock_accept)
        with socket.socket() as listening, pytest.raises(asyncio.CancelledError):
            await listeners._accept(listening, lambda connection: None)

    run(main())
    assert [two - one for one, two in pairwise(attempts)] == [1.0] * 149
    assert len(caplog.records) == 3


def test_all_addresses_of_a_machine_have_the_same_port() -> None:
    async def main() -> None:
        async with serve(VirtualBoard(servos=3), tcp="*:0") as (url,):
            port = url.rpartition(":")[2]
            for host in ("127.0.0.1", "[::1]") if has_ipv6() else ("127.0.0.1",):
                transport, heard = create(f"tcp://{host}:{port}"), Heard()
                await transport.open(heard)
                assert await ask(transport, heard, LIST) == ANSWER
                await transport.close()

    for _ in range(5):
        asyncio.run(main())


def test_a_machine_without_ipv6_serves_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    create_server = socket.create_server

    def without_ipv6(address: tuple[Any, ...], *, family: int, backlog: int) -> socket.socket:
        if family == socket.AF_INET6:
            raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")
        return create_server(address, family=family, backlog=backlog)

    async def main(host: str) -> str:
        async with serve(VirtualBoard(servos=3), tcp=f"{host}:0") as (url,):
            return url

    monkeypatch.setattr(socket, "create_server", without_ipv6)
    assert asyncio.run(main("*")).startswith("tcp://0.0.0.0:")
    with pytest.raises(OpenError, match=r"cannot listen at \[::1\]:0: .*not supported"):
        asyncio.run(main("[::1]"))


@pytest.mark.parametrize(
    ("error", "remedy"),
    [
        (OSError(errno.EADDRNOTAVAIL, "not available"), "it must be an address of this machine"),
        (
            socket.gaierror(socket.EAI_NONAME, "not known"),
            "it must be an address of this machine, such as 127.0.0.1, or",
        ),
        (OSError(errno.EADDRINUSE, "in use"), "try another port, or 0"),
    ],
)
def test_who_cannot_listen_is_told_what_helps(error: OSError, remedy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any, **options: Any) -> socket.socket:
        raise error

    monkeypatch.setattr(socket, "create_server", fail)
    with pytest.raises(OpenError, match=re.escape(f"cannot listen at 127.0.0.1:5: {error}; {remedy}")):
        asyncio.run(listening_sockets("127.0.0.1", 5))


@pytest.mark.skipif("not has_ipv6()")
def test_a_free_port_is_free_for_all_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first two ports are taken by others at the second address."""
    create_server, taken = socket.create_server, 2

    def second_is_taken(address: tuple[Any, ...], *, family: int, backlog: int) -> socket.socket:
        nonlocal taken
        if family == socket.AF_INET6 and taken:
            taken -= 1
            raise OSError(errno.EADDRINUSE, "Address already in use")
        return create_server(address, family=family, backlog=backlog)

    async def main() -> None:
        async with serve(VirtualBoard(servos=3), tcp="*:0") as (url,):
            with pytest.raises(OSError, match="in use"):
                create_server(("::1", int(url.rpartition(":")[2])), family=socket.AF_INET6)

    monkeypatch.setattr(socket, "create_server", second_is_taken)
    asyncio.run(main())
    assert taken == 0


def has_ipv6() -> bool:
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


def test_a_board_that_cannot_be_opened_disconnects_its_host(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with listeners.serve_network(lambda: create("serial:///nowhere"), "127.0.0.1", 0) as url:
            reader, writer = await client(url)
            async with asyncio.timeout(GUARD):
                assert await reader.read() == b""
            writer.close()

    asyncio.run(main())
    (told,) = [record.getMessage() for record in caplog.records]
    assert told.startswith("a host was disconnected: serial:///nowhere")


def test_a_port_in_use_is_an_error_that_says_what_to_do() -> None:
    async def main() -> None:
        async with serve(VirtualBoard(), tcp=ANY_PORT) as (url,):
            with pytest.raises(OpenError, match="try another port, or 0"):
                async with serve(VirtualBoard(), tcp=url.removeprefix("tcp://")):
                    pass

    asyncio.run(main())


@pytest.mark.parametrize(
    "text", ["", "127.0.0.1", ":80", "host:x", "host:65536", "host:1/path", "host:1?a=b", "[::1:0"]
)
def test_what_is_no_host_and_port_is_refused(text: str) -> None:
    with pytest.raises(TransportUnavailable):
        host_and_port(text)


@pytest.mark.parametrize("kind", ["tcp", "usbip"])
@pytest.mark.parametrize("host", ["a..b", "%ff", "x" * 70])
def test_a_name_that_no_host_can_have_is_told(host: str, kind: str) -> None:
    async def main() -> None:
        options: dict[str, Any] = {kind: f"{host}:0"}
        async with serve(VirtualBoard(), **options):
            pass

    with pytest.raises(OpenError, match="no host can have this name; write its IP address"):
        asyncio.run(main())


def test_hosts_and_ports_are_split() -> None:
    assert host_and_port("[::1]:0") == ("::1", 0)
    assert host_and_port("localhost:65535") == ("localhost", 65535)
