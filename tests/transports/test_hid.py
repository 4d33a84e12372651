"""A board on HID: reports, descriptors, the choice of the interface, and errors.

Module: servolink.transports.hid_devices.
"""

from __future__ import annotations

import asyncio
import fcntl
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import ConnectionLost, OpenError, TransportUnavailable
from servolink.transports import hid_devices
from servolink.transports.base import Transport
from servolink.transports.device_info import DeviceInfo, PortIdentity
from servolink.transports.hid import HidReport, Way, cut, declared
from servolink.transports.registry import create
from tests.transports.fake_hid import VENDOR_DESCRIPTOR, FakeHandle, FakeHid
from tests.transports.rights import not_root
from tests.transports.wires import Ear, on_loop

NUMBERED = bytes.fromhex("0600ffa1018505750895208102850675089510910285077508953f9102c0")
"""Report 5 brings 32 bytes, 6 takes 16 and 7 takes 63."""


@pytest.fixture
def hid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeHid]:
    """Put a board where hidapi is imported from."""
    made = FakeHid(tmp_path / "hidraw0")
    monkeypatch.setitem(sys.modules, "hidraw", made)
    yield made
    assert made.handles == set()
    assert made.misuse == []


@pytest.fixture
def _no_hidapi(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide hidapi."""
    monkeypatch.setitem(sys.modules, "hidraw", None)
    monkeypatch.setitem(sys.modules, "hid", None)


def another(hid: FakeHid, **changes: Any) -> None:
    """Plug in another interface, at a path of its own."""
    path = f"{hid.node.parent}/hidraw{len(hid.entries)}"
    hid.entries.append({**hid.entry, "path": path.encode(), **changes})


async def _open_error(url: str) -> str:
    with pytest.raises(OpenError) as caught:
        await create(url).open(Ear())
    return str(caught.value)


async def _sent(hid: FakeHid, url: str, frame: bytes) -> list[bytes]:
    """Return the reports that carry a frame."""
    reports: list[bytes] = []
    hid.heard = reports.append
    transport = create(url)
    await transport.open(Ear())
    await transport.send(frame)
    await transport.close()
    return reports


@on_loop
async def test_a_frame_goes_out_in_reports_with_their_id_filled_with_zeros(hid: FakeHid) -> None:
    frame = bytes(range(1, 101))
    assert await _sent(hid, "hid://", frame) == [b"\0" + frame[:64], b"\0" + frame[64:] + bytes(28)]


@pytest.mark.parametrize(
    ("url", "report_id", "size"),
    [("hid://", 6, 16), ("hid://?report_id=7", 7, 63), ("hid://?report_id=9&report_size=20", 9, 20)],
)
@on_loop
async def test_the_descriptor_gives_id_and_size_unless_they_are_given(
    hid: FakeHid, url: str, report_id: int, size: int
) -> None:
    hid.descriptor = NUMBERED
    if "report_id=7" in url:
        hid.descriptor = NUMBERED.replace(b"\x85\x05", b"\x85\x07")
    assert await _sent(hid, url, b"abc") == [bytes([report_id]) + b"abc".ljust(size, b"\0")]


@on_loop
async def test_numbered_reports_come_without_their_id_and_others_not_at_all(hid: FakeHid) -> None:
    hid.descriptor = NUMBERED
    transport, ear = create("hid://"), Ear()
    await transport.open(ear)
    for report in (b"\x05" + b"a" * 32, b"\x01" + b"x" * 32, b"\x05" + b"b" * 32):
        hid.bring(report)
    assert await ear.hear(64) == b"a" * 32 + b"b" * 32
    await transport.close()


@on_loop
async def test_without_a_descriptor_reports_have_64_bytes(hid: FakeHid, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: FakeHandle) -> None:
        raise OSError("get report descriptor error")

    monkeypatch.setattr(FakeHandle, "get_report_descriptor", fail)
    assert await _sent(hid, "hid://", b"abc") == [b"\0abc" + bytes(61)]
    monkeypatch.delattr(FakeHandle, "get_report_descriptor")  # as before hidapi 0.14
    assert await _sent(hid, "hid://", b"abc") == [b"\0abc" + bytes(61)]


@on_loop
async def test_a_device_without_such_reports_is_no_board(hid: FakeHid) -> None:
    hid.descriptor = NUMBERED
    text = await _open_error("hid://?report_id=5")
    assert text == "hid://?report_id=5: the device has no output report with the id 5; it has: in 5, out 6, out 7"
    hid.descriptor = bytes.fromhex("0600ffa101750895409102c0")
    assert "the device has no input report; it has: out 0" in await _open_error("hid://")


@on_loop
async def test_a_failed_write_is_the_end_and_says_why(hid: FakeHid) -> None:
    transport, ear = create("hid://"), Ear()
    await transport.open(ear)
    hid.set(refused=True)
    with pytest.raises(ConnectionLost, match="the device is gone: No such device; is it unplugged or switched off"):
        await transport.send(b"abc")
    assert isinstance(await ear.end(), ConnectionLost)
    await transport.close()


@pytest.mark.parametrize("url", ["hid://1209:0001", "hid://1209:1/SN%201", "hid://0x1209:0x1", "hid://"])
@on_loop
async def test_a_device_is_found_by_its_numbers(hid: FakeHid, url: str) -> None:
    another(hid, product_id=0x0002, usage_page=0x01, usage=0x06)
    transport = create(url)
    await transport.open(Ear())
    await transport.close()
    assert transport.url == url


@pytest.mark.parametrize(
    ("url", "looked_for"),
    [
        ("hid://1209:0002", "HID device 1209:0002"),
        ("hid://1209:0001/SN", "HID device 1209:0001 with the serial number 'SN'"),
        ("hid://?usage_page=0xff01", "HID device with a vendor-defined interface of usage page 0xff01"),
    ],
)
@on_loop
async def test_a_missing_device_is_told_with_those_that_are_there(hid: FakeHid, url: str, looked_for: str) -> None:
    text = await _open_error(url)
    assert text.startswith(f"{url}: found no {looked_for}; plug the board in and switch it on; these are here: ")
    assert text.endswith("hid://1209:0001/SN%201")


@on_loop
async def test_several_devices_are_named(hid: FakeHid) -> None:
    another(hid, serial_number="SN 2")
    assert await _open_error("hid://") == (
        "hid://: 2 devices can be the board; choose among: hid://1209:0001/SN%201, hid://1209:0001/SN%202"
    )
    another(hid, serial_number="SN 2", usage_page=0xFF01)
    assert "hid://1209:0001/SN%202?usage_page=0xff00" in await _open_error("hid://1209:0001/SN%202")
    another(hid)
    assert "cannot be told apart (hid://1209:0001/SN%201" in await _open_error("hid://1209:0001/SN%201")


@on_loop
async def test_keyboards_and_mice_are_no_boards(hid: FakeHid) -> None:
    hid.entries.append({**hid.entry, "usage_page": 1, "usage": 6})  # a second collection of the same interface
    assert hid_devices.candidates() == []
    assert "nothing of that kind is here" in await _open_error("hid://1209:0001")
    hid.entries.pop()
    another(hid, usage_page=1, usage=2)  # an interface beside it: a mouse with settings of its maker
    assert hid_devices.candidates() == []
    transport = create("hid://1209:0001")  # but who names it means it
    await transport.open(Ear())
    await transport.close()


@on_loop
async def test_a_device_that_another_servolink_has_is_busy(hid: FakeHid) -> None:
    first = create("hid://")
    await first.open(Ear())
    assert f"{hid.node} is in use by another servolink; close that program" in await _open_error("hid://")
    await first.close()
    with hid.node.open() as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        assert "is in use" in await _open_error("hid://")
    again = create("hid://")
    await again.open(Ear())
    await again.close()


@on_loop
async def test_missing_permission_is_told_with_the_rule_that_cures_it(hid: FakeHid) -> None:
    hid.node.chmod(0)
    problem = f"no permission for {hid.node}; `servolink doctor --print-udev` prints the udev rule for this permission"
    with not_root():
        (candidate,) = hid_devices.candidates()
        text = await _open_error("hid://")
    assert candidate.problem.startswith(problem)
    assert problem in text


@on_loop
async def test_a_device_that_vanishes_while_it_is_opened_is_told(hid: FakeHid) -> None:
    hid.node.unlink()
    assert "hidraw0 has just vanished; plug the board in again" in await _open_error("hid://")


@on_loop
async def test_a_device_that_hidapi_cannot_open_is_told(hid: FakeHid, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: FakeHandle, path: bytes) -> None:
        raise OSError("open failed")

    monkeypatch.setattr(FakeHandle, "open_path", fail)
    assert "hidraw0: open failed; close the program that has it" in await _open_error("hid://")


def test_candidates_tell_what_there_is_without_opening_it(hid: FakeHid) -> None:
    another(hid, serial_number=None, product_string=None, usage_page=0xFFAB)
    assert hid_devices.candidates() == [
        DeviceInfo("hid://1209:0001/SN%201", "Servo board", PortIdentity(0x1209, 1, "SN 1", 2)),
        DeviceInfo("hid://1209:0001", "", PortIdentity(0x1209, 1, "", 2)),
    ]
    assert hid.threads == set()


@on_loop
async def test_the_urls_of_candidates_lead_to_them(hid: FakeHid) -> None:
    another(hid, usage_page=0xFF01)
    for candidate in hid_devices.candidates():
        transport: Transport = create(candidate.url)
        if "0xff00" in candidate.url:
            await transport.open(Ear())
            await transport.close()
        else:
            assert "hidraw1 has just vanished" in await _open_error(candidate.url)


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("hid://1209", "must be written hid://VID:PID or hid://VID:PID/SERIAL"),
        ("hid://12345:1", "must be written hid://VID:PID"),
        ("hid:///SN", "must be written hid://VID:PID"),
        ("hid://?report_size=0", "an integer from 1 to 4096"),
        ("hid://?report_id=0x100", "an integer from 0 to 255"),
        ("hid://?interface=1", "hid:// has: report_size, report_id, usage_page"),
    ],
)
@pytest.mark.usefixtures("hid")
def test_what_cannot_be_used_is_refused_with_what_to_write(url: str, text: str) -> None:
    with pytest.raises(TransportUnavailable) as caught:
        create(url)
    assert text in str(caught.value)


@pytest.mark.usefixtures("_no_hidapi")
def test_a_missing_hidapi_is_named_with_what_to_install() -> None:
    with pytest.raises(TransportUnavailable, match=r"cannot be used: .*; try: pip install --force-reinstall hidapi$"):
        create("hid://")


@pytest.mark.parametrize(
    "source", ["class Device: pass\n", "raise ImportError('Unable to load any of the following libraries')\n"]
)
@pytest.mark.usefixtures("_no_hidapi")
def test_the_other_package_of_the_modules_name_is_found_out(
    source: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "hid").mkdir()
    (tmp_path / "hid" / "__init__.py").write_text(source)
    monkeypatch.delitem(sys.modules, "hid")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(TransportUnavailable, match=r"try: pip uninstall hid; pip install --force-reinstall hidapi$"):
        create("hid://")
    sys.modules.pop("hid", None)


def test_a_hidapi_of_one_module_serves_too(hid: FakeHid, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hidraw", None)
    monkeypatch.setitem(sys.modules, "hid", hid)
    assert hid_devices.load_hidapi() is hid


def test_a_module_without_its_functions_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "hidraw", ModuleType("hidraw"))
    monkeypatch.setitem(sys.modules, "hid", ModuleType("hid"))
    with pytest.raises(TransportUnavailable, match="hidapi"):
        hid_devices.load_hidapi()


def test_the_real_hidapi_can_be_asked() -> None:
    assert all(candidate.url.startswith("hid://") for candidate in hid_devices.candidates())


@on_loop
async def test_the_real_hidapi_finds_no_such_device() -> None:
    assert "found no HID device 1209:ffff" in await _open_error("hid://1209:ffff")


@on_loop
async def test_boards_side_by_side_do_not_disturb_each_other(hid: FakeHid) -> None:
    transport, ear = create("hid://"), Ear()
    await transport.open(ear)
    errors = await asyncio.gather(*(_open_error("hid://") for _ in range(5)))
    hid.bring(b"still there")
    assert await ear.hear(11) == b"still there"
    assert all("in use" in error for error in errors)
    await transport.close()


KEYBOARD = bytes.fromhex(
    "05010906a101050719e029e71500250175019508810295017508810395057501050819012905910295017503910395067508150025650507"
    "190029658100c0"
)


def test_an_unnumbered_pair_of_reports_is_found() -> None:
    assert declared(VENDOR_DESCRIPTOR) == [HidReport(Way.IN, 0, 0xFF00, 64), HidReport(Way.OUT, 0, 0xFF00, 64)]


def test_numbered_reports_have_their_own_sizes() -> None:
    assert declared(NUMBERED) == [
        HidReport(Way.IN, 5, 0xFF00, 32),
        HidReport(Way.OUT, 6, 0xFF00, 16),
        HidReport(Way.OUT, 7, 0xFF00, 63),
    ]


def test_fields_of_one_report_add_up_and_belong_to_the_outermost_page() -> None:
    assert declared(KEYBOARD) == [HidReport(Way.IN, 0, 1, 8), HidReport(Way.OUT, 0, 1, 1)]


def test_collections_after_each_other_keep_their_pages() -> None:
    assert [report.usage_page for report in declared(KEYBOARD + VENDOR_DESCRIPTOR)] == [1, 1, 0xFF00, 0xFF00]


def test_pushed_items_come_back() -> None:
    pushed = bytes.fromhex("0600ffa10175089504a47510b481029102c0")
    assert declared(pushed) == [HidReport(Way.IN, 0, 0xFF00, 4), HidReport(Way.OUT, 0, 0xFF00, 4)]


def test_long_items_are_skipped() -> None:
    assert declared(b"\xfe\x02\x00\xa1\x01" + VENDOR_DESCRIPTOR) == declared(VENDOR_DESCRIPTOR)


@given(st.binary(max_size=80))
def test_any_bytes_are_read(descriptor: bytes) -> None:
    assert all(report.size > 0 for report in declared(descriptor))


@given(st.integers(0, 24))
def test_what_is_cut_off_adds_nothing(end: int) -> None:
    assert set(declared(VENDOR_DESCRIPTOR[:end])) <= set(declared(VENDOR_DESCRIPTOR))


@given(st.binary(max_size=300), st.integers(0, 255), st.integers(1, 70))
def test_reports_carry_the_frame_and_are_filled_with_zeros(frame: bytes, report_id: int, size: int) -> None:
    reports = list(cut(frame, report_id, size))
    assert all(report[0] == report_id and len(report) == 1 + size for report in reports)
    carried = b"".join(report[1:] for report in reports)
    assert carried[: len(frame)] == frame
    assert not any(carried[len(frame) :])
    assert len(carried) - len(frame) < size
