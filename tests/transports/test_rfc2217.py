"""Serial servers with RFC 2217: what is agreed on at the opening, and servers that refuse, keep silent or lie.

Modules: servolink.transports.rfc2217.
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, cast

import pytest
import serial.rfc2217  # type: ignore[import-untyped]

from servolink.client import connect
from servolink.errors import InvalidAddress, OpenError
from servolink.transports.registry import create
from servolink.transports.rfc2217 import Rfc2217Transport
from servolink.virtual import VirtualBoard, serve
from tests.transports.wires import Ear, Rfc2217Wire, on_loop

FRAME = bytes.fromhex("134c051dffff00009e")
DO, WILL, DONT, WONT = b"\xff\xfd", b"\xff\xfb", b"\xff\xfe", b"\xff\xfc"
AGREES = DO + b"\x2c" + WILL + b"\x2c" + DO + b"\x00" + WILL + b"\x00"


def confirmed(code: int, content: bytes) -> bytes:
    return b"\xff\xfa\x2c" + bytes([code]) + content + b"\xff\xf0"


CONFIRMS = {
    "baud rate": confirmed(101, (115200).to_bytes(4)),
    "data bits": confirmed(102, b"\x08"),
    "parity": confirmed(103, b"\x01"),
    "stop bits": confirmed(104, b"\x01"),
}


class Server(asyncio.Protocol):
    """Server that says the same to whoever connects, and hears what it is told."""

    def __init__(self, says: tuple[bytes, ...], *, closes: bool) -> None:
        self.says, self.closes = says, closes
        self.heard = bytearray()
        self.over = asyncio.Event()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        for each in self.says:
            transport.write(each)
        if self.closes:
            transport.close()

    def data_received(self, data: bytes) -> None:
        self.heard += data

    def connection_lost(self, exc: Exception | None) -> None:
        self.over.set()


@asynccontextmanager
async def server(*says: bytes, closes: bool = False) -> AsyncIterator[tuple[str, bytearray]]:
    """Serve one client, which must close the connection; yield the address, and what the server hears."""
    end = Server(says, closes=closes)
    serving = await asyncio.get_running_loop().create_server(lambda: end, "127.0.0.1", 0)
    yield f"rfc2217://127.0.0.1:{serving.sockets[0].getsockname()[1]}?timeout=0.3", end.heard
    await end.over.wait()
    serving.close()
    await serving.wait_closed()


async def refusal(url: str) -> str:
    transport, ear = create(url), Ear()
    with pytest.raises(OpenError) as caught:
        await transport.open(ear)
    await transport.close()
    assert ear.losses == []
    return str(caught.value)


@on_loop
async def test_the_port_of_the_server_is_set_as_a_serial_port_is() -> None:
    async with Rfc2217Wire() as wire:
        wire.port.bytesize, wire.port.parity, wire.port.stopbits, wire.port.rtscts = 7, "E", 2, True
        wire.port.dtr = wire.port.rts = True
        await wire.open()
        found = wire.port.baudrate, wire.port.bytesize, wire.port.parity, wire.port.stopbits, wire.port.rtscts
        assert found == (115200, 8, "N", 1, False)
        assert (wire.port.dtr, wire.port.rts) == (False, False)
        assert isinstance(wire.transport, Rfc2217Transport)
        assert wire.transport.bytes_per_second == 11520


@on_loop
async def test_options_of_the_address_are_those_of_serial_ports() -> None:
    async with Rfc2217Wire() as wire:
        wire.transport = create(f"{wire.transport.url}?baudrate=1044735&dtr=1&rts=1")  # 000ff0ff: with an escape
        await wire.open()
        assert (wire.port.baudrate, wire.port.dtr, wire.port.rts) == (1044735, True, True)


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("rfc2217://h", "needs a port from 1 to 65535"),
        ("rfc2217://:9000", "must be written rfc2217://host:port"),
        ("rfc2217://h:9000/x", "must be written rfc2217://host:port"),
        ("rfc2217://h:9000?logging=debug", "unknown option logging"),
        ("rfc2217://h:9000?baudrate=1", "an integer from 50 to 12000000"),
    ],
)
def test_a_wrong_address_is_refused(url: str, text: str) -> None:
    with pytest.raises(InvalidAddress, match=text):
        create(url)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals on Windows")
@on_loop
async def test_a_program_uses_a_board_behind_the_server_of_pyserial() -> None:
    loop = asyncio.get_running_loop()

    class Terminal(serial.Serial):  # type: ignore[misc]
        """Pseudo-terminal, which has no modem lines."""

        cts = dsr = ri = cd = property(lambda _: False)  # pyright: ignore[reportIncompatibleMethodOverride]

        def _update_dtr_state(self) -> None:
            pass

        _update_rts_state = _update_dtr_state

    class Redirector(asyncio.Protocol):
        """What pyserial's example of a server does, on the loop."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            assert isinstance(transport, asyncio.Transport)
            self.write = transport.write
            self.manager = cast("Any", serial.rfc2217.PortManager)(port, self)
            loop.add_reader(port.fileno(), self.pass_on)

        def pass_on(self) -> None:
            self.write(b"".join(self.manager.escape(os.read(port.fileno(), 4096))))

        def data_received(self, data: bytes) -> None:
            port.write(b"".join(self.manager.filter(data)))

        def connection_lost(self, exc: Exception | None) -> None:
            loop.remove_reader(port.fileno())

    async with serve(VirtualBoard(servos=3), pty=True) as (terminal,):
        port = Terminal(terminal.removeprefix("serial://"), baudrate=9600, timeout=0)
        serving = await loop.create_server(Redirector, "127.0.0.1", 0)
        url = f"rfc2217://127.0.0.1:{serving.sockets[0].getsockname()[1]}"
        for _ in range(2):
            async with connect(url) as board:
                assert [servo.servo_id for servo in await board.servos()] == [1, 2, 3]
                await board.move({1: 25, 2: -1}, duration=0.05, wait=True)  # -1 is ffff
                assert [int((await board.servo(servo)).angle) for servo in (1, 2)] == [25, -1]
        serving.close()
        await serving.wait_closed()
        port.close()


