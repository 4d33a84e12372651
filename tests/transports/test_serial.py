from __future__ import annotations

import asyncio
import errno
import os
import subprocess
import sys
import termios
import threading
import tty
from collections.abc import Callable
from pathlib import Path

import pytest
import serial  # type: ignore[import-untyped]
from serial.tools import list_ports  # type: ignore[import-untyped]

from servolink.errors import ConnectionLost, OpenError
from servolink.transports import lifecycle, stream
from servolink.transports import serial as serial_transport
from servolink.transports.registry import create
from servolink.transports.serial import SerialTransport
from tests import processes
from tests.transports.rights import not_root
from tests.transports.wires import FLOOD, LIMIT, Ear, PtyWire, on_loop

HOLD = """
import fcntl, os, sys
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
fcntl.flock(port, fcntl.LOCK_EX)
print("held", flush=True)
sys.stdin.read()
"""


async def _open_error(url: str) -> str:
    with pytest.raises(OpenError) as caught:
        await create(url).open(Ear())
    return str(caught.value)


@on_loop
async def test_a_missing_device_is_told_with_those_that_are_there() -> None:
    text = await _open_error("/dev/servolink-nowhere")
    assert "there is no /dev/servolink-nowhere; plug the board in" in text
    assert "port" in text.rsplit("; ", 1)[1]


@on_loop
async def test_a_missing_device_is_told_though_ports_cannot_be_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    def comports() -> list[object]:
        raise TypeError("int() can't convert non-string with explicit base")  # as when one vanishes meanwhile

    monkeypatch.setattr(list_ports, "comports", comports)
    assert "there is no /dev/servolink-nowhere" in await _open_error("/dev/servolink-nowhere")


@on_loop
async def test_what_is_no_terminal_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for path in (tmp_path, tmp_path / "file"):
        assert "is not a serial port" in await _open_error(str(path))
    assert "there is no" in await _open_error(f"serial://{tmp_path}/file%F0%90%80")


@on_loop
async def test_missing_permission_is_told_with_the_cure(tmp_path: Path) -> None:
    device = tmp_path / "ttyACM0"
    device.touch(mode=0)
    with not_root():
        text = await _open_error(str(device))
    assert "no permission" in text
    assert "usermod -aG dialout" in text
    assert "uucp" in text
    assert "log out and in" in text


@on_loop
async def test_a_port_that_another_program_holds_is_told() -> None:
    async with PtyWire() as wire:
        holder = processes.start([sys.executable, "-c", HOLD, wire.path], stdin=subprocess.PIPE)
        assert holder.stdout is not None
        assert await asyncio.to_thread(holder.stdout.readline) == "held\n"
        assert "is in use; close the program that has it" in await _open_error(wire.path)
        processes.finish(holder)
        await wire.open()


@on_loop
async def test_a_port_of_ours_is_not_opened_twice() -> None:
    async with PtyWire() as wire:
        await wire.open()
        assert "is in use" in await _open_error(wire.path)
        await wire.transport.close()
        again = create(wire.path)
        await again.open(Ear())
        await again.close()


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (serial.SerialException("could not open port 'COM3': PermissionError(13, 'Access is denied.')"), "is in use"),
        (serial.SerialException("could not open port 'COM3': FileNotFoundError(2, 'not found')"), "there is no"),
        (serial.SerialException(errno.EBUSY, "busy"), "is in use"),
        (ValueError("Invalid baud rate: 3"), "cannot open COM3: Invalid baud rate: 3"),
        (termios.error(errno.EIO, "Input/output error"), "cannot open COM3"),
    ],
)
@on_loop
async def test_other_failures_are_told(error: Exception, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: serial.Serial) -> None:
        raise error

    monkeypatch.setattr(serial.Serial, "open", fail)
    assert text in await _open_error("COM3")


@on_loop
async def test_the_line_is_raw_and_has_its_speed() -> None:
    async with PtyWire() as wire:
        transport = create(f"{wire.path}?baudrate=57600")
        await transport.open(Ear())
        input_flags, output_flags, _, local_flags, input_speed, output_speed, _ = termios.tcgetattr(wire.slave)
        await transport.close()
        assert (input_speed, output_speed) == (termios.B57600, termios.B57600)
        assert not input_flags & (termios.ICRNL | termios.IXON)
        assert not output_flags & termios.OPOST
        assert not local_flags & (termios.ECHO | termios.ICANON | termios.ISIG)


