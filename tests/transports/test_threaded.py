"""A device's threads when the device, the loop or the program misbehaves, on HID and on USB."""

from __future__ import annotations

import asyncio
import gc
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from servolink.errors import ConnectionLost, OpenError, TransportUnavailable
from servolink.transports import threaded
from servolink.transports.device_info import PortIdentity
from servolink.transports.hid import HidDevice, OpenHid
from servolink.transports.threaded import DeviceTransport, OpenDevice
from servolink.transports.usb import BulkDevice, OpenUsb
from tests import processes
from tests.processes import until
from tests.transports.fake_hid import FakeHid
from tests.transports.fake_usb import FakeUsb
from tests.transports.wires import LIMIT, Ear, on_loop

URL = "test://device"
_MANY = 100  # enough to see a leak


class Board:
    """A fake of either kind."""

    def __init__(self, fake: FakeHid | FakeUsb) -> None:
        self.fake = fake
        self.heard = bytearray()
        fake.heard = self._hear

    def transport(self) -> DeviceTransport:
        if isinstance(self.fake, FakeHid):
            return DeviceTransport(URL, HidDevice(self.fake, URL, PortIdentity()))
        return DeviceTransport(URL, BulkDevice(URL, PortIdentity(), library=self.fake))

    def bring(self, chunk: bytes) -> None:
        self.fake.bring(chunk)

    def is_empty(self) -> bool:
        return not (self.fake.reports if isinstance(self.fake, FakeHid) else self.fake.packets)

    def is_closed(self) -> bool:
        return not self.fake.handles and not _device_threads()

    def _hear(self, data: bytes) -> None:
        self.heard += data[1:] if isinstance(self.fake, FakeHid) else data


@pytest.fixture(params=["hid", "usb"])
def board(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Board]:
    """Make a board, and see to it that no thread is left and that nothing forbidden was done."""
    made = Board(FakeHid(tmp_path / "hidraw0") if request.param == "hid" else FakeUsb())
    yield made
    made.fake.unplug()
    until(made.is_closed)
    assert made.fake.misuse == []


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait longer for a device that is not stuck: a busy machine may need longer than a user would wait."""
    assert threaded._DRAIN_LIMIT + threaded._END_LIMIT < 1
    monkeypatch.setattr(threaded, "_END_LIMIT", LIMIT)


@pytest.fixture
def hasty(_patient: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait less for a device that is stuck."""
    monkeypatch.setattr(threaded, "_DRAIN_LIMIT", 0.05)
    monkeypatch.setattr(threaded, "_END_LIMIT", 0.05)


def _device_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name.startswith("servolink device")]


async def turn_until(condition: Callable[[], bool]) -> None:
    """Turn the loop until other threads, to which it leaves the processor, have made `condition` true."""
    while not condition():
        await asyncio.sleep(0.001)


async def opened(board: Board) -> tuple[DeviceTransport, Ear]:
    transport, ear = board.transport(), Ear()
    await transport.open(ear)
    return transport, ear


def _block(feeder: threading.Thread) -> None:
    feeder.join(LIMIT)


def _spin(feeder: threading.Thread) -> None:
    while feeder.is_alive():
        pass


@pytest.mark.parametrize("stall", [_block, _spin])
@on_loop
async def test_the_longest_list_is_read_while_the_loop_stands_still(
    board: Board, stall: Callable[[threading.Thread], None]
) -> None:
    reports = [bytes([number]) * 64 for number in range(144)]

    def feed() -> None:
        for start in range(0, 144, 48):  # the system keeps 63 for a program that does not read
            for report in reports[start : start + 48]:
                board.bring(report)
            until(board.is_empty)

    transport, ear = await opened(board)
    chunks: list[bytes] = []
    ear.data = chunks.append  # type: ignore[method-assign]
    feeder = threading.Thread(target=feed)
    feeder.start()
    stall(feeder)
    await turn_until(lambda: sum(map(len, chunks)) == 144 * 64)
    await transport.close()
    assert b"".join(chunks) == b"".join(reports)
    assert len(chunks) <= 2  # as one, but for a report that was still in the reader's hand