@on_loop
async def test_a_server_that_only_passes_bytes_is_named_in_bounded_time() -> None:
    async with server() as (url, _):
        text = await refusal(url)
    assert "did not answer the offer of RFC 2217 within 0.3 s; if it only passes bytes, write tcp://127.0.0.1:" in text


@pytest.mark.parametrize("left_out", CONFIRMS)
@on_loop
async def test_a_setting_without_an_answer_is_named_in_bounded_time(left_out: str) -> None:
    says = [each for name, each in CONFIRMS.items() if name != left_out]
    async with server(AGREES, *says) as (url, _):
        assert f"did not answer {'the ' if 'rate' in left_out else ''}{left_out} within" in await refusal(url)


@pytest.mark.parametrize(
    ("says", "text"),
    [
        ([DONT + b"\x2c"], "refuses RFC 2217; if it only passes bytes"),
        ([DONT + b"\x00"], "refuses bytes of 8 bits"),
        ([AGREES, WONT + b"\x00"], "refuses bytes of 8 bits"),
        ([AGREES, *CONFIRMS.values(), confirmed(101, (9600).to_bytes(4))], "set the baud rate to 9600, not 115200"),
        ([AGREES, *CONFIRMS.values(), confirmed(103, b"\x03")], "set parity to 3, not 1"),
        ([b"\xff\xfa\x2c" + b"x" * 5000], "a Telnet command without an end"),
    ],
)
@on_loop
async def test_a_server_that_refuses_or_lies_is_told(says: list[bytes], text: str) -> None:
    async with server(b"".join(says)) as (url, _):
        assert text in await refusal(url)


@on_loop
async def test_a_server_that_closes_is_told() -> None:
    async with server(AGREES, closes=True) as (url, _):
        assert "lost while being opened" in await refusal(url)


@on_loop
async def test_other_options_are_refused_once_and_answers_never_go_in_circles() -> None:
    flood = b"".join(verb + bytes([option]) for option in range(256) for verb in (DO, WILL, WONT))
    flood = flood.replace(WONT + b"\x00", b"")
    async with server(flood * 50, AGREES, *CONFIRMS.values()) as (url, heard):
        transport = create(url)
        await transport.open(Ear())
        await transport.close()
        assert heard.count(WONT + b"\x01") == heard.count(DONT + b"\x01") == 1
        assert heard.count(WILL + b"\x2c") == heard.count(DO + b"\x2c") == 1
        assert len(heard) < 2000


@on_loop
async def test_commands_cut_anywhere_and_doubled_bytes_reach_nobody() -> None:
    noise = WILL + b"\x01" + confirmed(107, b"\xff\xff") + b"\xff\xf1" + confirmed(101, b"") + b"\xff\xfa\xff\xf0"
    async with Rfc2217Wire() as wire:
        ear = await wire.open()
        for byte in (noise + FRAME.replace(b"\xff", b"\xff\xff")) * 3:
            wire.write(bytes([byte]))
            await asyncio.sleep(0)
        assert await ear.hear(3 * len(FRAME)) == FRAME * 3


@on_loop
async def test_a_command_without_an_end_loses_the_connection() -> None:
    async with Rfc2217Wire() as wire:
        ear = await wire.open()
        wire.write(b"\xff\xfa\x2c" + b"x" * 5000)
        assert "without an end" in str(await ear.end())


@on_loop
async def test_a_cancelled_opening_leaves_nothing_open() -> None:
    async with server() as (url, heard):
        transport = create(url.replace("0.3", "60"))
        opening = asyncio.ensure_future(transport.open(Ear()))
        while not heard:
            await asyncio.sleep(0)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        await transport.close()
