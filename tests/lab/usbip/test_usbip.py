"""The virtual board over USB/IP, as hosts meet it: good ones, and others."""

from __future__ import annotations

import asyncio
import gc
import random
import shutil
import struct
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from typing import Any

import pytest

from servolink.protocol import (
    ButtonEventResponse,
    Codec,
    Packet,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    SubscribeButtonEventRequest,
    WriteProjectIDRequest,
)
from servolink.transports import NetworkPlace
from servolink.virtual import BoardKind, VirtualBoard
from tests import processes
from tests.lab.usb_board import serve_usb_device
from tests.lab.usbip import device, usbip_messages, usbip_server
from tests.lab.usbip.descriptors import BULK_IN, BULK_OUT, HID_IN, HID_OUT, SERIAL_IN, SERIAL_OUT
from tests.lab.usbip.usbip_host import IMPORT, UNLINKED, UsbHost, attached, submit, unlink
from tests.lab.usbip.usbip_server import UsbIpServer
from tests.virtual.receiving import GUARD

CODEC = Codec()
LIST, ANSWER = QueryServoListRequest(), QueryServoListResponse((1, 2, 3))
WAYS = {"serial": (SERIAL_OUT, SERIAL_IN), "hid": (HID_OUT, HID_IN), "bulk": (BULK_OUT, BULK_IN)}


pytestmark = pytest.mark.usefixtures("nothing_logged")  # whatever the other side does


def in_time(main: Callable[[], Coroutine[Any, Any, None]]) -> None:
    async def guarded() -> None:
        async with asyncio.timeout(GUARD):
            await main()

    asyncio.run(guarded())


@asynccontextmanager
async def exported(board: VirtualBoard | None = None) -> AsyncIterator[tuple[tuple[str, int], UsbIpServer]]:
    async with serve_usb_device(board or VirtualBoard(servos=3), "virtual-1", "127.0.0.1", 0) as (place, usbip):
        yield NetworkPlace.parse(place), usbip


async def ask(host: UsbHost, way: str, packet: Packet) -> bytes:
    """Ask a question and return the first bytes of the answer."""
    out, into = WAYS[way]
    read = host.submit(into, 64)
    write = host.submit(out, data=CODEC.encode(packet))
    said = {number: data for _, number, _, _, data in (await host.next(), await host.next())}
    assert set(said) == {read, write}
    return said[read]


async def detached(usbip: UsbIpServer) -> None:
    while usbip.attached:
        await asyncio.sleep(0)


@pytest.mark.parametrize("way", WAYS)
def test_each_of_the_three_ways_leads_to_the_board(way: str) -> None:
    async def main() -> None:
        async with exported() as (place, _), attached(*place) as host:
            assert (await ask(host, way, LIST)).startswith(CODEC.encode(ANSWER))

    in_time(main)


def test_the_three_ways_are_conversations_of_their_own_with_one_board() -> None:
    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with exported(board) as (place, _), attached(*place) as host:
            await ask(host, "hid", SubscribeButtonEventRequest(1))
            events = host.submit(HID_IN, 64)
            unrelated = host.submit(BULK_IN, 64)
            board.press_button(5, asyncio.get_running_loop().time())
            said = await host.next()
            assert said.number == events
            assert said.data.startswith(CODEC.encode(ButtonEventResponse(5, ButtonEventResponse.PRESS)))
            host.unlink(unrelated)
            assert (await host.next()).command == UNLINKED
        assert len(board.sessions) == 0

    in_time(main)


def test_the_list_has_the_device_with_its_interfaces() -> None:
    async def main() -> None:
        async with exported() as (place, _):
            reader, writer = await asyncio.open_connection(*place)
            writer.write(struct.pack(">HHI", 0x0111, 0x8005, 0))
            listed = await reader.read()
            writer.close()
        version, code, status, count = struct.unpack_from(">HHII", listed)
        assert (version, code, status, count) == (0x0111, 0x0005, 0, 1)
        assert listed[12 + 256 :].startswith(b"1-1\0")
        assert listed[12 + 312 :] == bytes.fromhex("02020000 0a000000 03000000 ff000000")

    in_time(main)


def test_a_urb_that_the_host_takes_back_is_told_of_once() -> None:
    async def main() -> None:
        async with exported() as (place, _), attached(*place) as host:
            read = host.submit(BULK_IN, 64)
            first, second = host.unlink(read), host.unlink(read)
            said = [await host.next(), await host.next()]
            assert [(each.command, each.number, each.status) for each in said] == [
                (UNLINKED, first, -104),
                (UNLINKED, second, 0),
            ]

    in_time(main)


