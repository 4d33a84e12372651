"""Odd boards in virtual time: the verdict on each, the learnt settings, and the commands that work on it.

Modules: servolink.virtual.odd.contents, servolink.virtual.odd.kinds, servolink.virtual.odd.lines,
servolink.virtual.odd.wire.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from servolink.virtual.odd.kinds import KINDS
from tests.zoo.table import COMMANDS, TABLE, USUAL
from tests.zoo.trials import Zoo

REFUSED_WITHIN = 6.0
"""Seconds until a device that is not a board is refused."""

_TWICE = ("twice", "twice-2", "twice-10")
MakeZoo = Callable[[str], Zoo]


@pytest.fixture(name="zoo")
def _zoo(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> MakeZoo:
    """Return a function that makes an odd board, with folders of its own for profiles and backups."""
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))

    def make(kind: str) -> Zoo:
        zoo = Zoo(kind, tmp_path, capsys)
        monkeypatch.setattr(asyncio, "run", zoo.run)
        return zoo

    return make


def check(found: Mapping[str, str], expected: Mapping[str, str]) -> None:
    """Compare the errors of commands with the words expected of each."""
    assert found.keys() == expected.keys(), found
    for name, words in expected.items():
        assert words in found[name], name


@pytest.mark.parametrize(
    "kind",
    [pytest.param(kind, marks=pytest.mark.slow) if kind in {"very-late", *_TWICE} else kind for kind in TABLE],
)
def test_each_board_is_judged_used_and_learnt_as_the_table_says(kind: str, zoo: MakeZoo) -> None:
    board, row = zoo(kind), TABLE[kind]
    assert board.verdict() == row.verdict
    check(board.refusals(), row.refused)
    said = board.learn()
    if isinstance(row.learnt, str):
        assert said.code
        assert row.learnt in said.err
    else:
        assert (said.code, said.err) == (0, "")
        expected = USUAL | dict(row.learnt)
        assert board.learnt() == {name: value for name, value in expected.items() if value is not None}
    check(board.refusals(), row.refused if row.after is None else row.after)


@pytest.mark.parametrize("kind", ["silent", "chatting", "loop-back", "modem"])
@pytest.mark.parametrize("command", ["doctor", "servos"])
def test_a_device_that_is_not_a_board_is_refused_soon(kind: str, command: str, zoo: MakeZoo) -> None:
    board = zoo(kind)
    assert board(command, *(("rex",) if command == "doctor" else ("--board", "rex"))).code
    assert board.seconds < REFUSED_WITHIN


def test_every_kind_has_a_row() -> None:
    assert KINDS.keys() == TABLE.keys()
    assert all(kind.__doc__ and kind.lesson for kind in KINDS.values())
    assert all({*row.refused, *(row.after or ())} <= {*COMMANDS} for row in TABLE.values())
