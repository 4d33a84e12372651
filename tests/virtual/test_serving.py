"""Boards served over real pseudo-terminals and sockets.

Module: servolink.virtual.servers.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys

import pytest

from servolink.errors import OpenError
from servolink.protocol import (
    ButtonEventResponse,
    Codec,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    SubscribeButtonEventRequest,
)
from servolink.transports import Faults, NetworkPlace, create
from servolink.virtual.board import VirtualBoard
from servolink.virtual.servers import serve
from tests.virtual.receiving import ANY_PORT, GUARD, Heard, ask, client

LIST = QueryServoListRequest()
ANSWER = QueryServoListResponse((1, 2, 3))
FRAME, REPLY = Codec().encode(LIST), Codec().encode(ANSWER)
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
            assert (await heard_one.until(3))[1:] == [
                ButtonEventResponse(5, ButtonEventResponse.PRESS),
                ButtonEventResponse(5, ButtonEventResponse.UP),
            ]
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
                line.connect(NetworkPlace.parse(url.removeprefix("tcp://")))
                line.setblocking(False)
                await loop.sock_sendall(line, Codec().encode(QueryServoRequest(255)) * 1000)
                line.shutdown(socket.SHUT_WR)
                got = 0
                async with asyncio.timeout(GUARD):
                    while chunk := await loop.sock_recv(line, 65536):
                        got += len(chunk)
                return got

    assert asyncio.run(main()) == 1000 * (9 + 1 + 11 * 254)


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