@pytest.mark.parametrize(
    ("options", "levels"), [("", (False, False)), ("?dtr=1", (True, False)), ("?dtr=1&rts=1", (True, True))]
)
@on_loop
async def test_the_control_lines_are_set_on_purpose(
    options: str, levels: tuple[bool, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A pseudo-terminal has no such lines: what the operating system would be asked is all there is to see.
    seen: list[bool] = []
    monkeypatch.setattr(serial.Serial, "_update_dtr_state", lambda port: seen.append(port.dtr))
    monkeypatch.setattr(serial.Serial, "_update_rts_state", lambda port: seen.append(port.rts))
    async with PtyWire() as wire:
        transport = create(wire.path + options)
        await transport.open(Ear())
        await transport.close()
    assert tuple(seen) == levels


@on_loop
async def test_what_came_before_the_opening_is_dropped() -> None:
    async with PtyWire() as wire:
        tty.setraw(wire.slave)
        await wire.say(b"stale")
        ear = await wire.open()
        await wire.say(b"fresh")
        assert await ear.hear(5) == b"fresh"


def opening_when_told(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """Make every port open only when the event is set."""
    go, really_open = threading.Event(), serial.Serial.open

    def open_when_told(port: serial.Serial) -> None:
        assert go.wait(LIMIT)
        really_open(port)

    monkeypatch.setattr(serial.Serial, "open", open_when_told)
    return go


@on_loop
async def test_who_is_cancelled_while_opening_may_open_again_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    go = opening_when_told(monkeypatch)
    async with PtyWire() as wire:
        opening = asyncio.ensure_future(wire.open())
        await asyncio.sleep(0)
        opening.cancel()
        for _ in range(5):
            await asyncio.sleep(0)
        assert not opening.done()  # before, the port may be in use, by us
        go.set()
        await asyncio.wait([opening])
        assert opening.cancelled()
        again = create(wire.path)
        await again.open(Ear())
        await again.close()


@on_loop
async def test_an_opening_that_is_cancelled_leaves_nothing_open(monkeypatch: pytest.MonkeyPatch) -> None:
    go, opened, really_open = threading.Event(), threading.Event(), serial.Serial.open

    def open_slowly(port: serial.Serial) -> None:
        assert go.wait(LIMIT)
        really_open(port)
        opened.set()

    monkeypatch.setattr(serial.Serial, "open", open_slowly)
    monkeypatch.setattr(serial_transport, "_OPENING_LIMIT", 0.001)
    async with PtyWire() as wire:
        opening = asyncio.ensure_future(wire.open())
        await asyncio.sleep(0)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening
        go.set()
        await asyncio.to_thread(opened.wait)
        monkeypatch.undo()
        while True:  # the descriptor is closed in a later turn of the loop
            again = create(wire.path)
            try:
                await again.open(Ear())
            except OpenError as error:
                assert "is in use" in str(error)  # noqa: PT017 - it is awaited, not tested
            else:
                break
        await again.close()
        assert wire.ear.losses == []


@on_loop
async def test_a_cancelled_opening_that_fails_later_is_forgotten(
    monkeypatch: pytest.MonkeyPatch, warnings_logged: Callable[[], list[str]]
) -> None:
    go, failed = threading.Event(), threading.Event()

    def fail_slowly(_: serial.Serial) -> None:
        assert go.wait(LIMIT)
        failed.set()
        raise serial.SerialException(errno.ENOENT, "gone")

    monkeypatch.setattr(serial.Serial, "open", fail_slowly)
    monkeypatch.setattr(serial_transport, "_OPENING_LIMIT", 0.001)
    opening = asyncio.ensure_future(create("COM3").open(Ear()))
    await asyncio.sleep(0)
    opening.cancel()
    await asyncio.wait([opening])
    go.set()
    await asyncio.to_thread(failed.wait)
    await asyncio.get_running_loop().shutdown_default_executor()
    del opening
    assert warnings_logged() == []


@on_loop
async def test_an_opening_does_not_hold_up_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    go = opening_when_told(monkeypatch)
    async with PtyWire() as wire:
        opening = asyncio.ensure_future(wire.open())
        await asyncio.sleep(0)
        go.set()  # only a loop that still turns comes here
        assert await opening is wire.ear


@on_loop
async def test_a_port_closed_while_it_opens_is_closed_after_all(monkeypatch: pytest.MonkeyPatch) -> None:
    go = opening_when_told(monkeypatch)
    async with PtyWire() as wire:
        opening = asyncio.ensure_future(wire.open())
        await asyncio.sleep(0)
        await wire.transport.close()
        go.set()
        with pytest.raises(OpenError, match="closed while being opened"):
            await opening
        again = create(wire.path)
        await again.open(Ear())
        await again.close()


@on_loop
async def test_a_drained_port_no_longer_waits_for_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lifecycle, "_STALL_STEP", 0.001)
    async with PtyWire() as wire:
        await wire.open()
        await wire.transport.send(bytes(FLOOD))
        assert isinstance(wire.transport, SerialTransport)
        while wire.transport._watch.running:  # it ends: an unneeded timer costs power
            await asyncio.sleep(0)
        port = next(fd for fd in _descriptors() if fd != wire.slave and _is(fd, wire.path))
        assert asyncio.get_running_loop().remove_writer(port) is False


@on_loop
async def test_a_frame_is_with_the_system_before_the_next_turn_of_the_loop() -> None:
    async with PtyWire() as wire:
        await wire.open()
        with pytest.raises(StopIteration):
            wire.transport.send(b"now").send(None)
        assert await wire.far.hear(3) == b"now"


@on_loop
async def test_bytes_that_are_not_there_after_all_are_no_end() -> None:
    async with PtyWire() as wire:
        ear = await wire.open()
        assert isinstance(wire.transport, SerialTransport)
        assert wire.transport._port.read(1024) == b""  # as when another program has just taken them
        await wire.say(b"more")
        assert await ear.hear(4) == b"more"


@on_loop
async def test_a_read_that_fails_is_the_end_and_no_noise(
    monkeypatch: pytest.MonkeyPatch, warnings_logged: Callable[[], list[str]]
) -> None:
    def fail(*_: object) -> bytes:
        raise OSError(errno.EIO, "Input/output error")

    async with PtyWire() as wire:
        ear = await wire.open()
        wire.deafen()
        with monkeypatch.context() as patch:
            patch.setattr(os, "read", fail)
            await wire.say(b"x")
            error = await ear.end()
        assert isinstance(error, ConnectionLost)
        assert "unplugged" in str(error)
        assert warnings_logged() == []


@on_loop
async def test_a_write_that_fails_is_the_end_and_no_noise(
    monkeypatch: pytest.MonkeyPatch, warnings_logged: Callable[[], list[str]]
) -> None:
    def fail(*_: object) -> int:
        raise OSError(errno.EIO, "Input/output error")

    async with PtyWire() as wire:
        ear = await wire.open()
        monkeypatch.setattr(os, "write", fail)
        with pytest.raises(ConnectionLost, match="unplugged") as caught:
            await wire.transport.send(b"x")
        assert caught.value.__cause__ is not None
        assert "Errno 5" in str(caught.value.__cause__.__cause__)
        assert isinstance(await ear.end(), ConnectionLost)
        assert warnings_logged() == []


@on_loop
async def test_a_port_that_can_no_longer_be_asked_is_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> int:
        raise serial.SerialException("ClearCommError failed")

    async with PtyWire() as wire:
        ear = await wire.open()
        assert isinstance(wire.transport, SerialTransport)
        monkeypatch.setattr(serial.Serial, "in_waiting", property(fail))
        assert wire.transport._port.in_waiting == 0  # on Windows, this is how pyserial-asyncio looks for bytes
        assert isinstance(await ear.end(), ConnectionLost)


@on_loop
async def test_closing_drops_what_the_device_does_not_take(monkeypatch: pytest.MonkeyPatch) -> None:
    dropped: list[bool] = []
    monkeypatch.setattr(serial.Serial, "reset_output_buffer", lambda _: dropped.append(True))
    monkeypatch.setattr(serial.Serial, "out_waiting", 7, raising=False)
    monkeypatch.setattr(stream, "_DRAIN_LIMIT", 0.05)
    async with PtyWire() as wire:
        ear = await wire.open()
        start = asyncio.get_running_loop().time()
        await wire.transport.close()
        assert asyncio.get_running_loop().time() - start >= 0.05
        assert dropped == [True]
        assert ear.losses == [None]


@on_loop
async def test_a_device_that_vanishes_is_closed_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> int:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(stream, "_DRAIN_LIMIT", LIMIT)  # what the test does not wait for
    async with PtyWire() as wire:
        ear = await wire.open()
        monkeypatch.setattr(serial.Serial, "out_waiting", property(fail))
        await wire.transport.close()
        assert ear.losses == [None]


@on_loop
async def test_a_lost_port_says_what_to_look_at() -> None:
    async with PtyWire() as wire:
        ear = await wire.open()
        await wire.vanish()
        error = await ear.end()
        assert isinstance(error, ConnectionLost)
        assert "is it unplugged or switched off?" in str(error)
        assert isinstance(error.__cause__, ConnectionResetError)


def _descriptors() -> list[int]:
    return [int(entry.name) for entry in Path("/dev/fd").iterdir()]


def _is(descriptor: int, path: str) -> bool:
    try:
        return os.ttyname(descriptor) == path
    except OSError:
        return False


def test_a_port_that_is_forgotten_does_not_keep_a_program_from_ending() -> None:
    program = """
import os
import servolink.transports.serial as kind
ours, theirs = os.openpty()
for forgotten in (False, True):
    port = kind._Port(os.ttyname(theirs))
    if not forgotten:
        port.close()
    globals()[f"port_{forgotten}"] = port
"""
    ended = processes.run([sys.executable, "-c", program])
    assert (ended.returncode, ended.stderr) == (0, "")
