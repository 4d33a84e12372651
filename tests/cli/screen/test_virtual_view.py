"""What `servolink virtual` shows on a terminal: servos as they move, buttons as they go down, and how it ends."""

from __future__ import annotations

import re
import sys

import pytest

from servolink.cli.screen.virtual_view import picture
from servolink.protocol import AddServoParameterRequest, Codec, QueryRemainPowerRequest, ServoParameter
from servolink.virtual import VirtualBoard
from tests.cli.programs import in_terminal


def texts(board: VirtualBoard, width: int = 80, height: int = 24) -> list[str]:
    return [text.rstrip() for text, _ in picture(board, ["tcp://127.0.0.1:7878"], (width, height), blocks=False)]


def test_the_picture_of_a_virtual_board() -> None:
    board = VirtualBoard(2)
    board.advance(0.0)
    board.servos[1].move(90, 1.0, 0.0)
    board.press_button(3, 1.0)
    board.press_button(12, 1.0)
    head, power, buttons, _, _, first, second, *_ = texts(board)
    assert head == "listening tcp://127.0.0.1:7878"
    assert power == "power on  battery 100.0 %  0 requests received"
    assert buttons == "buttons down: 3, 12; pressed last: 12"
    assert first.split()[:3] == ["1", "90°", "..................|#########........."]
    assert first.endswith("ready")
    assert second.split()[:2] == ["2", "3°"]
    board.release_button(3, 1.1)
    board.switch(on=False)
    off = "power off  battery 100.0 %  0 requests received"
    assert texts(board)[1:3] == [off, "buttons down: none; pressed last: 12"]
    assert texts(board)[5].endswith("released")


def test_nothing_is_cut_off_at_40_columns() -> None:
    lines = texts(VirtualBoard(30), 40, 12)
    assert lines[:4] == [
        "listening tcp://127.0.0.1:7878",
        "power on  battery 100.0 %  0 requests",
        "received",
        "buttons down: none",
    ]
    assert "29 more: a larger terminal shows them" in lines


def test_captions_are_shown_in_the_encoding_of_the_board() -> None:
    board = VirtualBoard(3, codec=Codec("big", "big5"))
    parameters = AddServoParameterRequest((ServoParameter(1, -3, "hip"), ServoParameter(3, 0, "左膝\x1b")))
    board.attach(lambda frame: None).receive(board.codec.encode(parameters, unchecked=True), 0.0)
    assert [line[:10].strip() for line in texts(board)[5:8]] == ["1 hip", "2", r"3 左膝\x1b"]


def test_requests_are_counted() -> None:
    board = VirtualBoard(1)
    host, request = board.attach(lambda frame: None), board.codec.encode(QueryRemainPowerRequest())
    host.receive(request, 0.0)
    assert texts(board)[1].endswith("  1 request received")
    host.receive(request * 2, 0.0)
    assert texts(board)[1].endswith("  3 requests received")


def test_angles_are_shown_in_degrees_also_if_hosts_ask_for_others() -> None:
    board = VirtualBoard(1)
    before = texts(board)[5]
    board.servos[1].unit = 1
    assert texts(board)[5] == before


@pytest.mark.parametrize(("width", "height"), [(80, 24), (60, 20), (20, 5)])
def test_the_picture_of_a_large_board_fits(width: int, height: int) -> None:
    lines = texts(VirtualBoard(250), width, height)
    assert len(lines) == height
    assert all(len(line) <= width for line in lines)


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
def test_it_is_drawn_on_a_terminal_which_is_then_as_before() -> None:
    said = in_terminal("virtual", "--tcp", "127.0.0.1:0", "--servos", "2", later=("numbers are raw", "\x03"))
    assert said.code == 0
    before, _, rest = said.out.partition("\x1b[?1049h")
    assert re.search(r"listening tcp://127\.0\.0\.1:\d+\r\n", before)
    shown, _, after = rest.partition("\x1b[?1049l")
    assert "buttons down: none" in shown
    assert "buttons down: none" in after, "the last picture stays"
    assert said.out.rindex("\x1b[?25h") > said.out.rindex("\x1b[?25l")


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
def test_with_json_nothing_is_drawn() -> None:
    said = in_terminal("virtual", "--tcp", "127.0.0.1:0", "--json", later=("listening", "\x03"))
    assert said.code == 0
    assert "\x1b[" not in said.out
