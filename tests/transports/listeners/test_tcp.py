"""Listening over TCP: at which addresses and ports, and what to do if that fails."""

from __future__ import annotations

import asyncio
import errno
import re
import socket
from typing import Any

import pytest

from servolink.errors import OpenError, TransportUnavailable
from servolink.protocol import QueryServoListRequest, QueryServoListResponse
from servolink.transports.listeners.tcp import NetworkPlace
from servolink.transports.registry import create
from servolink.virtual import VirtualBoard, serve
from tests.virtual.receiving import ANY_PORT, Heard, ask

LIST = QueryServoListRequest()
ANSWER = QueryServoListResponse((1, 2, 3))


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
        (OSError(errno.EADDRNOTAVAIL, "not available"), "use an address of this machine"),
        (
            socket.gaierror(socket.EAI_NONAME, "not known"),
            "use an address of this machine, such as 127.0.0.1, or",
        ),
        (
            OSError(errno.EADDRINUSE, "in use (while attempting to bind)"),
            "try another port, or 0",
        ),
    ],
)
def test_who_cannot_listen_is_told_what_helps(error: OSError, remedy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: Any, **options: Any) -> socket.socket:
        raise error

    monkeypatch.setattr(socket, "create_server", fail)
    reason = str(error.strerror).removesuffix(" (while attempting to bind)")
    with pytest.raises(OpenError, match=re.escape(f"cannot listen at 127.0.0.1:5: {reason}; {remedy}")):
        asyncio.run(NetworkPlace("127.0.0.1", 5).listen())


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
        NetworkPlace.parse(text)


@pytest.mark.parametrize("host", ["a..b", "%ff", "x" * 70])
def test_a_name_that_no_host_can_have_is_told(host: str) -> None:
    async def main() -> None:
        async with serve(VirtualBoard(), tcp=f"{host}:0"):
            pass

    with pytest.raises(OpenError, match="no host can have such a name; write an IP address"):
        asyncio.run(main())


def test_hosts_and_ports_are_split() -> None:
    assert NetworkPlace.parse("[::1]:0") == ("::1", 0)
    assert NetworkPlace.parse("localhost:65535") == ("localhost", 65535)


@pytest.mark.parametrize(
    ("url", "who"),
    [
        ("tcp://127.0.0.1:9000", "every user of this machine"),
        ("tcp://[::1]:9000", "every user of this machine"),
        ("tcp://0.0.0.0:9000", "everybody in the network"),
        ("tcp://[::]:9000", "everybody in the network"),
        ("tcp://192.168.0.7:9000", "everybody in the network"),
    ],
)
def test_only_loopback_addresses_are_for_this_machine(url: str, who: str) -> None:
    assert NetworkPlace.parse(url.removeprefix("tcp://")).reached_by == who