def test_reports_come_one_each_millisecond_as_on_a_bus_and_the_rest_before_one_is_taken_back() -> None:
    async def main() -> None:
        board = VirtualBoard(servos=254)  # whose states are 44 reports
        async with exported(board) as (place, _), attached(*place) as host:
            loop = asyncio.get_running_loop()
            reads = [host.submit(HID_IN, 64) for _ in range(40)]
            host.submit(HID_OUT, data=CODEC.encode(QueryServoRequest(255)).ljust(64, b"\0"))
            start = loop.time()
            said = [await host.next() for _ in range(20)]
            assert loop.time() - start >= 18 * usbip_server.HID_INTERVAL
            unlinked = host.unlink(reads[-1])
            said += [await host.next() for _ in range(22)]
            assert [each.number for each in said if each.number in reads] == reads
            assert said[-1].number == unlinked

    in_time(main)


def test_the_descriptors_come_over_the_line_with_the_serial_number() -> None:
    async def main() -> None:
        async with exported() as (place, _), attached(*place) as host:
            device = (await host.control(0x80, 0x06, 0x0100, 0, 18)).data
            text = (await host.control(0x80, 0x06, 0x0300 | device[16], 0x0409, 255)).data
            assert text[2:].decode("utf-16-le") == "virtual-1"
            assert (await host.control(0x80, 0x06, 0x0F00, 0, 5)).status == -32

    in_time(main)


def test_pulling_the_plug_ends_everything_and_it_can_be_plugged_in_again() -> None:
    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with exported(board) as (place, usbip):
            for _ in range(3):
                async with attached(*place) as host:
                    assert (await ask(host, "bulk", LIST)).startswith(CODEC.encode(ANSWER))
                    host.submit(BULK_IN, 64)
                    usbip.unplug()
                    assert await host.ended()
                    await detached(usbip)
                    assert not board.sessions
            usbip.unplug()  # nobody has it: nothing to do

    in_time(main)


@pytest.mark.parametrize("way", WAYS)
def test_a_plug_pulled_before_the_answer_was_fetched_can_tear_what_was_stored(way: str) -> None:
    async def left(seed: int, *, fetched: bool) -> int:
        board = VirtualBoard(servos=3, seed=seed, kind=BoardKind(partial_writes=True, bus_powered=True))
        async with exported(board) as (place, usbip), attached(*place) as host:
            if fetched:
                await ask(host, way, WriteProjectIDRequest(77))
            else:
                await host.transfer(WAYS[way][0], data=CODEC.encode(WriteProjectIDRequest(77)))
            usbip.unplug()
            await detached(usbip)
        assert not board.powered
        return board.storage.project_id

    async def main() -> None:
        assert {await left(seed, fetched=True) for seed in range(20)} == {77}
        assert {await left(seed, fetched=False) for seed in range(20)} == {0, 77}

    in_time(main)


def test_one_host_has_the_device_at_a_time_and_the_next_one_when_it_leaves() -> None:
    async def main() -> None:
        async with exported() as (place, usbip):
            async with attached(*place) as first:
                reader, writer = await asyncio.open_connection(*place)
                writer.write(IMPORT)
                assert await reader.read() == struct.pack(">HHI", 0x0111, 0x0003, 2)
                writer.close()
                assert (await ask(first, "bulk", LIST)).startswith(CODEC.encode(ANSWER))
            await detached(usbip)
            async with attached(*place) as second:
                assert (await ask(second, "bulk", LIST)).startswith(CODEC.encode(ANSWER))

    in_time(main)


def test_a_device_that_is_not_there_is_refused() -> None:
    async def main() -> None:
        async with exported() as (place, usbip):
            reader, writer = await asyncio.open_connection(*place)
            writer.write(struct.pack(">HHI32s", 0x0111, 0x8003, 0, b"1-2"))
            assert await reader.read() == struct.pack(">HHI", 0x0111, 0x0003, 4)
            writer.close()
            assert not usbip.attached

    in_time(main)


def test_events_that_nobody_reads_do_not_pile_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "MAX_WAITING", 100_000)

    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with exported(board) as (place, _), attached(*place) as host:
            await ask(host, "serial", SubscribeButtonEventRequest(1))
            now = asyncio.get_running_loop().time()
            for _ in range(10_000):
                board.press_button(1, now)
                board.release_button(1, now)
            assert (await ask(host, "bulk", LIST)).startswith(CODEC.encode(ANSWER))

    in_time(main)


# Hosts that no kernel is


def command(kind: int, direction: int, endpoint: int, length: int, packets: int = -1) -> bytes:
    return struct.pack(">5IIi3i8x", kind, 1, 0x10001, direction, endpoint, 0, length, 0, packets, 0)


