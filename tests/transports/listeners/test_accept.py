"""Accepting connections: what hosts that fail, vanish or come too many do to the others."""

from __future__ import annotations

import asyncio
import errno
import socket
from itertools import pairwise
from typing import Any

import pytest

from servolink.protocol import QueryServoListRequest, QueryServoListResponse
from servolink.transports.listeners import accept, strangers
from servolink.transports.listeners.forwarding import listen
from servolink.transports.registry import create
from servolink.transports.stream import keep_alive
from servolink.virtual import VirtualBoard, serve
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
    assert strangers.Strangers.most_connections() == most


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

    monkeypatch.setattr(accept, "keep_alive", fail_once)
    asyncio.run(main())


def test_the_system_holds_little_for_a_host_and_notices_when_it_vanishes(monkeypatch: pytest.MonkeyPatch) -> None:
    options: list[int] = []

    async def converse(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, _: object) -> None:
        line = writer.get_extra_info("socket")
        options.append(line.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE))
        options.append(line.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF))
        options.append(line.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
        writer.close()

    async def main() -> None:
        async with listen(converse, "127.0.0.1", 0) as place:
            reader, writer = await client(place)
            async with asyncio.timeout(GUARD):
                assert await reader.read() == b""
            writer.close()

    asyncio.run(main())
    assert options[0] == 1
    assert options[1] <= 1024 * 1024
    assert options[2], "short responses would wait for the acknowledgement of those before them"


def test_connections_that_cannot_be_accepted_are_told_once_and_accepted_later(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(accept, "_ACCEPT_PAUSE", 0.0)
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
        "no connection can be accepted, trying again: [Errno 24] Too many open files"
    ]


def test_accepting_is_tried_ten_times_a_second_and_its_failure_is_told_each_minute(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    attempts: list[float] = []

    async def main() -> None:
        loop = asyncio.get_running_loop()

        async def sock_accept(listening: socket.socket) -> Any:
            attempts.append(loop.time())
            if len(attempts) == 1500:
                raise asyncio.CancelledError
            raise OSError(errno.EMFILE, "Too many open files")

        monkeypatch.setattr(loop, "sock_accept", sock_accept)
        with socket.socket() as listening, pytest.raises(asyncio.CancelledError):
            await accept._accept(listening, strangers.Strangers(), lambda connection: None)

    run(main())
    assert [two - one for one, two in pairwise(attempts)] == pytest.approx([0.1] * 1499)
    assert len(caplog.records) == 3
