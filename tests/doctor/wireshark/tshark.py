"""tshark with the dissector: captures in, fields out."""

from __future__ import annotations

import os
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from struct import pack

import pytest

from servolink.doctor.wireshark.dissector import dissector
from servolink.protocol import ByteOrder
from servolink.recorder import Captured, write_packets
from tests.processes import run

TSHARK = shutil.which("tshark")
with_tshark = [pytest.mark.tshark, pytest.mark.skipif(TSHARK is None, reason="tshark is not installed")]

NOTES = {"packet", "section", "byte_order", "checksum.status"}
"""Fields that the dissector adds to those of the frame."""
HEADER = ["magic", "packet_id", "length"]

_LINKTYPE_RAW = 101  # IP without anything around it


@dataclass
class Frame:
    """A frame as tshark shows it."""

    number: int
    """Of the packet in the capture that it ends in."""
    fields: list[tuple[str, str]] = field(default_factory=list)
    """Filter name, without `servolink.`, and value of everything in it, in order."""
    experts: set[str] = field(default_factory=set)
    """What the dissector complains about."""

    def get(self, name: str) -> str | None:
        """Return the value of the first field of this name, None if there is none."""
        return next((value for found, value in self.fields if found == name), None)

    @property
    def content(self) -> list[tuple[str, str]]:
        """The fields of the packet itself."""
        names = [name for name, _ in self.fields]
        assert [name for name in names if name not in NOTES][:3] == HEADER
        body = self.fields[names.index("length") + 1 : names.index("checksum")]
        return [each for each in body if each[0] not in NOTES]


@dataclass(frozen=True)
class Preferences:
    """What the dissector and tshark are told."""

    byte_order: ByteOrder | None = None
    encoding: str = "utf-8"
    option: str = ""
    """One more preference."""


AT_FIRST = Preferences()


def lines(frames: Iterable[Captured], folder: Path, preferences: Preferences = AT_FIRST) -> list[Frame]:
    """Return what tshark shows of packets on a line."""
    path = folder / "line.pcapng"
    with path.open("wb") as file:
        write_packets(file, frames, comment="a test")
    return _dissected(path, folder, preferences)


def conversation(segments: Iterable[tuple[bool, bytes]], folder: Path) -> list[Frame]:
    """Return what tshark shows of a TCP conversation: segments with whether the host sent them."""
    path = folder / "tcp.pcapng"
    with path.open("wb") as file:
        write_packets(file, _ip(segments), comment="a test", link_type=_LINKTYPE_RAW)
    return _dissected(path, folder, AT_FIRST)


def _ip(segments: Iterable[tuple[bool, bytes]]) -> Iterable[Captured]:
    sequence = {True: 1000, False: 5000}
    for at, (is_host, data) in enumerate(segments):
        ends = (51000, 7878) if is_host else (7878, 51000)
        tcp = pack(">HHIIBBHHH", *ends, sequence[is_host], sequence[not is_host], 0x50, 0x18, 0xFFFF, 0, 0) + data
        ip = pack(
            ">BBHHHBBH4s4s", 0x45, 0, 20 + len(tcp), at, 0, 64, 6, 0, bytes([127, 0, 0, 1]), bytes([127, 0, 0, 1])
        )
        sequence[is_host] += len(data)
        yield Captured(at * 1_000_000, "sent" if is_host else "received", ip + tcp)


def _dissected(path: Path, folder: Path, preferences: Preferences) -> list[Frame]:
    assert TSHARK
    script = folder / "servolink.lua"
    script.write_text(dissector(preferences.byte_order, preferences.encoding), encoding="utf-8")
    command = [TSHARK, "-X", f"lua_script:{script}", "-2", "-r", str(path), "-T", "pdml"]
    done = run(
        [*command, *(["-o", preferences.option] if preferences.option else [])], check=True, env=_environment(folder)
    )
    assert "lua:" not in done.stderr.lower(), done.stderr
    assert "Lua Error" not in done.stdout, re.findall("Lua Error.*", done.stdout)[:3]
    return [
        _frame(number, proto)
        for number, packet in enumerate(ET.fromstring(done.stdout).iter("packet"), 1)  # noqa: S314 - tshark wrote it
        for proto in packet.iter("proto")
        if proto.get("name") == "servolink"
    ]


def _frame(number: int, proto: ET.Element) -> Frame:
    complaints = {
        str(each.get("name")).removeprefix("servolink.")
        for expert in proto.iter("field")
        if expert.get("name") == "_ws.expert"
        for each in expert
    }
    fields = [(each.get("name", ""), each.get("show", "")) for each in proto.iter("field")]
    own = [(name.removeprefix("servolink."), value) for name, value in fields if name.startswith("servolink.")]
    return Frame(
        number,
        [each for each in own if each[0] not in complaints],
        {name for name in complaints if not name.startswith("_ws.")},
    )


def _environment(folder: Path) -> dict[str, str]:
    """Return an environment in which tshark finds no plugins and preferences of whoever runs the tests."""
    return {**os.environ, "HOME": str(folder), "WIRESHARK_CONFIG_DIR": str(folder)}
