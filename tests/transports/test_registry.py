from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import pytest

from servolink.errors import ConnectionLost, InvalidAddress, OpenError, TransportUnavailable
from servolink.transports.base import Transport
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from servolink.transports.serial import SerialTransport
from servolink.transports.stream import TcpTransport
from tests.transports.wires import Ear
from tests.virtual_time import run

PLUG_IN = """
import asyncio
from servolink.transports.memory import MemoryTransport

def works(address):
    name = address.text("name", "acme")
    address.refuse_unknown()
    return MemoryTransport(address.url, name)

def refuses(address):
    raise address.refusal("needs a name")

def fails(address):
    raise KeyError("acme")

def returns_nothing(address):
    return None

class Fragile(MemoryTransport):
    async def open(self, receiver):
        self.mode = self.url.partition("://")[0].removeprefix("fragile-")
        if self.mode == "open":
            raise KeyError("acme\x1b")
        if self.mode == "wait":
            await asyncio.sleep(3600)
        await super().open(receiver)

    async def send(self, data):
        if self.mode == "send":
            raise KeyError("acme\x1b")
        if self.mode == "lose":
            self._receiver.lost(OSError(5, "acme\x1b"))
            self._receiver.lost(None)
            self._receiver.data(b"late")

    async def close(self):
        if self.mode == "close":
            raise KeyError("acme\x1b")
        if self.mode in ("hang", "wait"):
            await asyncio.sleep(3600)
        await super().close()

def fragile(address):
    return Fragile(address.url, "acme")
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
    lines += [f"fragile-{mode} = acme_boards:fragile" for mode in ("open", "wait", "send", "lose", "close", "hang")]
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
            "known are hid://, memory://, replay://, rfc2217://, serial://, share://, tcp://, usb://, virtual://, webhid://",
        ),
        ("share://", "must name a shared board: share://NAME, with letters, digits, - and _"),
        ("share://../x", "must name a shared board"),
        ("share://rex:1", "must name a shared board"),
        ("share://rex?role=god", "option role must be one of watch, run, move, edit, not 'god'"),
        ("serial://", "must name a device: serial:///dev/ttyACM0 or serial://COM3"),
        ("serial://COM3:9600", "must name a device"),
        ("serial:///dev/ttyACM0?baud=9600", "unknown option baud; serial:// has: baudrate, dtr, rts"),
        ("serial:///dev/ttyACM0?baudrate=0", "an integer from 50 to"),
        ("tcp://localhost", "needs a port from 1 to 65535"),
        ("tcp://:9000", "must be written tcp://host:port"),
        ("tcp://host:1/path", "must be written tcp://host:port"),
        ("tcp://host:1?timeout=0", "a number from 0.1 to 600"),
        ("memory://", "must name a line: memory://NAME"),
        ("replay://", "must name a file: replay://path"),
    ],
)
def test_what_cannot_be_used_is_refused_with_what_to_write(url: str, text: str) -> None:
    with pytest.raises(InvalidAddress) as caught:
        create(url)
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("url", "missing", "package"),
    [
        ("/dev/ttyACM0", "serial_asyncio", "pyserial-asyncio"),
        ("hid://", "hid hidraw", "hidapi"),
        ("usb://", "usb", "pyusb libusb-package"),
    ],
)
def test_a_missing_library_is_named_with_what_to_install(
    url: str, missing: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("serial", "usb"):  # which import their libraries
        monkeypatch.delitem(sys.modules, f"servolink.transports.{module}", raising=False)
    for module in missing.split():
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(TransportUnavailable, match=rf"pip install .*{package}") as caught:
        create(url)
    assert not isinstance(caught.value, InvalidAddress)


@pytest.mark.usefixtures("_plug_ins")
def test_options_of_the_connection_are_no_business_of_another_package() -> None:
    assert create("works://?name=x&byte_order=big&depth=4").url == "works://?name=x&byte_order=big&depth=4"
    with pytest.raises(TransportUnavailable, match="unknown option dept; works:// has: name; every address has: byte"):
        create("works://?name=x&dept=4")


@pytest.mark.usefixtures("_plug_ins")
async def test_another_package_may_bring_a_scheme() -> None:
    transport, far, ear = create("works://?name=x"), create("memory://x"), Ear()
    assert transport.url == "works://?name=x"
    await transport.open(ear)
    await far.open(Ear())
    await far.send(b"x")
    assert await ear.hear(1) == b"x"
    await transport.close()
    assert ear.losses == [None]
    await far.close()


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
    with pytest.raises(
        TransportUnavailable, match=f"plug-in acme-boards for {scheme}:// is broken: .*{reason}"
    ) as caught:
        create(f"{scheme}://")
    assert not isinstance(caught.value, InvalidAddress)


@pytest.mark.usefixtures("_plug_ins")
async def test_an_opening_of_a_plug_in_that_fails_in_its_own_way_names_it() -> None:
    ear = Ear()
    with pytest.raises(OpenError, match=r"fragile-open://: cannot open it: KeyError: 'acme\\x1b' .*acme-boards\)$"):
        await create("fragile-open://").open(ear)
    assert ear.losses == []


@pytest.mark.usefixtures("_plug_ins")
async def test_a_plug_in_that_never_opens_is_given_up_after_a_minute() -> None:
    ear = Ear()
    before = asyncio.get_running_loop().time()
    with pytest.raises(OpenError, match=r"^fragile-wait://: the plug-in acme-boards did not open it within 60 s;"):
        await create("fragile-wait://").open(ear)
    assert asyncio.get_running_loop().time() - before <= 61, "nor is it waited for while it closes"
    assert ear.losses == []


@pytest.mark.usefixtures("_plug_ins")
async def test_a_sending_of_a_plug_in_that_fails_in_its_own_way_is_the_end_and_names_it() -> None:
    transport, ear = create("fragile-send://"), Ear()
    await transport.open(ear)
    for _ in range(2):
        with pytest.raises(ConnectionLost, match=r"lost: KeyError: 'acme\\x1b' \(raised by the plug-in acme-boards\)"):
            await transport.send(b"x")
    await transport.close()
    assert [type(loss) for loss in ear.losses] == [ConnectionLost]


@pytest.mark.usefixtures("_plug_ins")
async def test_a_plug_in_that_loses_the_connection_twice_and_goes_on_loses_it_once() -> None:
    transport, ear = create("fragile-lose://"), Ear()
    await transport.open(ear)
    await transport.send(b"x")
    await transport.close()
    (loss,) = ear.losses
    assert isinstance(loss, ConnectionLost)
    assert "acme-boards" in str(loss)
    assert ear.heard == b""


@pytest.mark.usefixtures("_plug_ins")
@pytest.mark.parametrize("mode", ["close", "hang"])
def test_a_plug_in_that_does_not_close_is_given_up_after_a_second(mode: str, caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        transport, ear = create(f"fragile-{mode}://"), Ear()
        await transport.open(ear)
        before = asyncio.get_running_loop().time()
        await transport.close()
        assert ear.losses == [None]
        assert asyncio.get_running_loop().time() - before <= 1
        assert asyncio.all_tasks() == {asyncio.current_task()}

    run(main())
    assert "acme-boards" in caplog.text
