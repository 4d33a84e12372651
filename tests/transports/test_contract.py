"""What every transport must do, whatever its kind.

Modules: servolink.transports.base, servolink.transports.stream.
"""

from __future__ import annotations

import asyncio
import gc
import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from servolink.errors import ConnectionLost, OpenError
from servolink.transports import lifecycle, stream, threaded
from servolink.transports.base import Transport
from servolink.transports.registry import create
from tests.transports.wires import LIMIT, WIRES, Ear, Wire, on_loop

FRAME = bytes.fromhex("134c051d2f2700009e")
CONNECTIONS = 12  # enough to see a leak


@pytest.fixture(params=WIRES)
def make(request: pytest.FixtureRequest, tmp_path: Path) -> Callable[[], Wire]:
    """Make wires of each kind."""
    kind = WIRES[request.param]
    return lambda: kind(tmp_path)


pytestmark = pytest.mark.usefixtures("nothing_logged")  # whatever the other side does


def _raise_bug(_: bytes) -> None:
    raise ValueError("a bug in the receiver")


@on_loop
async def test_carries_bytes_both_ways(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        ear = await wire.open()
        await wire.transport.send(FRAME)
        assert await wire.far.hear(len(FRAME)) == FRAME
        await wire.say(FRAME[::-1])
        assert await ear.hear(len(FRAME)) == FRAME[::-1]


@on_loop
async def test_every_byte_value_passes_unchanged(make: Callable[[], Wire]) -> None:
    every = bytes(range(256)) * 3
    async with make() as wire:
        ear = await wire.open()
        await wire.transport.send(every)
        await wire.say(every)
        assert await wire.far.hear(len(every)) == every
        assert await ear.hear(len(every)) == every


@on_loop
async def test_chunks_arrive_in_order_and_whole(make: Callable[[], Wire]) -> None:
    chunks = [bytes([number]) * (1 + number * 7) for number in range(200)]
    async with make() as wire:
        ear = await wire.open()
        for chunk in chunks:
            await wire.say(chunk)
        assert await ear.hear(sum(map(len, chunks))) == b"".join(chunks)


@on_loop
async def test_a_large_send_waits_for_a_slow_reader_and_arrives_whole(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        large = os.urandom(wire.flood)
        await wire.open()
        wire.deafen()
        sending = asyncio.ensure_future(wire.transport.send(large))
        done, _ = await asyncio.wait([sending], timeout=0.05)
        assert bool(done) is not wire.presses_back
        wire.listen()
        await sending
        assert await wire.far.hear(wire.flood) == large


@on_loop
async def test_concurrent_sends_keep_their_order_and_their_frames_whole(make: Callable[[], Wire]) -> None:
    frames = [bytes([number]) * 3000 for number in range(50)]
    async with make() as wire:
        await wire.open()
        await asyncio.gather(*(wire.transport.send(frame) for frame in frames))
        assert await wire.far.hear(150_000) == b"".join(frames)


@on_loop
async def test_a_cancelled_send_still_goes_out_whole(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        large = os.urandom(wire.flood)
        await wire.open()
        wire.deafen()
        sending = asyncio.ensure_future(wire.transport.send(large))
        await asyncio.sleep(0)
        assert sending.cancel() is wire.presses_back
        await asyncio.wait([sending])
        wire.listen()
        await wire.transport.send(FRAME)
        assert await wire.far.hear(wire.flood + len(FRAME)) == large + FRAME


@on_loop
async def test_an_empty_send_waits_until_what_was_sent_before_has_left(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        await wire.open()
        wire.deafen()
        cancelled = asyncio.ensure_future(wire.transport.send(bytes(wire.flood)))
        await asyncio.sleep(0)
        cancelled.cancel()
        left = asyncio.ensure_future(wire.transport.send(b""))
        done, _ = await asyncio.wait([left], timeout=0.05)
        assert bool(done) is not wire.presses_back
        wire.listen()
        await left
        await wire.transport.send(FRAME)
        assert await wire.far.hear(wire.flood + len(FRAME)) == bytes(wire.flood) + FRAME


@on_loop
async def test_an_empty_send_learns_that_the_far_end_vanished(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        await wire.open()
        if not wire.presses_back:
            pytest.skip("a send never waits here")
        wire.deafen()
        sending = asyncio.ensure_future(wire.transport.send(bytes(wire.flood)))
        await asyncio.sleep(0)
        left = asyncio.ensure_future(wire.transport.send(b""))
        await asyncio.sleep(0)
        await wire.vanish()
        results = await asyncio.gather(sending, left, return_exceptions=True)
        assert [type(result) for result in results] == [ConnectionLost] * 2


@on_loop
async def test_an_empty_send_sends_nothing(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        await wire.open()
        await wire.transport.send(b"")
        await wire.say(FRAME)
        await wire.ear.hear(len(FRAME))  # time enough for a transport that stumbles over nothing
        await wire.transport.send(FRAME)
        assert await wire.far.hear(len(FRAME)) == FRAME


@on_loop
async def test_a_far_end_that_vanishes_is_told_once_and_then_nothing_can_be_sent(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        ear = await wire.open()
        await wire.vanish()
        assert isinstance(await ear.end(), ConnectionLost)
        with pytest.raises(ConnectionLost, match="lost"):
            await wire.transport.send(FRAME)
        await wire.transport.close()
        assert len(ear.losses) == 1


@on_loop
async def test_every_waiting_send_learns_that_the_far_end_vanished(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        ear = await wire.open()
        if not wire.presses_back:
            pytest.skip("a send never waits here")
        wire.deafen()
        sends = [asyncio.ensure_future(wire.transport.send(bytes(wire.flood))) for _ in range(3)]
        await asyncio.sleep(0)
        await wire.vanish()
        results = await asyncio.gather(*sends, return_exceptions=True)
        assert [type(result) for result in results] == [ConnectionLost] * 3
        assert all(isinstance(result, ConnectionLost) and result.__cause__ for result in results)
        assert [type(error) for error in ear.losses] == [ConnectionLost]


@on_loop
async def test_a_system_that_takes_no_byte_loses_the_connection(
    make: Callable[[], Wire], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lifecycle, "STALL_LIMIT", 0.2)
    monkeypatch.setattr(lifecycle, "_STALL_STEP", 0.02)
    async with make() as wire:
        ear = await wire.open()
        if not wire.presses_back:
            pytest.skip("memory takes every byte")
        wire.deafen()
        start = asyncio.get_running_loop().time()
        with pytest.raises(ConnectionLost, match="taken no byte"):
            await wire.transport.send(bytes(wire.flood))
        assert asyncio.get_running_loop().time() - start >= 0.2
        assert isinstance(await ear.end(), ConnectionLost)


@on_loop
async def test_a_slow_reader_is_no_stall(make: Callable[[], Wire], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lifecycle, "STALL_LIMIT", 0.5)  # for a thread of the far end that gets no processor
    monkeypatch.setattr(lifecycle, "_STALL_STEP", 0.02)
    async with make() as wire:
        ear = await wire.open()
        if not wire.presses_back:
            pytest.skip("memory takes every byte")
        wire.deafen()
        sending = asyncio.ensure_future(wire.transport.send(bytes(wire.flood)))
        for _ in range(12):  # a bit every 0.06 s: in all longer than the limit
            await asyncio.wait([sending], timeout=0.06)
            wire.listen()
            await wire.far.hear(len(wire.far.heard) + wire.flood // 20)
            wire.deafen()
        assert not ear.losses
        wire.listen()
        await sending
        assert len(await wire.far.hear(wire.flood)) == wire.flood


@on_loop
async def test_close_tells_once_and_may_be_called_again(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        ear = await wire.open()
        await asyncio.gather(wire.transport.close(), wire.transport.close())
        await wire.transport.close()
        assert ear.losses == [None]
        with pytest.raises(ConnectionLost, match="closed"):
            await wire.transport.send(FRAME)


@on_loop
async def test_what_was_sent_before_the_close_arrives_however_late_it_is_read(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        await wire.open()
        if not wire.is_buffered:
            pytest.skip("what was sent is with the board already")
        wire.deafen()
        await wire.transport.send(FRAME)
        await wire.transport.close()
        wire.listen()
        assert await wire.far.hear(len(FRAME)) == FRAME


@on_loop
async def test_close_does_not_wait_for_who_does_not_read(
    make: Callable[[], Wire], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert max(stream._DRAIN_LIMIT, threaded._DRAIN_LIMIT + threaded._END_LIMIT) < 1
    monkeypatch.setattr(stream, "_DRAIN_LIMIT", 0.05)
    monkeypatch.setattr(threaded, "_DRAIN_LIMIT", 0.05)
    async with make() as wire:
        ear = await wire.open()
        wire.deafen()
        sending = asyncio.ensure_future(wire.transport.send(bytes(wire.flood)))
        await asyncio.sleep(0)
        await wire.transport.close()
        assert ear.losses == [None]
        (result,) = await asyncio.gather(sending, return_exceptions=True)
        assert isinstance(result, ConnectionLost) is wire.presses_back


@on_loop
async def test_a_cancelled_close_still_frees_the_port(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        ear = await wire.open()
        closing = asyncio.ensure_future(wire.transport.close())
        await asyncio.sleep(0)
        closing.cancel()
        await asyncio.wait([closing])
        await ear.end()
        assert ear.losses == [None]


@on_loop
async def test_nothing_is_left_after_many_connections(make: Callable[[], Wire]) -> None:
    async def connect() -> None:
        async with make() as wire:
            ear = await wire.open()
            await wire.say(FRAME)
            await wire.transport.send(FRAME)
            assert await ear.hear(len(FRAME)) == FRAME

    await connect()
    files, threads = _open_files(), threading.enumerate()
    for _ in range(CONNECTIONS):
        await connect()
    for thread in threading.enumerate():
        if thread not in threads and not thread.name.startswith("asyncio_"):  # those of the loop's own pool stay
            thread.join(LIMIT)
            assert not thread.is_alive()
    assert _open_files() <= files  # only now: a serial port that takes long to close is closed by such a thread
    assert asyncio.all_tasks() == {asyncio.current_task()}


@on_loop
async def test_the_receiver_is_called_on_the_loop_only(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        ear = await wire.open()
        await wire.say(FRAME)
        await ear.hear(len(FRAME))
        await wire.vanish()
        await ear.end()
        assert ear.threads == {threading.get_ident()}


@on_loop
async def test_a_receiver_that_fails_ends_the_connection(
    make: Callable[[], Wire], monkeypatch: pytest.MonkeyPatch
) -> None:
    async with make() as wire:
        ear = await wire.open()
        monkeypatch.setattr(ear, "data", _raise_bug)
        await wire.say(FRAME)
        error = await ear.end()
        assert isinstance(error, ConnectionLost)
        assert "a bug in the receiver" in str(error)
        with pytest.raises(ConnectionLost):
            await wire.transport.send(FRAME)


@on_loop
async def test_it_is_opened_once(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        ear = await wire.open()
        with pytest.raises(OpenError, match="make another"):
            await wire.transport.open(Ear())
        await wire.say(FRAME)
        assert await ear.hear(len(FRAME)) == FRAME
        await wire.transport.close()
        with pytest.raises(OpenError, match="make another"):
            await wire.transport.open(Ear())


@on_loop
async def test_before_the_opening_nothing_can_be_sent(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        with pytest.raises(ConnectionLost, match="not open"):
            await wire.transport.send(FRAME)
        await wire.transport.close()
        assert wire.ear.losses == []
        with pytest.raises(OpenError):
            await wire.open()


@on_loop
async def test_it_is_a_transport_and_has_an_address(make: Callable[[], Wire]) -> None:
    async with make() as wire:
        assert isinstance(wire.transport, Transport)
        assert wire.transport.url


@on_loop
async def test_the_virtual_board_keeps_the_rules_of_opening_and_closing() -> None:
    transport, ear = create("virtual://?servos=1"), Ear()
    with pytest.raises(ConnectionLost):
        await transport.send(FRAME)
    await transport.open(ear)
    with pytest.raises(OpenError):
        await transport.open(Ear())
    await transport.close()
    await transport.close()
    assert ear.losses == [None]
    with pytest.raises(ConnectionLost):
        await transport.send(FRAME)


def _open_files() -> int:
    gc.collect()  # what earlier tests have left behind
    return len(list(Path("/dev/fd").iterdir()))
