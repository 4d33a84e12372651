"""Tables as aligned text.

Module: servolink.cli.screen.live.
"""

from __future__ import annotations

import io
import re
from types import SimpleNamespace

import pytest
from rich.console import Console

from servolink.cli.screen import live
from servolink.cli.screen.output import Table, angle_text, plain_lines, show_table
from servolink.client import Servo
from servolink.connection import Stats
from servolink.motion import Adc, Angle, Degrees
from servolink.project import Progress


def test_numbers_stand_to_the_right_and_texts_to_the_left() -> None:
    table = Table(("servo", "name", "ok"), [(1, "a", True), (100, "longer", False)])
    assert plain_lines(table) == ["servo  name    ok", "    1  a       yes", "  100  longer  no"]


def test_what_is_missing_is_left_out() -> None:
    assert plain_lines(Table(("a", "b"), [(None, 1), ("x", None)])) == ["a  b", "   1", "x"]


def test_facts_have_no_head() -> None:
    assert plain_lines(Table((), [("url", "x"), ("servos", 16)])) == ["url     x", "servos  16"]


def test_wide_and_combining_characters_take_their_place() -> None:
    lines = plain_lines(Table(("caption", "id"), [("機器人", 1), ("e\u0301te\u0301", 2), ("plain", 3)]))
    assert lines == ["caption  id", "機器人    1", "e\u0301te\u0301       2", "plain     3"]


def test_titles_and_cells_are_made_safe() -> None:
    lines = plain_lines(Table(("caption",), [("\x1b[2J",)], "table \u202e"))
    assert lines == ["table \\u202e", "caption", "\\x1b[2J"]
    assert plain_lines(Table((), [], "only \x07")) == ["only \\x07"]


SERVOS = Table(("servo", "angle", "temperature (raw)"), [(1, 90, 250), (2, -120, 251)])


@pytest.mark.parametrize("width", [1, 20, 30, 31, 100])
@pytest.mark.parametrize("table", [SERVOS, Table((), [("board", "tcp://127.0.0.1:4000"), ("servos", 16)])])
def test_no_value_is_cut_off_on_a_narrow_terminal(table: Table, width: int) -> None:
    said = io.StringIO()
    show_table(table, Console(file=said, width=width, force_terminal=True, color_system=None))
    lines = said.getvalue().splitlines()
    for row in table.rows:
        assert any(all(str(cell) in line.split() for cell in row) for line in lines)


def test_long_facts_are_wrapped_between_words() -> None:
    said = io.StringIO()
    table = Table(
        (), [("meaning", "the board is held by another program, which keeps it open"), ("remedy", "close it")]
    )
    show_table(table, Console(file=said, width=40, force_terminal=True, color_system=None))
    assert said.getvalue().splitlines() == [
        "meaning  the board is held by another",
        "         program, which keeps it open",
        "remedy   close it",
    ]


@pytest.mark.parametrize("width", [21, 22, 40, 100])
@pytest.mark.parametrize("angle", [Degrees(-120), Adc(4095)])
def test_no_angle_is_cut_off_beside_a_bar(angle: Angle, width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    said = io.StringIO()
    monkeypatch.setattr(live, "is_terminal", lambda: True)
    monkeypatch.setattr(live, "console", lambda: Console(file=said, width=width))
    with live.live_bars() as draw:
        draw(0.0, [Servo(254, angle, 0, 0, 0, is_start=True, is_hold=True)])
    assert said.getvalue().split()[:2] == ["servo", "254"]
    assert f" {angle_text(angle)} " in said.getvalue().replace("\n", " ")


@pytest.mark.parametrize(("encoding", "bar"), [("utf-8", "│██"), ("ascii", "|##")])
def test_bars_are_made_of_what_the_terminal_can_show(encoding: str, bar: str, monkeypatch: pytest.MonkeyPatch) -> None:
    said = io.BytesIO()
    file = io.TextIOWrapper(said, encoding=encoding, errors="backslashreplace")
    monkeypatch.setattr(live, "is_terminal", lambda: True)
    monkeypatch.setattr(live, "console", lambda: Console(file=file, width=80, color_system=None))
    with live.live_bars() as draw:
        draw(0.0, [Servo(1, Degrees(90), 0, 0, 1, is_start=True, is_hold=True)])
    file.flush()
    assert bar in said.getvalue().decode(encoding)


def test_each_picture_of_an_import_names_its_phase(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = io.StringIO()
    monkeypatch.setattr(live, "console", lambda **_: Console(file=drawn, force_terminal=True, width=100))
    monkeypatch.setattr("sys.stderr", SimpleNamespace(isatty=lambda: True))
    with live.shown_progress(SimpleNamespace(stats=Stats())) as on_progress:  # type: ignore[arg-type]
        for phase in ("reading", "saving", "writing"):
            on_progress(Progress(phase, 1, 2, "action 1"))
    pictures = [line for line in re.split(r"[\r\n]", drawn.getvalue()) if "\u2501" in line]
    assert pictures
    assert all(any(label in picture for label in live.PHASES.values()) for picture in pictures)
