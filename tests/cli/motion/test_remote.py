"""`servolink remote`: keys press the buttons of a joystick table."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import pytest

from servolink.cli.motion import remote
from servolink.cli.motion.remote import RemoteControl
from servolink.cli.screen import terminal
from servolink.client import Board
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, MacroCommandType, Step
from tests.cli.programs import Said, in_terminal
from tests.cli.robot import Robot, typing

WAVE, DANCE, REST, ENDLESS = 1, 2, 3, 4
BUTTONS = (
    Button(7, "A", WAVE, DANCE, REST, uninterruptible=1),
    Button(8, "B", WAVE, DANCE, REST),
    Button(9, "C", 0, ENDLESS, REST, uninterruptible=1),
    Button(10, "D", 99, 0, 0),
)


async def store(board: Board) -> None:
    """Store macros of 1 s and of 2 s, and one that never ends."""
    await board.add_action(Action(1, "Up", (Step(1, 40, 100),)))
    await board.add_action(Action(2, "Down", (Step(1, -40, 200),)))
    for number, caption, action in ((WAVE, "Wave", 1), (DANCE, "Dance", 2), (REST, "Rest", 1)):
        await board.add_macro(Macro(number, caption, (MacroCommand(action, MacroCommandType.ACTION),)))
    await board.add_macro(Macro(ENDLESS, "Endless", (MacroCommand(ENDLESS, MacroCommandType.MACRO),)))
    await board.add_joystick_table(JoystickTable(1, "Pad", BUTTONS))
    await board.add_joystick_table(JoystickTable(2, "Other", (Button(3, "", REST),)))
    await board.set_active_joystick_table(1)


class Runs(list[tuple[float, int]]):
    """The macros that were run, and seconds since the first."""

    def add(self, macro_id: int) -> None:
        now = asyncio.get_running_loop().time()
        self.append((now, macro_id))

    @property
    def seconds(self) -> list[tuple[float, int]]:
        """Since the first of them."""
        return [(round(at - self[0][0], 1), macro_id) for at, macro_id in self]


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> Runs:
    done, run_macro = Runs(), Board.run_macro

    async def noted(self: Board, macro_id: int, *, wait: bool = False, dry_run: bool = False) -> None:
        await run_macro(self, macro_id, wait=wait, dry_run=dry_run)
        done.add(macro_id)

    monkeypatch.setattr(Board, "run_macro", noted)
    return done


@pytest.fixture
def types(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Said]:
    """Return a function that runs `servolink remote` and types a text every half second."""

    def run(texts: Sequence[str | Callable[[], object]], *arguments: str) -> Said:
        monkeypatch.setattr(terminal, "single_keys", typing(texts))
        return robot("remote", *arguments)

    monkeypatch.setattr(remote, "can_ask", lambda: True)
    monkeypatch.setattr(remote, "is_terminal", lambda: True)
    robot.ask(store)
    return run


def test_the_mapping_is_shown_before_anything_moves(types: Callable[..., Said], runs: Runs) -> None:
    said = types(["q"])
    assert (said.code, said.err, runs) == (0, "", [])
    lines = said.out.splitlines()
    assert lines[0] == "joystick table 1 'Pad'"
    assert lines[2].split() == ["a", "7", "A", "1", "Wave", "2", "Dance", "3", "Rest", "yes"]
    assert lines[5].split() == ["d", "10", "D", "99", "(missing)"]
    assert lines[6].startswith("letter: tap; with Shift: hold until the next tap")


def test_captions_of_a_hostile_board_are_shown_as_text(
    types: Callable[..., Said], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def hostile(self: Board, table_id: int) -> JoystickTable:
        return JoystickTable(table_id, "x\x1b[2J", (Button(1, "y\x9b1m", WAVE),))

    monkeypatch.setattr(Board, "joystick_table", hostile)
    said = types(["q"])
    assert said.out.startswith("joystick table 1 'x\\x1b[2J'\n")
    assert "y\\x9b1m" in said.out


def test_a_tap_is_press_and_release(types: Callable[..., Said], runs: Runs) -> None:
    said = types(["a", "z?\x1b[A", "d", "q"])
    assert runs.seconds == [(0.0, WAVE), (0.1, REST)]
    assert "button 7 pressed: macro 1; released: macro 3" in said.out
    assert "button 10 pressed: macro 99 is not on the board; released: no macro" in said.out


def test_a_long_press_lasts_until_the_next_tap(types: Callable[..., Said], runs: Runs) -> None:
    types(["B", "b", "?", "b", "\x1b"])
    assert runs.seconds == [(0.0, WAVE), (0.8, DANCE), (0.8, REST), (1.5, WAVE), (1.6, REST)]


def test_an_uninterruptible_one_ends_before_the_macro_for_up(types: Callable[..., Said], runs: Runs) -> None:
    said = types(["A", "a", "?", "?", "?", "?", "q"])
    assert runs.seconds == [(0.0, WAVE), (0.8, DANCE), (2.8, REST)]
    assert "button 7 released: macro 3 waits for the end of macro 2" in said.out


def test_another_button_takes_the_place_of_what_waits(types: Callable[..., Said], runs: Runs) -> None:
    types(["A", "ab", *"??????", "q"])
    assert runs.seconds == [(0.0, WAVE), (0.8, DANCE), (0.8, WAVE), (0.9, REST)]


def test_a_refusal_ends_nothing(types: Callable[..., Said], runs: Runs) -> None:
    said = types(["C", "c", "a", "q"])
    assert "refused: " in said.out, "the virtual board runs no macro that runs itself"
    assert "button 9 pressed: no macro; held: macro 4 was refused: " in said.out
    assert [macro_id for _, macro_id in runs] == [REST, WAVE, REST]


def test_a_macro_that_never_ends_is_not_interrupted_for_the_one_for_up(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def run_macro(self: Board, macro_id: int) -> None:
        assert macro_id == ENDLESS

    async def hold(board: Board) -> str:
        control = RemoteControl(board, JoystickTable(1, "", BUTTONS), {ENDLESS: None, REST: 1.0})
        await control.press("C")
        return await control.press("c")

    monkeypatch.setattr(Board, "run_macro", run_macro)
    assert robot.ask(hold) == "button 9 released: macro 4 never ends, and nothing interrupts it for macro 3"


def test_limits_hold(types: Callable[..., Said], runs: Runs, robot: Robot) -> None:
    said = types(["a", "q"], "--limit", "-10", "10")
    assert (said.code, runs) == (0, [])
    assert "refused: " in said.out
    assert "limits are -10..10" in said.out


def test_another_table(types: Callable[..., Said], runs: Runs) -> None:
    assert types(["a", "q"], "--table", "Other").code == 0
    assert [macro_id for _, macro_id in runs] == [REST]
    said = types(["q"], "--table", "9")
    assert (said.code, "joystick table 9" in said.err) == (1, True)


def test_space_stops_at_once_what_runs_and_what_waits(types: Callable[..., Said], runs: Runs, robot: Robot) -> None:
    said = types(["A", "?", "a ", "q"])
    assert said.code == 0
    assert [macro_id for _, macro_id in runs] == [WAVE, DANCE]
    assert "all servos are stopped and held: `servolink servo start all` starts them" in said.out
    assert not any(servo.is_start for servo in robot.ask(lambda board: board.servos()))


@pytest.mark.usefixtures("types")
@pytest.mark.parametrize("turns", range(8))
def test_space_stops_although_a_tap_has_just_ended_and_another_waits(
    turns: int, robot: Robot, runs: Runs, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Python 3.11 `asyncio.wait_for` ignores a cancellation that comes with its result, and no stop was sent."""

    def later(turns: int, act: Callable[[], object]) -> None:
        if turns:
            asyncio.get_running_loop().call_soon(later, turns - 1, act)
        else:
            act()

    @contextmanager
    def keys(typed: Callable[[str], None]) -> Iterator[bool]:
        def hurried() -> None:
            typed("dd")
            asyncio.get_running_loop().call_later(0.1, later, turns, lambda: typed(" "))

        with typing(["A", "?", "a", hurried, "q"])(typed) as keyboard:
            yield keyboard

    monkeypatch.setattr(terminal, "single_keys", keys)
    said = robot("remote")
    assert said.code == 0
    assert "macro 3 waits for the end of macro 2" in said.out
    assert [macro_id for _, macro_id in runs] == [WAVE, DANCE]
    assert "all servos are stopped and held" in said.out
    assert not any(servo.is_start for servo in robot.ask(lambda board: board.servos()))


