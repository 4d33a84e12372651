"""Captions that try to take over the terminal, stored on a board and shown by every command that shows captions."""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.protocol.codec import Codec
from servolink.protocol.editing import (
    Action,
    AddActionRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    MacroCommand,
    ServoParameter,
)
from servolink.protocol.frame import HEADER_SIZE
from servolink.protocol.joystick import AddJoystickTableRequest, Button, JoystickTable
from servolink.protocol.packet import Packet
from servolink.protocol.servos import Step
from servolink.virtual.board import VirtualBoard
from servolink.virtual.state import save_state
from servolink.virtual.storage import Kind
from tests.cli.programs import Said, call, in_terminal

HOSTILE = {
    "escape sequence": b"\x1b[2J\x1b]0;owned\x07",
    "one-character escape sequence": "\x9b2J\x9d0;owned\x9c".encode(),
    "lines": b"one\r\nservolink: two\x0b\x0c\x85",
    "backspaces": b"rm\x08\x08ls\x7f",
    "bidi": "\u202e\u2066txt.exe\u200f\u061c".encode(),
    "other line ends": "a\u2028b\u2029c".encode(),
    "no text at all": b"\xff\xfe\x80\xc3(",
    "rich markup": b"[bold red]x[/][link=file:///]",
    "unbalanced markup": b"[/] :bomb: [not closed",
    "Chinese": "機器人跳舞".encode(),
}
MARK = "?" * 32
COMMANDS = (
    ("servos",),
    ("actions",),
    ("actions", "1"),
    ("macros",),
    ("macros", "1"),
    ("tables",),
    ("tables", "1"),
    ("run", "action", "1"),
    ("run", "macro", "1"),
    ("info",),
)


def content(packet: Packet, caption: bytes) -> bytes:
    """Return the content of a packet with `caption` in the place of MARK."""
    return Codec().encode(packet)[HEADER_SIZE:-1].replace(MARK.encode(), caption.ljust(32, b"\0"))


@pytest.fixture(params=HOSTILE.values(), ids=list(HOSTILE))
def caption(request: pytest.FixtureRequest) -> bytes:
    """Bytes that a board may hold as a caption."""
    raw = request.param
    assert isinstance(raw, bytes)
    return raw


@pytest.fixture
def url(caption: bytes, tmp_path: Path) -> str:
    """A board on which everything is called `caption`."""
    board = VirtualBoard(2)
    servos = content(AddServoParameterRequest((ServoParameter(1, 0, MARK),)), caption)
    records = {
        Kind.ACTION: content(AddActionRequest(1, MARK, (Step(1, 0, 1),)), caption),
        Kind.MACRO: content(AddMacroRequest(1, MARK, (MacroCommand(1),)), caption),
        Kind.TABLE: content(AddJoystickTableRequest(1, MARK, (Button(1, MARK, 1),)), caption),
        Kind.SERVO: servos[2:],
    }
    assert all(board.storage.put(kind, {1: record}) for kind, record in records.items())
    save_state(board, tmp_path / "state")
    return f"virtual://?state={tmp_path / 'state'}"


def shows_text_only(said: Said) -> bool:
    """Tell whether nothing was printed that is not a character to be seen, or the end of a line."""
    return all(character == "\n" or character.isprintable() for character in said.out + said.err)


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_text_is_text(arguments: tuple[str, ...], url: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", url, *arguments)
    assert (said.code, said.err) == (0, "")
    assert shows_text_only(said)


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_json_is_ascii(arguments: tuple[str, ...], url: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", url, *arguments, "--json")
    assert said.code == 0
    assert said.out.isascii()
    assert shows_text_only(said)
    assert isinstance(said.json, dict)


def test_json_keeps_the_caption(url: str, caption: bytes, capsys: pytest.CaptureFixture[str]) -> None:
    codec = Codec()
    stored = codec.decode(AddActionRequest.packet_id, content(AddActionRequest(1, MARK), caption))
    assert isinstance(stored, Action)
    assert call(capsys, "--url", url, "actions", "--json").json["actions"][0]["action_caption"] == stored.action_caption


def test_markup_is_shown_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    board = VirtualBoard(1)
    board.storage.put(Kind.ACTION, {1: content(AddActionRequest(1, MARK), HOSTILE["rich markup"])})
    save_state(board, tmp_path / "state")
    address = f"virtual://?state={tmp_path / 'state'}"
    assert "[bold red]x[/][link=file:///]" in call(capsys, "--url", address, "actions").out
    shown = in_terminal("--url", address, "actions")
    assert (shown.code, "[bold red]x[/][link=file:///]" in shown.out) == (0, True)


@pytest.mark.parametrize("arguments", [("servos",), ("tables", "1")], ids=" ".join)
def test_a_terminal_gets_only_our_own_escapes(arguments: tuple[str, ...], tmp_path: Path) -> None:
    board = VirtualBoard(1)
    table = JoystickTable(1, MARK, tuple(Button(number, MARK) for number in (1, 2)))
    hostile = HOSTILE["escape sequence"]
    board.storage.put(Kind.TABLE, {1: content(AddJoystickTableRequest(1, table.table_caption, table.buttons), hostile)})
    board.storage.put(Kind.SERVO, {1: content(AddServoParameterRequest((ServoParameter(1, 0, MARK),)), hostile)[2:]})
    save_state(board, tmp_path / "state")
    said = in_terminal("--url", f"virtual://?state={tmp_path / 'state'}", *arguments)
    assert said.code == 0
    assert r"\x1b[2J\x1b]0;owned\x07" in said.out
    assert "\x1b[2J" not in said.out
    assert "\x07" not in said.out


def test_an_error_shows_what_was_typed_as_text(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", "tcp://\x1b[2J\u202e:1", "info")
    assert said.code == 3
    assert shows_text_only(said)
