"""Hosts of a served board that do not read.

Module: servolink.transports.listeners.forwarding.
"""

from __future__ import annotations

import asyncio
import socket
import sys
from contextlib import ExitStack

import pytest

from servolink.protocol import (
    AddActionRequest,
    ButtonEventResponse,
    Codec,
    QueryActionRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    Step,
    SubscribeButtonEventRequest,
)
from servolink.transports import MAX_LATE, Connect, Faults, FaultyTransport, NetworkPlace, create, serve_network
from servolink.transports.listeners import forwarding
from servolink.virtual import VirtualBoard, VirtualTransport, serve
from tests.virtual.receiving import ANY_PORT, GUARD, Heard, ask

LIST = QueryServoListRequest()
ANSWER = QueryServoListResponse((1, 2, 3))
FRAME = Codec().encode(LIST)
EVENTS = Codec().encode(ButtonEventResponse(1, ButtonEventResponse.PRESS)) * 1000
BIG_ACTION = AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000)))
BIG_QUERIES = Codec().encode(QueryActionRequest(1)) * 400
ONE_PIECE = 10 * 65_536  # the responses to the requests that are passed on at once
on_unix = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals on Windows")


async def press(board: VirtualBoard, times: int) -> None:
    now = asyncio.get_running_loop().time()
    for _ in range(times):
        board.press_button(1, now)
        board.release_button(1, now)
    await asyncio.sleep(0)


def subscribed(board: VirtualBoard) -> bool:
    return any(session.subscribed for session in board.sessions)


@on_unix
def test_a_pseudo_terminal_that_nobody_reads_loses_what_has_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forwarding, "MAX_WAITING", 20_000)

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


def test_a_host_that_never_reads_is_left_behind_and_others_are_served(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forwarding, "MAX_WAITING", 20_000)

    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with serve(board, tcp=ANY_PORT) as (url,):
            line = socket.socket()
            line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            line.connect(NetworkPlace.parse(url.removeprefix("tcp://")))
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


def test_hosts_that_ask_a_lot_and_never_read_cost_little_and_others_are_served(monkeypatch: pytest.MonkeyPatch) -> None:
    """400 queries for 60 kB each, all in a few reads: 24 MB for each of 100 hosts, had they all been answered."""
    writers: list[asyncio.StreamWriter] = []
    bridge = forwarding.bridge

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
                    line.connect(NetworkPlace.parse(url.removeprefix("tcp://")))
                    line.sendall(BIG_QUERIES)
                for _ in range(20):
                    assert await ask(transport, heard, LIST) == ANSWER
                    most += waiting()
                while len(writers) < 101 or min(waiting()[1:]) == 0:  # until each has so much that it is heard no more
                    await asyncio.sleep(0)
                    most += waiting()
            await transport.close()
        assert max(most) <= forwarding.MAX_WAITING

    monkeypatch.setattr(forwarding, "bridge", watched)
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
            with socket.create_connection(NetworkPlace.parse(url.removeprefix("tcp://"))) as host:
                host.sendall(BIG_QUERIES)
                async with asyncio.timeout(GUARD):
                    while not lines or lines[0].late_bytes < MAX_LATE:
                        await asyncio.sleep(0)
                for _ in range(1000):
                    await asyncio.sleep(0)
                assert lines[0].late_bytes <= MAX_LATE + ONE_PIECE < forwarding.MAX_WAITING
        await clean.close()

    asyncio.run(main())