def test_space_and_the_end_keep_a_long_press_from_running_its_macro(types: Callable[..., Said], runs: Runs) -> None:
    for keys in (["A", " ", "?", "?", "q"], ["A", "q"]):
        assert types(keys).code == 0
    assert [macro_id for _, macro_id in runs] == [WAVE, WAVE]


def test_a_long_press_runs_what_a_board_runs(robot: Robot, types: Callable[..., Said], runs: Runs) -> None:
    ran: list[int] = []

    async def held(board: Board) -> None:
        await board.set_servo(255, start=True, hold=True)
        robot.board.press_button(8, asyncio.get_running_loop().time())
        for _ in range(20):
            await asyncio.sleep(0.1)
            robot.board.advance(asyncio.get_running_loop().time())
            ran.append(robot.board.player.macro_id)

    robot.ask(held)
    types(["B", "?", "?", "q"])
    assert [*dict.fromkeys(ran)] == [WAVE, DANCE] == [macro_id for _, macro_id in runs]
    assert ran.count(WAVE) == pytest.approx(8, abs=1) == 10 * runs.seconds[1][0]


def test_tab_gives_the_keys_to_further_buttons(
    types: Callable[..., Said], runs: Runs, monkeypatch: pytest.MonkeyPatch
) -> None:
    buttons = (*(Button(number, "", WAVE) for number in range(1, 52)),)

    async def large(self: Board, table_id: int) -> JoystickTable:
        return JoystickTable(table_id, "Large", buttons)

    monkeypatch.setattr(Board, "joystick_table", large)
    said = types(["z", "A\ta", "\tb", "\tA", "a", "q"])
    assert [line for line in said.out.splitlines() if line.startswith(("joystick", "button", "Tab"))] == [
        "joystick table 1 'Large', page 1 of 3",
        "Tab: keys for the next buttons",
        "button 25 pressed: macro 1; released: no macro",
        "button 1 pressed: macro 1; held: no macro; the next tap releases it",
        "joystick table 1 'Large', page 2 of 3",
        "button 26 pressed: macro 1; released: no macro",
        "joystick table 1 'Large', page 3 of 3",
        "joystick table 1 'Large', page 1 of 3",
        "button 1 released: no macro",
        "button 1 pressed: macro 1; released: no macro",
    ]


def test_ctrl_c_stops_and_says_so(types: Callable[..., Said], robot: Robot) -> None:
    said = types(["B", lambda: os.kill(os.getpid(), signal.SIGINT)])
    assert said.code == 130
    assert said.err == ("interrupted: the remote control was ended: all servos report that they are stopped and held\n")
    assert not any(servo.is_start for servo in robot.ask(lambda board: board.servos()))


def test_a_lost_board_ends_it(types: Callable[..., Said], robot: Robot) -> None:
    said = types(["b", robot.unplug, "b"])
    assert said.code == 3
    assert "is gone" in said.err


def test_without_a_terminal_or_a_table_it_is_refused(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    said = robot("remote")
    assert said.code == 2
    assert "buttons are pressed by keys, which needs a terminal" in " ".join(said.err.split())
    for name in ("can_ask", "is_terminal"):
        monkeypatch.setattr(remote, name, lambda: True)
    said = robot("remote")
    assert said.code == 1
    assert "the board has no active joystick table" in said.err


def test_in_a_terminal() -> None:
    said = in_terminal("-b", "virtual://", "remote")
    assert said.code == 1
    assert "the board has no active joystick table" in said.out
