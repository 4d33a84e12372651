"""Ctrl-C at each point of an edit: the board holds the old record or the new one, and the command says which.

Module: servolink.cli.stored.change.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from servolink.project import UNFINISHED, Project
from servolink.protocol import (
    RECORD_TYPES,
    STORED_TYPES,
    Action,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    ServoParameter,
    Step,
)
from servolink.virtual import Contents
from tests import virtual_time
from tests.cli.programs import Said
from tests.cli.robot import Robot
from tests.sampling import every, some
from tests.virtual_time import VirtualTimeLoop

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals are those of Unix")

STORED = Project(
    77,
    (ServoParameter(1, 2, "hip"),),
    (Action(1, "Bow", (Step(1, 30, 50), Step(2, -30, 10))), Action(2, "Nod", (Step(1, 10, 5),))),
    (Macro(1, "Greet", (MacroCommand(1, total_interval=500),)),),
    (JoystickTable(1, "Pad", (Button(3, "greet", button_press_macro=1),)),),
    1,
)
EDITS = (
    "action add Wave --pose 1=30,2=-10 --seconds 0.5",
    "action set Bow --pose 1=5,3=7",
    "action rename Bow Hello",
    "action delete Nod --yes",
    "macro set Greet --play Nod,wait:1",
    "servo rename 1 knee",
)
SAYS = {
    "nothing was changed on the board": {"old"},
    "the board may say that it holds an unfinished import, but nothing else was changed": {"old"},
    "the board holds an unfinished import": {"old", "new", "both"},
    "everything is written, but the board may still say that the import is unfinished": {"new"},
    "the import is finished": {"new"},
}
"""What the command says of the records on the board, and what they may be then."""


class InterruptedLoop(VirtualTimeLoop):
    """Raises SIGINT before one turn of the first loop that runs."""

    at: int | None = None
    turns = ended = 0

    def _run_once(self) -> None:
        InterruptedLoop.turns += 1
        if InterruptedLoop.turns == InterruptedLoop.at:
            InterruptedLoop.at = None
            signal.raise_signal(signal.SIGINT)
        super()._run_once()  # type: ignore[misc]  # asyncio's own, since its beginning

    def shutdown_asyncgens(self) -> Any:  # a coroutine, of a type that mypy and pyright name differently
        """Note that the command has ended; Python ends the process at a later signal."""
        InterruptedLoop.ended, InterruptedLoop.at = InterruptedLoop.turns, None
        return super().shutdown_asyncgens()


@pytest.fixture(name="interrupted")
def _interrupted(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a function that runs an edit on a board with STORED, with SIGINT before a turn of its loop."""
    robot.ask(lambda board: board.apply_project(STORED, backup=False))
    contents = robot.board.storage.contents
    monkeypatch.setattr(virtual_time, "VirtualTimeLoop", InterruptedLoop)

    def run(edit: str, at: int | None) -> Said:
        for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
            monkeypatch.setenv(name, str(tmp_path / name / str(at)))
        robot.board.storage.contents = contents
        InterruptedLoop.at, InterruptedLoop.turns = at, 0
        return robot(*edit.split())

    return run


def held(contents: Contents, old: Contents, new: Contents) -> str:
    """Return which records these are, `old`, `new`, or records of `both`. Fail for one that is neither."""
    records = {
        name: {kind: set(each.records[kind]) for kind in STORED_TYPES} for name, each in (("old", old), ("new", new))
    }
    found = {kind: set(contents.records[kind]) for kind in STORED_TYPES}
    assert all(found[kind] <= records["old"][kind] | records["new"][kind] for kind in STORED_TYPES)
    assert all(len({number for number, _ in found[kind]}) == len(found[kind]) for kind in RECORD_TYPES)
    return next((name for name, each in records.items() if each == found), "both")


@every(17)
@pytest.mark.parametrize("edit", EDITS)
def test_an_interrupted_edit_says_what_the_board_holds(edit: str, step: int, interrupted: Any, robot: Robot) -> None:
    old = robot.board.storage.contents
    assert interrupted(edit, None).code == 0
    new, turns = robot.board.storage.contents, InterruptedLoop.ended
    said_of: set[str] = set()
    last = range(turns - 20, turns + 1)  # tried three times more, as the number of turns differs from run to run
    for at in [*some(1, turns, step), *(3 * [*last] if step == 1 else ())]:
        said = interrupted(edit, at)
        left = robot.board.storage.contents
        if said.code == 0:  # it ended in this turn, or other turns were needed
            assert (said.err, held(left, old, new)) == ("", "new"), f"turn {at}"
            continue
        assert said.code == 130, f"turn {at}: {said}"
        (state,) = [line.removeprefix("interrupted: ") for line in said.err.splitlines()]
        what = state.partition(", stopped while")[0].partition(";")[0]
        assert held(left, old, new) in SAYS[what], f"turn {at}: {state}"
        said_of.add(what)
        if left.project_id in UNFINISHED:
            assert "`servolink rollback` undoes it" in state, f"turn {at}"
            assert robot("rollback", "--yes").code == 0
            assert held(robot.board.storage.contents, old, new) == "old", f"turn {at}"
            assert robot.board.storage.project_id == STORED.project_id
        else:
            assert left.project_id == STORED.project_id
    if step == 1:
        assert said_of == SAYS.keys()
