from __future__ import annotations

import asyncio
import errno
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from servolink.errors import ConnectionLost
from servolink.transports import usb
from servolink.transports.registry import create
from tests.transports.fake_usb import FakeUsb, failure, plugged_in
from tests.transports.wires import Ear, on_loop


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[FakeUsb]:
    yield from plugged_in(monkeypatch, tmp_path)


async def _sent(board: FakeUsb, *frames: bytes) -> list[bytes]:
    """Return the transfers that carry frames."""
    transfers: list[bytes] = []
    board.heard = transfers.append
    transport = create("usb://")
    await transport.open(Ear())
    for frame in frames:
        await transport.send(frame)
    await transport.close()
    return transfers


@on_loop
async def test_an_empty_packet_follows_a_frame_that_ends_with_a_full_one(board: FakeUsb) -> None:
    assert await _sent(board, bytes(63), bytes(64), bytes(65), bytes(128)) == [
        bytes(63),
        bytes(64),
        b"",
        bytes(65),
        bytes(128),
        b"",
    ]


@on_loop
async def test_a_long_frame_goes_in_several_transfers(board: FakeUsb) -> None:
    frame = bytes(range(256)) * 200
    transfers = await _sent(board, frame)
    assert b"".join(transfers) == frame
    assert [len(transfer) for transfer in transfers] == [16384, 16384, 16384, 2048, 0]


@on_loop
async def test_what_is_taken_in_part_is_not_sent_twice(board: FakeUsb) -> None:
    transfers: list[bytes] = []
    board.heard = transfers.append
    transport = create("usb://")
    await transport.open(Ear())
    board.set(part=64)
    await transport.send(bytes(range(200)))
    await transport.close()
    assert transfers == [bytes(range(64)), bytes(range(64, 200))]


@on_loop
async def test_packets_come_in_short_full_and_empty(board: FakeUsb) -> None:
    transport, ear = create("usb://"), Ear()
    await transport.open(ear)
    packets = [bytes([number]) * (number % 65) for number in range(130)]
    board.bring(*packets)
    assert await ear.hear(sum(map(len, packets))) == b"".join(packets)
    await transport.close()


@on_loop
async def test_what_an_earlier_program_left_unread_is_dropped(board: FakeUsb) -> None:
    board.bring(b"stale" * 10, b"", bytes(64))
    transport, ear = create("usb://"), Ear()
    await transport.open(ear)
    board.bring(b"fresh")
    assert await ear.hear(5) == b"fresh"
    await transport.close()


@on_loop
async def test_a_board_that_never_stops_talking_is_opened_all_the_same(
    board: FakeUsb, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(usb, "_STALE_LIMIT", 0.0)
    board.bring(b"1", b"2", b"3")
    transport, ear = create("usb://"), Ear()
    await transport.open(ear)
    assert await ear.hear(2) == b"23"
    await transport.close()


@pytest.mark.parametrize("halted", [0x81, 0x01])
@on_loop
async def test_a_halt_is_cleared_and_the_connection_goes_on(board: FakeUsb, halted: int) -> None:
    transport, ear = create("usb://"), Ear()
    await transport.open(ear)
    heard: list[bytes] = []
    board.heard = heard.append
    board.set(halted={halted})
    if halted == 0x01:
        await transport.send(b"lost on the way")
    board.bring(b"answer")
    assert await ear.hear(6) == b"answer"
    await transport.send(b"next")
    assert heard == [b"next"]
    assert board.calls == [f"clear_halt {halted:#04x}"]
    assert ear.losses == []
    await transport.close()


@on_loop
async def test_a_halt_that_an_earlier_program_left_is_cleared(board: FakeUsb) -> None:
    board.halted = {0x81}
    transport = create("usb://")
    await transport.open(Ear())
    await transport.close()
    assert board.calls == ["clear_halt 0x81"]


@on_loop
async def test_a_halt_that_comes_back_for_ever_is_the_end(board: FakeUsb, monkeypatch: pytest.MonkeyPatch) -> None:
    cleared: list[int] = []
    monkeypatch.setattr(board, "clear_halt", lambda handle, address: cleared.append(address))
    transport, ear = create("usb://"), Ear()
    await transport.open(ear)
    board.set(halted={0x81})
    error = await ear.end()
    assert isinstance(error, ConnectionLost)
    assert "Pipe error; is it unplugged or switched off?" in str(error)
    assert cleared == [0x81] * 10
    await transport.close()


@on_loop
async def test_a_halt_that_cannot_be_cleared_is_the_end(board: FakeUsb, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(handle: object, address: int) -> None:
        raise failure(errno.ENODEV, "No such device")

    monkeypatch.setattr(board, "clear_halt", fail)
    transport, ear = create("usb://"), Ear()
    await transport.open(ear)
    board.set(halted={0x81})
    assert "No such device" in str(await ear.end())
    await transport.close()


@pytest.mark.parametrize("seed", range(20))
@on_loop
async def test_a_board_unplugged_at_any_time_is_one_clear_loss(board: FakeUsb, seed: int) -> None:
    chance = Random(seed)
    transport, ear = create("usb://"), Ear()
    await transport.open(ear)
    sends = [asyncio.ensure_future(transport.send(bytes(chance.randrange(1, 5000)))) for _ in range(20)]
    board.bring(*(bytes(chance.randrange(65)) for _ in range(20)))
    for _ in range(chance.randrange(10)):
        await asyncio.sleep(0)
    board.unplug()
    assert isinstance(await ear.end(), ConnectionLost)
    results = await asyncio.gather(*sends, return_exceptions=True)
    assert {type(result) for result in results} <= {type(None), ConnectionLost}
    await transport.close()
    assert len(ear.losses) == 1
