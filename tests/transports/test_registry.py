from __future__ import annotations

import sys
from pathlib import Path

import pytest

from servolink.errors import TransportUnavailable
from servolink.transports.base import Transport
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from servolink.transports.serial import SerialTransport
from servolink.transports.stream import TcpTransport

PLUG_IN = """
from servolink.transports.memory import MemoryTransport

def works(address):
    return MemoryTransport(address.url, address.text("name", "acme"))

def refuses(address):
    raise address.refusal("needs a name")

def fails(address):
    raise KeyError("acme")

def returns_nothing(address):
    return None
"""


@pytest.fixture
def _plug_ins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a package that brings schemes, as pip would."""
    (tmp_path / "acme_boards.py").write_text(PLUG_IN)
    information = tmp_path / "acme_boards-1.0.dist-info"
    information.mkdir()
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: acme-boards\nVersion: 1.0\n")
    names = ["works", "refuses", "fails", "returns_nothing", "missing"]
    lines = [f"{name.replace('_', '-')} = acme_boards:{name}" for name in names]
    (information / "entry_points.txt").write_text(
        "\n".join(["[servolink.transports]", *lines, "gone = acme_gone:works", "tcp = acme_boards:fails"])
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "acme_boards", raising=False)


@pytest.mark.parametrize(
    ("url", "kind"),
    [
        ("/dev/ttyACM0", SerialTransport),
        ("COM3", SerialTransport),
        ("serial:///dev/ttyACM0?baudrate=9600&dtr=1&rts=0", SerialTransport),
        ("tcp://localhost:9000?timeout=1.5", TcpTransport),
        ("memory://bench", MemoryTransport),
    ],
)
def test_an_address_gives_its_kind_of_transport(url: str, kind: type) -> None:
    transport = create(url)
    assert isinstance(transport, kind)
    assert isinstance(transport, Transport)
    assert transport.url == url


@pytest.mark.parametrize(
    ("url", "text"),
    [
        (
            "seral:///dev/ttyACM0",
            "known are hid://, memory://, replay://, serial://, tcp://, usb://, virtual:// and a bare device path",
        ),
        ("serial://", "must name a device: serial:///dev/ttyACM0 or serial://COM3"),
        ("serial://COM3:9600", "must name a device"),
        ("serial:///dev/ttyACM0?baud=9600", "unknown option baud; serial:// knows: baudrate, dtr, rts"),
        ("serial:///dev/ttyACM0?baudrate=0", "a whole number from 50 to"),
        ("tcp://localhost", "needs a port from 1 to 65535"),
        ("tcp://:9000", "must be written tcp://host:port"),
        ("tcp://host:1/path", "must be written tcp://host:port"),
        ("tcp://host:1?timeout=0", "a number from 0.1 to 600"),
        ("memory://", "must name a line: memory://NAME"),
        ("replay://", "must name a file: replay:///path"),
    ],
)
def test_what_cannot_be_used_is_refused_with_what_to_write(url: str, text: str) -> None:
    with pytest.raises(TransportUnavailable) as caught:
        create(url)
    assert text in str(caught.value)


def test_a_missing_library_is_named_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "servolink.transports.serial")
    monkeypatch.setitem(sys.modules, "serial_asyncio", None)
    with pytest.raises(TransportUnavailable, match=r"pip install .*pyserial-asyncio"):
        create("/dev/ttyACM0")


@pytest.mark.usefixtures("_plug_ins")
def test_another_package_may_bring_a_scheme() -> None:
    transport = create("works://?name=x")
    assert isinstance(transport, MemoryTransport)


@pytest.mark.usefixtures("_plug_ins")
def test_our_own_schemes_come_first() -> None:
    assert isinstance(create("tcp://localhost:1"), TcpTransport)


@pytest.mark.usefixtures("_plug_ins")
def test_the_schemes_of_other_packages_are_known() -> None:
    with pytest.raises(TransportUnavailable, match="works://"):
        create("nobody://")


@pytest.mark.usefixtures("_plug_ins")
def test_a_plug_in_may_refuse_an_address() -> None:
    with pytest.raises(TransportUnavailable, match=r"refuses://: needs a name$"):
        create("refuses://")


@pytest.mark.usefixtures("_plug_ins")
@pytest.mark.parametrize(
    ("scheme", "reason"),
    [("fails", "KeyError"), ("gone", "acme_gone"), ("missing", "AttributeError"), ("returns-nothing", "NoneType")],
)
def test_a_broken_plug_in_is_one_clear_refusal(scheme: str, reason: str) -> None:
    with pytest.raises(TransportUnavailable, match=f"plug-in acme-boards for {scheme}:// is broken: .*{reason}"):
        create(f"{scheme}://")
