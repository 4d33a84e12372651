"""`servolink wireshark`, and the folder into which it puts the dissector.

Module: servolink.cli.developers.wireshark.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from servolink.doctor.wireshark.dissector import FIRST_LINE, dissector, plugin_folder
from servolink.errors import ServolinkError
from servolink.protocol import PACKETS
from tests.cli.programs import call
from tests.doctor.wireshark.tshark import TSHARK
from tests.processes import run


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a home of which nobody knows."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("APPDATA", str(tmp_path))
    return tmp_path


def test_every_packet_is_described() -> None:
    text = dissector()
    described = re.findall(r"^  \[(\d+)\] = \{ name = \"(\w+)\", section = \"([\d.]+)\"", text, re.MULTILINE)
    assert described == [
        (str(packet_id), declared.__name__, declared.section) for packet_id, declared in sorted(PACKETS.items())
    ]
    assert len(described) == 60


def test_it_is_printed_with_the_preferences_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "wireshark").out == dissector()
    said = call(capsys, "wireshark", "--json", "--byte-order", "big", "--caption-encoding", "big5")
    assert said.json == {"dissector": dissector("big", "big5")}
    assert "DEFAULTS = { byte_order = 2, caption_encoding = 1 }" in said.json["dissector"]


def test_an_encoding_that_wireshark_cannot_read_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "wireshark", "--caption-encoding", "cp437")
    assert (said.code, said.out) == (2, "")
    assert (
        "Wireshark can read captions in utf-8, big5, gb18030, utf-16-le, utf-16-be, latin-1, not in cp437" in said.err
    )


@pytest.mark.skipif(sys.platform == "win32", reason="the folder is another one there")
def test_it_is_installed_and_replaced(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = home / ".local/lib/wireshark/plugins/servolink.lua"
    said = call(capsys, "wireshark", "--install")
    assert (said.code, said.out) == (0, f"installed {path}\n")
    assert "restart Wireshark" in said.err
    assert path.read_text(encoding="utf-8") == dissector()
    assert call(capsys, "wireshark", "--install", "--byte-order", "big", "--json").json == {"installed": str(path)}
    assert path.read_text(encoding="utf-8") == dissector("big")
    assert [each.name for each in path.parent.iterdir()] == ["servolink.lua"]


@pytest.mark.skipif(sys.platform == "win32", reason="the folder is another one there")
def test_the_file_of_somebody_else_is_left_alone(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = home / ".local/lib/wireshark/plugins/servolink.lua"
    path.parent.mkdir(parents=True)
    path.write_text("-- mine")
    said = call(capsys, "wireshark", "--install")
    assert said.code == 1
    assert f"{path} was not written by servolink; remove the file" in said.err
    assert path.read_text() == "-- mine"
    (home / ".local/lib/wireshark/plugins/servolink.lua").unlink()
    path.parent.rmdir()
    path.parent.write_text("a file")
    assert f"{path} cannot be written: " in call(capsys, "wireshark", "--install").err


def test_the_folder_is_the_one_that_wireshark_documents() -> None:
    assert plugin_folder("linux", {"HOME": "/home/ada"}) == Path("/home/ada/.local/lib/wireshark/plugins")
    assert plugin_folder("darwin", {"HOME": "/Users/ada"}) == Path("/Users/ada/.local/lib/wireshark/plugins")
    assert plugin_folder("win32", {"APPDATA": "C:/Ada"}) == Path("C:/Ada/Wireshark/plugins")
    with pytest.raises(ServolinkError, match="APPDATA is not set"):
        plugin_folder("win32", {})


def test_it_begins_with_the_line_by_which_it_is_known() -> None:
    assert dissector().startswith(f"{FIRST_LINE}\n")


@pytest.mark.tshark
@pytest.mark.skipif(TSHARK is None, reason="tshark is not installed")
def test_tshark_itself_names_the_folder(home: Path) -> None:
    assert TSHARK
    said = run((TSHARK, "-G", "folders"), check=True).stdout
    assert re.findall(r"Personal Lua Plugins:\s+(.+)", said) == [str(plugin_folder())]
