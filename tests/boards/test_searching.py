"""The search finds every kind and opens nothing; devices of one board are one board, and a single one is taken."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial  # type: ignore[import-untyped]

from servolink.boards import searching as search
from servolink.boards.announcements import announced
from servolink.boards.searching import boards, only
from servolink.doctor import SystemFacts, examine
from servolink.errors import OpenError
from servolink.transports import DeviceInfo, PortIdentity
from tests.transports.listed_ports import listed, port
from tests.virtual_time import run


def test_the_identity_of_the_port_at_an_address(monkeypatch: pytest.MonkeyPatch) -> None:
    identity = PortIdentity(1, 2, "A1")
    found = {
        "serial_ports": DeviceInfo("serial://COM4", identity=identity),
        "hid_devices": DeviceInfo("hid://1:2/A1", identity=identity),
        "usb_devices": DeviceInfo("usb://1:2/A1?interface=1", identity=identity),
    }
    monkeypatch.setattr(search, "_find_kind", lambda module: [found[module.rpartition(".")[2]]])
    for url in ("serial://COM4?baudrate=9600", "COM4", "hid://1:2/A1", "usb://1:2/A1"):
        assert search.identity_of(url) == identity
    for url in ("COM5", "hid://1:3/A1", "tcp://pi:9000", "virtual://"):
        assert search.identity_of(url) is None


def test_every_kind_is_searched() -> None:
    assert all(callable(import_module(kind).candidates) for kind in search._KINDS)


def test_a_library_that_is_missing_or_broken_hides_only_its_own_kind(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> list[DeviceInfo]:
        raise RuntimeError("no such thing")

    kinds = {
        "a": SimpleNamespace(candidates=broken),
        "b": SimpleNamespace(candidates=lambda: [DeviceInfo("tcp://x:1")]),
    }
    monkeypatch.setattr(search, "_KINDS", ("a", "missing", "b"))
    monkeypatch.setattr(search, "import_module", kinds.__getitem__)
    assert search.search() == [DeviceInfo("tcp://x:1")]


PLUG_IN = """
from servolink.errors import TransportUnavailable
from servolink.transports.device_info import DeviceInfo

def finds():
    yield DeviceInfo("acme://1", "toy")

def fails():
    yield DeviceInfo("acme://2")
    raise KeyError("acme\x1b")

def misses_its_library():
    raise TransportUnavailable("acme:// needs the package toylib")

def returns_texts():
    return ["acme://3"]

def returns_no_address():
    return [DeviceInfo("acme")]
"""


@pytest.fixture
def _plug_ins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package that adds to the search, as pip would."""
    (tmp_path / "acme_search.py").write_text(PLUG_IN)
    information = tmp_path / "acme_search-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-search\nVersion: 1.0\n")
    names = ["fails", "finds", "misses_its_library", "returns_texts", "returns_no_address", "missing"]
    (information / "entry_points.txt").write_text(
        "\n".join(["[servolink.discovery]", *(f"{name} = acme_search:{name}" for name in names)])
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "acme_search", raising=False)
    monkeypatch.setattr(search, "_KINDS", ())


@pytest.mark.usefixtures("_plug_ins")
def test_another_package_may_add_to_the_search_and_a_broken_one_hides_nothing_else() -> None:
    found = search.find_devices()
    assert found.devices == search.search() == [DeviceInfo("acme://1", "toy")]
    assert sorted(str(failure) for failure in found.failures) == [
        "acme:// needs the package toylib",
        *(
            f"the plug-in acme-search for discovery is broken: {reason}; update or remove the plug-in"
            for reason in (
                "AttributeError: module 'acme_search' has no attribute 'missing'",
                "KeyError: 'acme\\x1b'",
                "acme: is not an address; write it as serial:///dev/ttyACM0, serial://COM3, tcp://host:port or virtual://",
                "it returned str instead of a DeviceInfo",
            )
        ),
    ]


@pytest.mark.usefixtures("_plug_ins")
def test_the_doctor_names_the_plug_ins_that_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    report = run(examine(SystemFacts(), None))
    named = [finding for finding in report.findings if finding.check == "plug-in"]
    assert len(named) == 5
    assert all("miss all devices" in finding.meaning for finding in named)


def test_nothing_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(self: object) -> None:
        raise AssertionError

    listed(monkeypatch, port(os.devnull, 1))
    monkeypatch.setattr(serial.Serial, "open", opened)
    with announced(DeviceInfo("tcp://127.0.0.1:1")):
        found = {candidate.url for candidate in search.search()}
    assert {f"serial://{os.devnull}", "tcp://127.0.0.1:1"} <= found


SERIAL = DeviceInfo("serial:///dev/ttyACM0", "board", PortIdentity(serial_number="A1"))
HID = DeviceInfo("hid://1234:5678/A1", "board", PortIdentity(serial_number="A1"))
USB = DeviceInfo("usb://1234:5678/A1", "board", PortIdentity(serial_number="A1"), "no permission")
OTHER = DeviceInfo("serial:///dev/ttyUSB0", "adapter")


def forbidden(candidate: DeviceInfo) -> DeviceInfo:
    return DeviceInfo(candidate.url, candidate.product, candidate.identity, "no permission")


@pytest.mark.parametrize(
    ("candidates", "found"),
    [
        ([], []),
        ([SERIAL, HID, USB], [SERIAL]),
        ([forbidden(SERIAL), HID], [HID]),
        ([forbidden(SERIAL), USB], [forbidden(SERIAL)]),
        ([SERIAL, OTHER], [SERIAL, OTHER]),
        (
            [OTHER, DeviceInfo("serial:///dev/ttyUSB1", "adapter")],
            [OTHER, DeviceInfo("serial:///dev/ttyUSB1", "adapter")],
        ),
    ],
)
def test_a_board_is_reached_in_several_ways(candidates: list[DeviceInfo], found: list[DeviceInfo]) -> None:
    assert boards(candidates) == found


def test_a_number_that_two_ports_have_tells_nothing() -> None:
    twin = DeviceInfo("serial:///dev/ttyACM1", "board", PortIdentity(serial_number="A1"))
    assert boards([SERIAL, twin]) == [SERIAL, twin]


def test_the_only_board_is_taken() -> None:
    assert only([SERIAL, HID]) == SERIAL.url
    assert only([SERIAL, forbidden(OTHER)]) == SERIAL.url


@pytest.mark.parametrize(
    ("candidates", "named"),
    [([], ["servolink doctor"]), ([USB], [USB.url, "no permission"]), ([SERIAL, OTHER], [SERIAL.url, OTHER.url])],
)
def test_otherwise_it_says_what_is_here(candidates: list[DeviceInfo], named: list[str]) -> None:
    with pytest.raises(OpenError) as refused:
        only(candidates)
    assert all(text in str(refused.value) for text in named)


def test_what_a_device_calls_itself_is_made_safe() -> None:
    with pytest.raises(OpenError, match=r"hid://1:2/\\x1b\[2J"):
        only([SERIAL, DeviceInfo("hid://1:2/\x1b[2J", identity=PortIdentity(serial_number="\x1b[2J"))])