@pytest.mark.parametrize(
    "said",
    [
        command(9, 0, 1, 0),
        command(1, 7, 1, 0),
        command(1, 0, 200, 0),
        command(1, 0, 1, -1),
        command(1, 1, 4, -5),
        command(1, 0, 1, usbip_messages.MAX_DATA + 1),
        command(1, 1, 4, 64, packets=8),
        submit(5, BULK_IN, 64) * 2,
        b"".join(submit(number, BULK_IN, 64) for number in range(usbip_server.MAX_OUTSTANDING + 1)),
    ],
    ids=["command", "direction", "endpoint", "length", "room", "too-long", "isochronous", "number", "too-many"],
)
def test_a_host_that_says_what_no_host_says_is_disconnected_and_the_next_one_served(said: bytes) -> None:
    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with exported(board) as (place, usbip):
            async with attached(*place) as host:
                host.writer.write(said)
                assert await host.ended()
            await detached(usbip)
            gc.collect()  # an error that nobody took would be logged now
            assert not board.sessions
            async with attached(*place) as host:
                assert (await ask(host, "bulk", LIST)).startswith(CODEC.encode(ANSWER))

    in_time(main)


def test_a_host_that_sends_and_never_reads_is_disconnected_at_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usbip_server, "MAX_PENDING_BYTES", 100_000)

    async def main() -> None:
        async with exported(VirtualBoard(servos=254)) as (place, usbip), attached(*place) as host:
            for _ in range(200):
                host.submit(BULK_OUT, data=CODEC.encode(LIST) * 1000)
            assert await host.ended()
            await detached(usbip)

    in_time(main)


@pytest.mark.parametrize(
    "said",
    [
        b"",
        b"\x01",
        b"GET / HTTP/1.1\r\n\r\n",
        struct.pack(">HHI", 0x0100, 0x8005, 0),
        struct.pack(">HHI", 0x0111, 0x1234, 0),
        IMPORT[:20],
    ],
)
def test_what_is_no_usbip_is_hung_up_on(said: bytes) -> None:
    async def main() -> None:
        async with exported() as (place, usbip):
            reader, writer = await asyncio.open_connection(*place)
            writer.write(said)
            writer.write_eof()
            assert await reader.read() == b""
            writer.close()
            assert not usbip.attached

    in_time(main)


def test_a_host_that_says_nothing_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(usbip_server, "_OPENING_LIMIT", 0.01)

    async def main() -> None:
        async with exported() as (place, _):
            reader, writer = await asyncio.open_connection(*place)
            assert await reader.read() == b""
            writer.close()

    in_time(main)


@pytest.mark.parametrize("seed", range(20))
def test_any_commands_end_in_answers_or_a_hang_up(seed: int) -> None:
    """Mostly well-formed commands with wild values: the server stays able to serve."""
    chance = random.Random(seed)

    def anything() -> bytes:
        match chance.randrange(8):
            case 0:
                return unlink(chance.randrange(100), chance.randrange(100))
            case 1:
                return submit(chance.randrange(2**32), 0x80, chance.randrange(300), setup=chance.randbytes(8))
            case 2:
                return submit(chance.randrange(2**32), 0x00, data=chance.randbytes(9), setup=chance.randbytes(8))
            case 3 | 4:
                return submit(chance.randrange(2**32), 0x80 | chance.randrange(16), chance.choice((0, 1, 64, 4096)))
            case _:
                data = chance.randbytes(chance.randrange(200)) + CODEC.encode(LIST)
                return submit(chance.randrange(2**32), chance.randrange(1, 16), data=data)

    async def main() -> None:
        board = VirtualBoard(servos=3)
        async with exported(board) as (place, usbip):
            async with attached(*place) as host:
                host.writer.write(b"".join(anything() for _ in range(500)))
                host.writer.write(command(99, 0, 0, 0))
                assert await host.ended()
            await detached(usbip)
            async with attached(*place) as host:
                assert (await ask(host, "bulk", LIST)).startswith(CODEC.encode(ANSWER))

    in_time(main)


@pytest.mark.skipif(shutil.which("usbip") is None, reason="the tool `usbip` is not installed")
def test_the_stock_tool_lists_the_device() -> None:
    async def main() -> None:
        async with exported() as ((name, port), _):
            command = ("usbip", "--tcp-port", str(port), "list", "--parsable", "-r", name)
            tool = await processes.start_async(*command)
            output, _ = await tool.communicate()
            assert tool.returncode == 0
            assert b"1-1" in output
            assert b"(1209:0001)" in output

    in_time(main)
