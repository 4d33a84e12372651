"""Boards served over real pseudo-terminals and sockets.

Module: servolink.virtual.serve.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from contextlib import ExitStack

import pytest

from servolink.errors import OpenError
from servolink.listeners import forwarding as bridging
from servolink.listeners.forwarding import Connect, serve_network
from servolink.listeners.tcp import host_and_port
from servolink.protocol.codec import Codec
from servolink.protocol.editing import AddActionRequest, QueryActionRequest
from servolink.protocol.joystick import PRESS, UP, ButtonEventResponse, SubscribeButtonEventRequest
from servolink.protocol.records import Step
from servolink.protocol.servos import QueryServoListRequest, QueryServoListResponse, QueryServoRequest
from servolink.transports.line_faults import MAX_LATE, Faults, FaultyTransport
from servolink.transports.registry import create
from servolink.virtual.board import VirtualBoard
from servolink.virtual.serve import serve
from servolink.virtual.transport import VirtualTransport
from tests.virtual.receiving import ANY_PORT, GUARD, Heard, ask, client

LIST = QueryServoListRequest()
ANSWER = QueryServoListResponse((1, 2, 3))
FRAME, REPLY = Codec().encode(LIST), Codec().encode(ANSWER)
EVENTS = Codec().encode(ButtonEventResponse(1, PRESS)) * 1000
on_unix = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals on Windows")


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
    monkeypatch.setattr(bridging, "MAX_WAITING", 20_000)

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


def test_a_host_that_asks_a_lot_at_once_and_reads_slowly_gets_it_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("servolink.virtual.board._SILENCE", GUARD)  # a busy machine may pause in the middle of a frame

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
    monkeypatch.setattr(bridging, "MAX_WAITING", 20_000)

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
ONE_PIECE = 10 * 65_536  # the responses to the requests that are passed on at once


def test_hosts_that_ask_a_lot_and_never_read_cost_little_and_others_are_served(monkeypatch: pytest.MonkeyPatch) -> None:
    """400 queries for 60 kB each, all in a few reads: 24 MB for each of 100 hosts, had they all been answered."""
    writers: list[asyncio.StreamWriter] = []
    bridge = bridging.bridge

    async def watched(
        reader: asyncio.StreamReader, writer: asyncio.StreamWriter, connect: Connect, *, begin: bytes
    ) -> None:
        writers.append(writer)
        await bridge(reader, writer, connect, begin=begin)

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
        assert max(most) <= bridging.MAX_WAITING

    monkeypatch.setattr(bridging, "bridge", watched)
    asyncio.run(main())


def test_responses_that_are_late_cost_little() -> None:
    """As above, on a line on which all responses are still to come."""
    lines: list[FaultyTransport] = []
    board = VirtualBoard(servos=3)

    def connect() -> FaultyTransport:
        lines.append(FaultyTransport(VirtualTransport(board), Faults(delay=1.0, delay_time=3600), sent=False))
        return lines[-1]

    async def main() -> None:
        clean = VirtualTransport(board)
        await clean.open(heard := Heard())
        await ask(clean, heard, BIG_ACTION)
        async with serve_network(connect, "127.0.0.1", 0) as url:
            with socket.create_connection(host_and_port(url.removeprefix("tcp://"))) as host:
                host.sendall(BIG_QUERIES)
                async with asyncio.timeout(GUARD):
                    while not lines or lines[0].late_bytes < MAX_LATE:
                        await asyncio.sleep(0)
                for _ in range(1000):
                    await asyncio.sleep(0)
                assert lines[0].late_bytes <= MAX_LATE + ONE_PIECE < bridging.MAX_WAITING
        await clean.close()

    asyncio.run(main())


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
