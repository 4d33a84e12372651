from __future__ import annotations

import errno
import sys
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from servolink.errors import OpenError, TransportUnavailable
from servolink.transports import usb_devices
from servolink.transports.device_info import DeviceInfo, PortIdentity
from servolink.transports.registry import create
from tests.transports.fake_usb import FakeUsb, bulk_pair, endpoint, failure, plugged_in
from tests.transports.rights import not_root
from tests.transports.wires import Ear, on_loop

SERIAL_URL = "usb://1209:0001/SN%201"


@pytest.fixture
def board(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[FakeUsb]:
    yield from plugged_in(monkeypatch, tmp_path)


def describe(tmp_path: Path, driver: str = "", **texts: str) -> None:
    """Describe the board as Linux does."""
    interface = tmp_path / "sys" / "1-1.2" / "1-1.2:1.0"
    interface.mkdir(parents=True)
    for name, text in texts.items():
        (interface.parent / name).write_text(text + "\n")
    if driver:
        (tmp_path / "drivers" / driver).mkdir(parents=True)
        (interface / "driver").symlink_to(tmp_path / "drivers" / driver)


async def _open_error(url: str) -> str:
    with pytest.raises(OpenError) as caught:
        await create(url).open(Ear())
    return str(caught.value)


@on_loop
async def test_the_kernels_driver_gets_its_interface_back(board: FakeUsb) -> None:
    board.driver = True
    transport = create("usb://1209:0001")
    await transport.open(Ear())
    assert board.driver is False
    assert board.claimed == {0}
    await transport.close()
    assert board.driver is True


@on_loop
async def test_the_kernels_driver_gets_it_back_when_the_opening_fails(board: FakeUsb) -> None:
    board.driver = True
    board.claim_failure = failure(errno.EBUSY)
    assert "the device is in use; close the program that has it" in await _open_error("usb://1209:0001")
    assert board.driver is True


@pytest.mark.parametrize(("configured", "calls"), [(1, []), (0, ["set_configuration 1"]), (2, ["set_configuration 1"])])
@on_loop
async def test_a_configuration_is_set_only_if_it_is_another(board: FakeUsb, configured: int, calls: list[str]) -> None:
    board.configuration = configured
    transport = create("usb://")
    await transport.open(Ear())
    await transport.close()
    assert board.calls == calls


@on_loop
async def test_an_alternate_setting_is_set_if_it_has_the_endpoints(board: FakeUsb) -> None:
    board.interfaces = [bulk_pair(endpoints=[]), bulk_pair(bAlternateSetting=1), bulk_pair(bAlternateSetting=2)]
    transport = create("usb://")
    await transport.open(Ear())
    await transport.close()
    assert board.calls == ["set_interface_altsetting 0 1"]


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (
            failure(errno.EACCES),
            "no permission for the USB device; `servolink doctor --print-udev` prints the udev rule",
        ),
        (failure(errno.ENODEV), "the device was unplugged just now; plug the board in again"),
        (failure(errno.EBUSY), "the device is in use; close the program that has it"),
        (failure(errno.ENOMEM, "Out of memory"), "cannot open it: [Errno 12] Out of memory; plug the board in again"),
        (NotImplementedError("no driver"), "install WinUSB for the device, with the program Zadig"),
    ],
)
@on_loop
async def test_a_failed_opening_says_what_to_do(board: FakeUsb, error: Exception, text: str, tmp_path: Path) -> None:
    describe(tmp_path)
    board.open_failure = error
    assert text in await _open_error("usb://")


@on_loop
async def test_an_interface_is_not_opened_twice(board: FakeUsb) -> None:
    first = create("usb://")
    await first.open(Ear())
    assert "the device is in use" in await _open_error("usb://")
    await first.close()


@on_loop
async def test_interface_and_endpoints_can_be_given(board: FakeUsb, monkeypatch: pytest.MonkeyPatch) -> None:
    second = bulk_pair(3, 0x82, 0x02)
    second.endpoints += [endpoint(0x83), endpoint(0x03)]
    board.interfaces = [bulk_pair(0), second]
    assert await _open_error("usb://") == (
        f"usb://: 2 devices can be the board; choose among: {SERIAL_URL}?interface=0, {SERIAL_URL}?interface=3"
    )
    assert "no such endpoints; it has 0x82, 0x02, 0x83, 0x03" in await _open_error("usb://?interface=3&in=0x84")
    transport, addresses = create("usb://?interface=3&in=0x83&out=3"), set[int]()
    really_look = board._look

    def look(address: int | None = None) -> None:
        addresses.update([address] if address else [])
        really_look(address)

    monkeypatch.setattr(board, "_look", look)
    await transport.open(Ear())
    assert board.claimed == {3}
    await transport.send(b"abc")
    await transport.close()
    assert addresses == {0x83, 0x03}