@on_loop
async def test_the_loop_is_woken_once_for_what_comes_while_it_is_busy(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    transport, ear = await opened(board)
    loop, calls = asyncio.get_running_loop(), list[object]()
    really_call = loop.call_soon_threadsafe

    def call(callback: Callable[..., object], *arguments: object, **options: object) -> asyncio.Handle:
        calls.append(callback)
        return really_call(callback, *arguments)

    monkeypatch.setattr(loop, "call_soon_threadsafe", call)
    for number in range(40):
        board.bring(bytes([number]))
        until(board.is_empty)
    assert await ear.hear(40) == bytes(range(40))
    assert len(calls) <= 2
    await transport.close()


@on_loop
async def test_a_write_does_not_wait_for_a_read(board: Board) -> None:
    transport, _ = await opened(board)
    board.fake.set(read_stuck=True)
    until(lambda: board.fake.read_is_stuck)
    await transport.send(b"hello")
    assert bytes(board.heard).startswith(b"hello")
    board.fake.set(read_stuck=False)
    await transport.close()


@pytest.mark.usefixtures("hasty")
@on_loop
async def test_a_stuck_read_does_not_hold_up_the_close(board: Board) -> None:
    transport, ear = await opened(board)
    board.fake.set(read_stuck=True)
    until(lambda: board.fake.read_is_stuck)
    await transport.close()
    assert ear.losses == [None]
    assert len(board.fake.handles) == 1  # as closing it during the call is what must not be done
    board.fake.set(read_stuck=False)
    await turn_until(board.is_closed)
    assert ear.heard == b""
    assert ear.losses == [None]


@pytest.mark.usefixtures("hasty")
@on_loop
async def test_a_write_that_is_stuck_for_ever_does_not_hold_up_the_close(board: Board) -> None:
    transport, ear = await opened(board)
    board.fake.set(**{"deaf" if isinstance(board.fake, FakeHid) else "write_stuck": True})
    sending = asyncio.ensure_future(transport.send(b"hello"))
    await turn_until(lambda: board.fake.write_is_stuck)
    await transport.close()
    with pytest.raises(ConnectionLost, match="closed"):
        await sending
    assert ear.losses == [None]
    assert len(board.fake.handles) == 1
    board.fake.unplug()
    await turn_until(board.is_closed)


@on_loop
async def test_a_loss_is_told_before_a_stuck_write_ends(board: Board) -> None:
    transport, ear = await opened(board)
    board.fake.set(**{"deaf" if isinstance(board.fake, FakeHid) else "write_stuck": True})
    sending = asyncio.ensure_future(transport.send(b"hello"))
    await turn_until(lambda: board.fake.write_is_stuck)
    board.fake.set(there=False)  # what the read sees at once
    assert isinstance(await ear.end(), ConnectionLost)
    with pytest.raises(ConnectionLost, match="unplugged"):
        await sending
    assert len(board.fake.handles) == 1
    board.fake.unplug()
    await transport.close()
    assert board.fake.handles == set()


@on_loop
async def test_what_came_before_the_loss_is_delivered_before_it(board: Board) -> None:
    transport, ear = await opened(board)
    board.bring(b"last words")
    until(board.is_empty)
    board.fake.unplug()
    until(board.is_closed)
    assert isinstance(await ear.end(), ConnectionLost)
    assert ear.heard == b"last words"
    await transport.close()


@pytest.mark.parametrize("speaks", [True, False])
def test_a_loop_that_is_closed_with_the_device_open_lets_it_go(board: Board, speaks: bool) -> None:
    asyncio.run(_just_open(board))
    if speaks:
        board.bring(b"anyone?")
    until(board.is_closed)


async def _just_open(board: Board) -> None:
    await board.transport().open(Ear())


@on_loop
async def test_many_connections_leave_nothing(board: Board) -> None:
    board.fake.haste = 1000.0
    threads, files = threading.active_count(), _open_files()
    for number in range(_MANY):
        transport, _ = await opened(board)
        if number % 10 == 0:
            await transport.send(b"hello")
        await transport.close()
    until(board.is_closed)
    until(lambda: threading.active_count() <= threads)
    assert _open_files() <= files


@on_loop
async def test_many_losses_leave_nothing(board: Board) -> None:
    board.fake.haste = 1000.0
    threads, files = threading.active_count(), _open_files()
    for _ in range(_MANY):
        board.fake.set(there=True)
        transport, ear = await opened(board)
        board.fake.unplug()
        assert isinstance(await ear.end(), ConnectionLost)
        await transport.close()
        assert board.fake.handles == set()
    until(board.is_closed)
    until(lambda: threading.active_count() <= threads)
    assert _open_files() <= files


def _open_files() -> int:
    gc.collect()  # what earlier tests have left behind
    return len(list(Path("/dev/fd").iterdir()))


@pytest.mark.usefixtures("hasty")
@on_loop
async def test_a_cancelled_opening_leaves_nothing_open(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    go, opened_after_all = threading.Event(), threading.Event()
    transport = board.transport()
    really_open = transport._device.open

    def open_when_told() -> OpenDevice:
        assert go.wait(LIMIT)
        device = really_open()
        opened_after_all.set()
        return device

    monkeypatch.setattr(transport._device, "open", open_when_told)
    ear = Ear()
    opening = asyncio.ensure_future(transport.open(ear))
    await asyncio.sleep(0)
    opening.cancel()
    await asyncio.wait([opening])
    assert opening.cancelled()
    go.set()
    await turn_until(opened_after_all.is_set)
    await turn_until(board.is_closed)
    await transport.close()
    assert ear.losses == []


@on_loop
async def test_who_cancels_an_opening_is_told_when_the_device_is_free(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    go = threading.Event()
    transport = board.transport()
    really_open = transport._device.open

    def open_when_told() -> OpenDevice:
        assert go.wait(LIMIT)
        return really_open()

    monkeypatch.setattr(transport._device, "open", open_when_told)
    opening = asyncio.ensure_future(transport.open(Ear()))
    await asyncio.sleep(0)
    opening.cancel()
    await asyncio.sleep(0)
    go.set()
    await asyncio.wait([opening])
    assert opening.cancelled()
    assert not board.fake.handles  # its thread, which has said so, may take a moment more to end


@on_loop
async def test_a_device_that_fails_to_close_is_let_go(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    def close_and_fail(opened: OpenHid | OpenUsb) -> None:
        opened._undo.close()
        raise OSError("cannot close")

    monkeypatch.setattr(OpenHid, "close", close_and_fail)
    monkeypatch.setattr(OpenUsb, "close", close_and_fail)
    transport, ear = await opened(board)
    await transport.close()
    assert ear.losses == [None]
    assert board.fake.handles == set()


@on_loop
async def test_a_device_whose_writer_cannot_start_is_closed_again(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    really_start = threading.Thread.start

    def start(thread: threading.Thread) -> None:
        if thread.name == "servolink device writer":
            raise RuntimeError("can't start new thread at interpreter shutdown")
        really_start(thread)

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(OpenError, match="cannot open it: can't start new thread"):
        await opened(board)
    await turn_until(board.is_closed)


FORGETFUL = """
import asyncio, pathlib, sys
from servolink.transports.threaded import DeviceTransport
from servolink.transports.hid import HidDevice
from servolink.transports.device_info import PortIdentity
from tests.transports.fake_hid import FakeHandle, FakeHid
from tests.processes import until
from tests.transports.wires import Ear

FakeHandle.close = lambda handle: print("closed", flush=True)

async def main():
    await DeviceTransport("hid://", HidDevice(FakeHid(pathlib.Path(sys.argv[1])), "hid://", PortIdentity())).open(Ear())

loop = asyncio.new_event_loop()
loop.run_until_complete(main())
"""
"""Ends with the loop as with the device: neither is closed."""


def test_the_end_of_the_program_closes_what_is_open(tmp_path: Path) -> None:
    command = [sys.executable, "-c", FORGETFUL, str(tmp_path / "hidraw0")]
    done = processes.run(command, check=True, cwd=Path(__file__).parents[2])
    assert done.stdout == "closed\n"


class Slow:
    """A device that opens when the test lets it, and then not at all if there is a failure."""

    def __init__(self, failure: Exception) -> None:
        self.go = threading.Event()
        self.failure = failure

    def open(self) -> OpenDevice:
        assert self.go.wait(LIMIT)
        raise self.failure


@pytest.mark.parametrize("failure", [OpenError("no"), TransportUnavailable("no")])
@on_loop
async def test_a_failure_to_open_is_told_as_it_is(failure: Exception) -> None:
    device = Slow(failure)
    device.go.set()
    with pytest.raises(type(failure), match=r"^no$"):
        await DeviceTransport(URL, device).open(Ear())


@on_loop
async def test_any_other_failure_to_open_is_an_open_error() -> None:
    device = Slow(RuntimeError("a bug\x1b"))
    device.go.set()
    with pytest.raises(OpenError, match=r"test://device: cannot open it: a bug\\x1b"):
        await DeviceTransport(URL, device).open(Ear())


@pytest.mark.usefixtures("hasty")
@on_loop
async def test_an_opening_that_is_stuck_does_not_hold_up_the_close() -> None:
    device = Slow(OSError("late"))
    transport = DeviceTransport(URL, device)
    opening = asyncio.ensure_future(transport.open(Ear()))
    await asyncio.sleep(0)
    await transport.close()
    with pytest.raises(OpenError, match="closed while being opened"):
        await opening
    device.go.set()
    await turn_until(lambda: not any(thread.name.startswith("servolink device") for thread in threading.enumerate()))
