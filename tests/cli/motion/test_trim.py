"""`servolink trim`: servos are nudged by keys or options, and their corrections stored."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import pytest

from servolink.cli.motion import trim
from servolink.cli.motion.trim import TrimSession
from servolink.cli.screen import terminal
from servolink.client import Board, connect
from servolink.protocol import ServoParameter
from tests.cli.programs import Said, in_terminal
from tests.cli.robot import Robot, typing


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))


def corrections(robot: Robot) -> dict[int, int]:
    found = robot.ask(lambda board: board.servo_parameters())
    return {one.servo_id: one.adjusted_degree for one in found if one.adjusted_degree}


def angles(robot: Robot) -> list[int]:
    return [int(servo.angle) for servo in robot.ask(lambda board: board.servos())]


def test_a_servo_is_nudged_and_its_correction_stored(robot: Robot) -> None:
    robot.ask(lambda board: board.add_servo_parameters([ServoParameter(3, 2, "hip")]))
    before = angles(robot)
    said = robot("trim", "--set", "hip=+4", "--set", "1=-3")
    assert (said.code, said.err) == (0, "")
    assert said.out.splitlines()[:2] == [
        f"servo 1 moves from {before[0]}° to {before[0] - 3}°",
        f"servo 3 moves from {before[2]}° to {before[2] + 4}°",
    ]
    assert "done, and verified" in said.out
    assert corrections(robot) == {1: -3, 3: 6}
    assert angles(robot) == [before[0] - 3, before[1], before[2] + 4]
    assert robot("rollback", "--yes").code == 0
    assert corrections(robot) == {3: 2}


def test_programs_get_one_object(robot: Robot) -> None:
    assert robot("trim", "--set", "1=+2", "--json").json["changed"]
    assert robot("trim", "--set", "1=+0", "--json").json == {"changed": False}
    assert corrections(robot) == {1: 2}


@pytest.mark.parametrize(
    ("arguments", "code", "why"),
    [
        (
            "",
            2,
            "servos are nudged by keys, which needs an interactive terminal; without one, use --set SERVO=+N",
        ),
        ("--json", 2, "which needs an interactive terminal"),
        ("1 --set 2=+1", 2, "--set names the servos itself: leave SERVO out"),
        ("--set 3=4", 2, "'3=4' must be SERVO=+N or SERVO=-N, as in 3=+4; `servolink servo trim 3 4` stores 4"),
        ("--set 3=+400", 2, "must be an integer from -360 to 360"),
        ("--set 3=+181", 1, "servo 3: its correction would be 181 degrees; it must be from -180 to 180"),
        ("--set 9=+1", 1, "the board has no servo 9; nothing was moved"),
        ("--set all=+1", 1, "`--set` takes single servos, not `all`"),
        ("--set 1=+1 --set 1=+2", 1, "a servo is given twice; no correction was stored"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_moves(arguments: str, code: int, why: str, robot: Robot) -> None:
    before = angles(robot)
    said = robot("trim", *arguments.split())
    assert (said.code, said.out) == (code, "")
    assert why in " ".join(said.err.split())
    assert (angles(robot), corrections(robot)) == (before, {})


def test_servos_that_would_not_move_are_started_only_if_asked(robot: Robot) -> None:
    robot.ask(lambda board: board.release(2))
    said = robot("trim", "--set", "2=+1")
    assert said.code == 1
    assert "servo 2 is stopped or released and would ignore the movement" in said.err
    assert robot("trim", "--set", "2=+1", "--start").code == 0
    assert corrections(robot) == {2: 1}


def test_nothing_is_stored_for_a_servo_that_does_not_arrive(robot: Robot) -> None:
    robot.script("0.1 power")
    said = robot("trim", "--set", "1=+90")
    assert said.code == 1
    assert "servolink: servo 1 was moved by +90°; no correction was stored" in said.err
    assert corrections(robot) == {}


def test_a_correction_that_somebody_else_changed_is_kept(robot: Robot) -> None:
    robot.at(1.5, lambda: robot.meanwhile(lambda board: board.add_servo_parameters([ServoParameter(1, 9)])))
    said = robot("trim", "--set", "1=+90")
    assert said.code == 1
    assert "servo 1 had a correction of 0° at first, and now has 9°; no correction was stored" in said.err
    assert corrections(robot) == {1: 9}


# --- keys ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def types(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Said]:
    """Return a function that runs `servolink trim` and types a text every half second."""

    def run(texts: Sequence[str | Callable[[], object]], *arguments: str) -> Said:
        monkeypatch.setattr(terminal, "single_keys", typing(texts))
        return robot("trim", *arguments)

    monkeypatch.setattr(trim, "can_ask", lambda: True)
    monkeypatch.setattr(trim, "can_draw", lambda: True)
    return run


def test_keys_nudge_undo_and_store(types: Callable[..., Said], robot: Robot) -> None:
    before = angles(robot)
    said = types(["\x1b[C\x1b[C+-", "\x1b[B-", "\x1bOA?", "+", "u", "\r"], "1", "2")
    assert (said.code, said.err) == (0, "")
    assert corrections(robot) == {1: 2, 2: -1}
    assert angles(robot) == [before[0] + 2, before[1] - 1, before[2]]
    assert "the last nudge of servo 1 was taken back" in said.out


def test_keys_nudge_by_five_degrees_too(types: Callable[..., Said], robot: Robot) -> None:
    before = angles(robot)
    said = types(["\x1b[1;2C\x1b[1;2C<", "\x1b[B\x1b[1;2D", ">>", "\r"], "1", "2")
    assert said.code == 0
    assert "left/right or -/+: 1 degree; with Shift, or by < and >: 5 degrees" in said.out
    assert corrections(robot) == {1: 5, 2: 5}
    assert angles(robot) == [before[0] + 5, before[1] + 5, before[2]]


def test_leaving_stores_nothing_and_says_where_the_servo_is(types: Callable[..., Said], robot: Robot) -> None:
    said = types(["+", "+", "q"], "2")
    assert said.code == 0
    assert said.out.splitlines()[-1] == "servo 2 was moved by +2°; no correction was stored"
    assert corrections(robot) == {}
    assert types(["u", "\x1b"]).out.endswith("no servo was moved; no correction was stored\n")
    assert types([""]).code == 0, "the terminal is gone"


def test_a_limit_refuses_a_nudge_and_it_is_not_counted(
    types: Callable[..., Said], robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = angles(robot)[0]
    make = partial(connect, angle_limits=(here - 1, here + 1))
    monkeypatch.setattr("servolink.cli.command_session.connect", make)
    said = types(["+", "+", "\n"], "1")
    assert f"{here + 2} degrees is outside its limits" in said.out
    assert corrections(robot) == {1: 1}


def test_ctrl_c_stops_and_says_what_is_where(types: Callable[..., Said], robot: Robot) -> None:
    said = types(["+", lambda: os.kill(os.getpid(), signal.SIGINT)], "3")
    assert said.code == 130
    assert said.err == (
        "interrupted: servo 3 was moved by +1°; the servos were stopped, and no correction was stored: "
        "all servos report that they are stopped and held\n"
    )
    assert corrections(robot) == {}
    assert not any(servo.is_start for servo in robot.ask(lambda board: board.servos()))


def test_a_lost_board_ends_it(types: Callable[..., Said], robot: Robot) -> None:
    said = types(["+", robot.unplug, "+"], "3")
    assert said.code == 3
    assert "servolink: servo 3 was moved by +1°; no correction was stored" in said.err


@pytest.mark.parametrize(
    ("caption", "table"),
    [
        ("knee", ["   servo  caption  angle  correction", ">      1  knee        2°  2° -> -10°"]),
        ("left knee of it", ["   servo  angle  correction", ">      1     2°  2° -> -10°"]),
    ],
)
def test_at_40_columns_nothing_is_cut_off(caption: str, table: list[str], robot: Robot) -> None:
    async def drawn(board: Board) -> list[str]:
        servos = await board.servos()
        session = TrimSession(board, servos, {1: ServoParameter(1, 2, caption)})
        await session.nudge(1, -12)
        return trim.picture(session, servos, "1 is there: " + "x" * 20 + " and far away", (40, 24))

    lines = robot.ask(drawn)
    assert lines[:2] == table
    assert lines[4:] == [
        "",
        "left/right or -/+: 1 degree; with Shift,",
        "or by < and >: 5 degrees",
        "up/down: servo; u: undo; Enter: store;",
        "q: leave",
        "1 is there: xxxxxxxxxxxxxxxxxxxx and far",
        "away",
    ]


def test_a_terminal_that_cannot_draw_is_refused(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trim, "can_ask", lambda: True)
    monkeypatch.setattr(trim, "can_draw", lambda: False)
    said = robot("trim")
    assert (said.code, said.out) == (2, "")
    assert "use --set SERVO=+N" in said.err


def test_in_a_terminal() -> None:
    said = in_terminal("-b", "virtual://?servos=40", "trim", later=("store; q: leave", "+n-\r"))
    assert said.code == 0
    assert "done, and verified" in said.out
    assert "\x1b[?25h" in said.out, "the cursor is visible again"
