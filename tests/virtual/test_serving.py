"""Boards served over real pseudo-terminals and sockets."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import sys
from contextlib import ExitStack
from typing import Any

import pytest

from servolink import listeners
from servolink.errors import OpenError, TransportUnavailable
from servolink.listeners import host_and_port
from servolink.protocol.codec import Codec
from servolink.protocol.editing import AddActionRequest, QueryActionRequest
from servolink.protocol.joystick import PRESS, UP, ButtonEventResponse, SubscribeButtonEventRequest
from servolink.protocol.records import Step
from servolink.protocol.servos import QueryServoListRequest, QueryServoListResponse, QueryServoRequest
from servolink.transports.faults import Faults
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from servolink.transports.stream import keep_alive
from servolink.virtual.board import VirtualBoard
from servolink.virtual.serve import serve
from tests.virtual.receiving import GUARD, Heard, ask

LIST = QueryServoListRequest()
ANSWER = QueryServoListResponse((1, 2, 3))
FRAME, REPLY = Codec().encode(LIST), Codec().encode(ANSWER)
EVENTS = Codec().encode(ButtonEventResponse(1, PRESS)) * 1000
ANY_PORT = "127.0.0.1:0"
on_unix = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals on Windows")


async def client(url: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(*host_and_port(url.removeprefix("tcp://")))


@on_unix
def test_both_are_served_at_once_and_the_urls_come_in_order() -> None:
    async def main() -> None:
        async with serve(VirtualBoard(servos=3), pty=True, tcp=ANY_PORT) as urls:
            assert [url.partition("://")[0] for url in urls] == ["serial", "tcp"]
            for url in urls:
                transport, heard = create(url), Heard()
                await transport.open(heard)
                assert await ask(transport, heard, LIST) == ANSWER
                await transport.close()

    asyncio.run(main())


@on_unix
def test_a_pseudo_terminal_outlives_its_hosts() -> None:
    async def main() -> None:
        async with serve(VirtualBoard(servos=3), pty=True) as (url,):
            for _ in range(3):
                transport, heard = create(url), Heard()
                await transport.open(heard)
                assert await ask(transport, heard, LIST) == ANSWER
                await transport.close()

    asyncio.run(main())


@on_unix
def test_a_pseudo_terminal_is_raw_for_hosts_that_set_nothing() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with serve(VirtualBoard(servos=3), pty=True) as (url,):
            for _ in range(2):
                descriptor = os.open(url.removeprefix("serial://"), os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
                readable = asyncio.Event()
                loop.add_reader(descriptor, readable.set)
                os.write(descriptor, FRAME)
                got = b""
                async with asyncio.timeout(GUARD):
                    while len(got) < len(REPLY):
                        await readable.wait()
                        readable.clear()
                        got += os.read(descriptor, 100)
                loop.remove_reader(descriptor)
                os.close(descriptor)
                assert got == REPLY  # nothing echoed, no line ends turned

    asyncio.run(main())


@on_unix
def test_a_pseudo_terminal_that_nobody_reads_loses_what_has_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "MAX_WAITING", 20_000)

    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with serve(board, pty=True) as (url,):
            transport, heard = create(url), Heard()
            await transport.open(heard)
            await ask(transport, heard, SubscribeButtonEventRequest(1))
            await transport.close()
            await press(board, 5000)
            assert subscribed(board)
            transport, heard = create(url), Heard()
            await transport.open(heard)
            while ANSWER not in heard.packets:
                await transport.send(FRAME)
                await heard.until(len(heard.packets) + 1)
            assert len(heard.packets) < 10_000
            await transport.close()

    asyncio.run(main())


def test_two_hosts_at_once_have_their_own_conversations() -> None:
    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with serve(board, tcp=ANY_PORT) as (url,):
            one, other, heard_one, heard_other = create(url), create(url), Heard(), Heard()
            await one.open(heard_one)
            await other.open(heard_other)
            await ask(one, heard_one, SubscribeButtonEventRequest(1))
            board.press_button(5, asyncio.get_running_loop().time())
            board.release_button(5, asyncio.get_running_loop().time())
            assert (await heard_one.until(3))[1:] == [ButtonEventResponse(5, PRESS), ButtonEventResponse(5, UP)]
            assert await ask(other, heard_other, LIST) == ANSWER
            assert len(heard_other.packets) == 1
            await one.close()
            assert await ask(other, heard_other, LIST) == ANSWER
            await other.close()

    asyncio.run(main())


def test_a_host_that_stops_sending_still_gets_its_answers() -> None:
    async def main() -> None:
        async with serve(VirtualBoard(servos=3), tcp=ANY_PORT) as (url,):
            reader, writer = await client(url)
            writer.write(FRAME * 50)
            writer.write_eof()
            async with asyncio.timeout(GUARD):
                assert await reader.read(-1) == REPLY * 50
            writer.close()
            await writer.wait_closed()

    asyncio.run(main())


def test_a_host_that_asks_a_lot_at_once_and_reads_slowly_gets_it_all() -> None:
    async def main() -> int:
        loop = asyncio.get_running_loop()
        async with serve(VirtualBoard(servos=254), tcp=ANY_PORT) as (url,):
            with socket.socket() as line:
                line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                line.connect(host_and_port(url.removeprefix("tcp://")))
                line.setblocking(False)
                await loop.sock_sendall(line, Codec().encode(QueryServoRequest(255)) * 1000)
                line.shutdown(socket.SHUT_WR)
                got = 0
                async with asyncio.timeout(GUARD):
                    while chunk := await loop.sock_recv(line, 65536):
                        got += len(chunk)
                return got

    assert asyncio.run(main()) == 1000 * (9 + 1 + 11 * 254)


def test_a_host_that_never_reads_is_left_behind_and_others_are_served(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "MAX_WAITING", 20_000)

    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with serve(board, tcp=ANY_PORT) as (url,):
            line = socket.socket()
            line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            line.connect(host_and_port(url.removeprefix("tcp://")))
            line.sendall(Codec().encode(SubscribeButtonEventRequest(1)))
            async with asyncio.timeout(GUARD):
                while not subscribed(board):
                    await asyncio.sleep(0)
                while subscribed(board):
                    board.sessions[0].send(EVENTS)
                    await asyncio.sleep(0)
            transport, heard = create(url), Heard()
            await transport.open(heard)
            assert await ask(transport, heard, LIST) == ANSWER
            await transport.close()
            line.close()

    asyncio.run(main())


BIG_ACTION = AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000)))
BIG_QUERIES = Codec().encode(QueryActionRequest(1)) * 400


def test_hosts_that_ask_a_lot_and_never_read_cost_little_and_others_are_served(monkeypatch: pytest.MonkeyPatch) -> None:
    """400 queries for 60 kB each, all in a few reads: 24 MB for each of 100 hosts, had they all been answered."""
    writers: list[asyncio.StreamWriter] = []
    bridge = listeners.bridge

    async def watched(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, connect: listeners.Connect) -> None:
        writers.append(writer)
        await bridge(reader, writer, connect)

    def waiting() -> list[int]:
        return [writer.transport.get_write_buffer_size() for writer in writers]

    async def main() -> None:
        most = [0]
        async with serve(VirtualBoard(servos=3), tcp=ANY_PORT) as (url,):
            transport, heard = create(url), Heard()
            await transport.open(heard)
            await ask(transport, heard, BIG_ACTION)
            with ExitStack() as lines:
                for _ in range(100):
                    line = lines.enter_context(socket.socket())
                    line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                    line.connect(host_and_port(url.removeprefix("tcp://")))
                    line.sendall(BIG_QUERIES)
                for _ in range(20):
                    assert await ask(transport, heard, LIST) == ANSWER
                    most += waiting()
                assert len(writers) == 101
                while min(waiting()[1:]) == 0:  # until each has so much that it is heard no more
                    await asyncio.sleep(0)
                    most += waiting()
            await transport.close()
        assert max(most) <= listeners.MAX_WAITING

    monkeypatch.setattr(listeners, "bridge", watched)
    asyncio.run(main())


def test_a_host_that_does_not_read_keeps_nothing_open_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listeners, "_LINGER", 0.0)

    async def main() -> None:
        ours, theirs = MemoryTransport.pair()
        async with listeners.serve_network(lambda: ours, "127.0.0.1", 0) as url:
            with socket.socket() as line:
                line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                line.connect(host_and_port(url.removeprefix("tcp://")))
                line.sendall(FRAME)
                heard = Heard()
                await theirs.open(heard)
                await heard.until(1)
                await theirs.send(bytes(5 * 1024 * 1024))
                await theirs.close()
                async with asyncio.timeout(GUARD):
                    while len(asyncio.all_tasks()) > 2:  # this one and the one that accepts
                        await asyncio.sleep(0)

    asyncio.run(main())


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


async def press(board: VirtualBoard, times: int) -> None:
    now = asyncio.get_running_loop().time()
    for _ in range(times):
        board.press_button(1, now)
        board.release_button(1, now)
    await asyncio.sleep(0)


def subscribed(board: VirtualBoard) -> bool:
    return any(session.subscribed for session in board.sessions)


def test_the_end_closes_every_conversation() -> None:
    async def main() -> None:
        transport, heard = None, Heard()
        async with serve(VirtualBoard(), tcp=ANY_PORT) as (url,):
            transport = create(url)
            await transport.open(heard)
            await ask(transport, heard, LIST)
        assert await heard.until_lost() is not None
        await transport.close()
        again = create(url)
        with pytest.raises(OpenError):
            await again.open(Heard())

    asyncio.run(main())


@on_unix
def test_an_unplugged_pseudo_terminal_hangs_up() -> None:
    async def main() -> None:
        faults = Faults(unplug=len(FRAME))
        async with serve(VirtualBoard(), pty=True, faults=faults) as (url,):
            transport, heard = create(url), Heard()
            await transport.open(heard)
            await transport.send(FRAME)
            assert await heard.until_lost() is not None
            await transport.close()

    asyncio.run(main())


def test_an_unplugged_host_can_connect_again() -> None:
    async def main() -> None:
        faults = Faults(unplug=len(FRAME))
        async with serve(VirtualBoard(), tcp=ANY_PORT, faults=faults) as (url,):
            for _ in range(2):
                transport, heard = create(url), Heard()
                await transport.open(heard)
                await transport.send(FRAME)
                assert await heard.until_lost() is not None
                await transport.close()

    asyncio.run(main())


def test_each_connection_draws_its_own_faults() -> None:
    async def main() -> set[bytes]:
        seen = set()
        async with serve(VirtualBoard(servos=254), tcp=ANY_PORT, faults=Faults(flip=0.01), seed=3) as (url,):
            for _ in range(2):
                reader, writer = await client(url)
                writer.write(FRAME * 50)
                writer.write_eof()
                async with asyncio.timeout(GUARD):
                    seen.add(await reader.read(-1))
                writer.close()
                await writer.wait_closed()
        return seen

    assert len(asyncio.run(main())) == 2


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