@pytest.mark.parametrize(
    "interface",
    [
        bulk_pair(bInterfaceClass=3),
        bulk_pair(endpoints=[endpoint(0x81), endpoint(0x01, kind=3)]),
        bulk_pair(endpoints=[endpoint(0x81), endpoint(0x82)]),
        bulk_pair(endpoints=[]),
    ],
)
@on_loop
async def test_other_interfaces_are_no_boards(board: FakeUsb, interface: Any) -> None:
    board.interfaces = [interface]
    assert usb_devices.candidates() == []
    assert "found no USB device 1209:0001" in await _open_error("usb://1209:0001")


@on_loop
async def test_a_missing_device_is_told_with_those_that_are_there(board: FakeUsb) -> None:
    assert await _open_error("usb://1209:0002?interface=1") == (
        "usb://1209:0002?interface=1: found no USB device 1209:0002 with a pair of bulk endpoints on interface 1; "
        f"plug the board in and switch it on; these are here: {SERIAL_URL}"
    )
    board.count = 2
    assert f"2 devices cannot be told apart ({SERIAL_URL}); unplug the others" in await _open_error("usb://1209:0001")


def test_candidates_are_listed_without_being_opened_where_linux_describes_them(board: FakeUsb, tmp_path: Path) -> None:
    board.open_failure = failure(errno.EACCES)
    describe(tmp_path, serial="AB/7", product="Servo board")
    assert usb_devices.candidates() == [
        DeviceInfo("usb://1209:0001/AB%2F7", "Servo board", PortIdentity(0x1209, 1, "AB/7", 0))
    ]


def test_elsewhere_they_are_opened_to_read_their_names(board: FakeUsb) -> None:
    assert usb_devices.candidates() == [DeviceInfo(SERIAL_URL, "Servo board", PortIdentity(0x1209, 1, "SN 1", 0))]
    board.open_failure = failure(errno.EACCES)
    assert usb_devices.candidates() == [DeviceInfo("usb://1209:0001", "", PortIdentity(0x1209, 1, "", 0))]


def test_an_interface_with_a_driver_is_somebody_elses(board: FakeUsb, tmp_path: Path) -> None:
    describe(tmp_path, driver="ftdi_sio")
    assert usb_devices.candidates() == []


def test_an_interface_that_a_program_has_is_listed_with_the_reason(board: FakeUsb, tmp_path: Path) -> None:
    describe(tmp_path, driver="usbfs")
    (candidate,) = usb_devices.candidates()
    assert candidate.problem == "the interface is in use by another program; close that program"


def test_a_forbidden_device_is_listed_with_the_reason(board: FakeUsb, monkeypatch: pytest.MonkeyPatch) -> None:
    with TemporaryDirectory() as folder:  # one that others may look into
        node = Path(folder) / "dev" / "001" / "007"
        node.parent.mkdir(parents=True)
        node.touch(mode=0o400)
        Path(folder).chmod(0o755)
        monkeypatch.setattr(usb_devices, "_DESCRIPTIONS", Path(folder) / "sys")
        monkeypatch.setattr(usb_devices, "_NODES", Path(folder) / "dev")
        with not_root():
            (candidate,) = usb_devices.candidates()
    assert candidate.problem.startswith(f"no permission for {node}; `servolink doctor --print-udev` prints the udev")


def test_a_device_that_vanishes_while_it_is_looked_at_is_passed_over(
    board: FakeUsb, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(board, "enumerate_devices", lambda: [0])
    board.unplug()
    assert usb_devices.candidates() == []
    board.set(there=True)


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("usb://1209", "must be written usb://VID:PID or usb://VID:PID/SERIAL"),
        ("usb://?in=1", "an integer from 129 to 143"),
        ("usb://?out=0x81", "an integer from 1 to 15"),
        ("usb://?report_size=64", "usb:// has: interface, in, out"),
    ],
)
def test_what_cannot_be_used_is_refused_with_what_to_write(url: str, text: str) -> None:
    with pytest.raises(TransportUnavailable) as caught:
        create(url)
    assert text in str(caught.value)


@pytest.mark.parametrize("library", [None, "none that works"])
@on_loop
async def test_a_missing_libusb_is_named_with_what_to_install(
    library: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if library is None:
        monkeypatch.setitem(sys.modules, "libusb_package", None)
    else:
        monkeypatch.setattr("libusb_package.get_libusb1_backend", lambda: None)
    with pytest.raises(TransportUnavailable, match="try: pip install --force-reinstall pyusb libusb-package"):
        await create("usb://").open(Ear())


def test_a_missing_pyusb_is_named_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("servolink.transports.usb", "servolink.transports.usb_devices"):
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "usb.core", None)
    with pytest.raises(TransportUnavailable, match="pip install --force-reinstall pyusb libusb-package"):
        create("usb://")


@on_loop
async def test_the_real_libusb_finds_no_such_device() -> None:
    if (release := version("libusb-package")) < "1.0.30" and not Path("/dev/bus/usb").exists():
        pytest.skip(f"libusb-package {release} starts only where the system knows USB")
    assert all(candidate.url.startswith("usb://") for candidate in usb_devices.candidates())
    assert "found no USB device 1209:ffff" in await _open_error("usb://1209:ffff")
