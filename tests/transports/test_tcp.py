from __future__ import annotations

import asyncio
import socket

import pytest

from servolink.errors import OpenError
from servolink.transports.registry import create
from servolink.transports.stream import TcpTransport
from tests.transports.wires import Ear, TcpWire, on_loop


async def _open_error(url: str) -> str:
    with pytest.raises(OpenError) as caught:
        await create(url).open(Ear())
    return str(caught.value)


@on_loop
async def test_a_refused_connection_says_what_to_start() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
        text = await _open_error(f"tcp://127.0.0.1:{port}")
    assert f"nothing listens on port {port} of 127.0.0.1; start the bridge" in text


@pytest.mark.parametrize("host", ["nowhere.invalid", "a" * 70, "bad..name", "x%20y"])
@on_loop
async def test_a_name_that_is_no_host_is_told(host: str) -> None:
    assert "there is no host" in await _open_error(f"tcp://{host}:9000")


@on_loop
async def test_a_name_that_is_no_text_is_shown_once_escaped() -> None:
    assert r"there is no host '\xff'" in await _open_error("tcp://%ff:9000")


@on_loop
async def test_a_host_that_does_not_answer_is_given_up() -> None:
    with socket.socket() as full:  # a queue of one that is full: the system answers no further connection
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        port = full.getsockname()[1]
        queued = [socket.socket() for _ in range(4)]
        for one in queued:
            one.setblocking(False)
            one.connect_ex(("127.0.0.1", port))
        text = await _open_error(f"tcp://127.0.0.1:{port}?timeout=0.1")
        for one in queued:
            one.close()
    assert "no answer within 0.1 s" in text


@on_loop
async def test_other_failures_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    async def fail(*_: object) -> None:
        raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(asyncio.get_running_loop(), "create_connection", fail)
    assert "cannot connect: Network is unreachable; check" in await _open_error("tcp://192.0.2.1:1")


@on_loop
async def test_frames_are_not_held_back_and_a_dead_peer_is_noticed() -> None:
    async with TcpWire() as wire:
        await wire.open()
        assert isinstance(wire.transport, TcpTransport)
        assert wire.transport._pipe is not None
        connection = wire.transport._pipe.get_extra_info("socket")
        assert connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        assert connection.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)


@on_loop
async def test_ipv6_hosts_stand_in_brackets() -> None:
    accepted = asyncio.Event()

    async def accept(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        accepted.set()
        writer.transport.abort()

    try:
        server = await asyncio.start_server(accept, "::1", 0)
    except OSError:
        pytest.skip("this machine has no IPv6")
    async with server:
        transport = create(f"tcp://[::1]:{server.sockets[0].getsockname()[1]}")
        await transport.open(Ear())
        await accepted.wait()
        await transport.close()
    assert accepted.is_set()


@on_loop
async def test_socket_is_another_name_of_tcp() -> None:
    async with TcpWire() as wire:
        wire.transport = create(wire.transport.url.replace("tcp://", "socket://"))
        ear = await wire.open()
        await wire.say(b"x")
        assert await ear.hear(1) == b"x"
        assert wire.transport.url.startswith("socket://")
