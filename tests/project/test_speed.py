"""How fast servos would have to be."""

from __future__ import annotations

import math

from servolink.project.model import Project
from servolink.project.speed import ServoMove, servo_moves
from servolink.protocol import Action, Macro, MacroCommand, Step

UP = Action(1, "up", (Step(1, 90, 50), Step(2, 45, 100)))
DOWN = Action(2, "down", (Step(1, -90, 100),))
ACTIONS = (UP, DOWN)


def found(*macros: Macro, start: dict[int, int] | None = None) -> list[tuple[str, int, int, float]]:
    """Return place, servo, degree before and speed of each move."""
    project = Project(actions=ACTIONS, macros=macros)
    return [
        (move.path, move.step.servo_id, move.start, move.degrees_per_second) for move in servo_moves(project, start)
    ]


def test_nothing_is_known_of_an_action_alone_unless_it_is_known_where_it_starts() -> None:
    assert found() == []
    assert found(start={2: 0}) == [("actions[0].steps[1]", 2, 0, 45.0)]
    assert found(start={1: 0, 9: 0}) == [("actions[0].steps[0]", 1, 0, 180.0), ("actions[1].steps[0]", 1, 0, 90.0)]


def test_in_a_macro_each_command_starts_where_those_before_it_end() -> None:
    wave = Macro(1, "", (MacroCommand(1), MacroCommand(500, 1), MacroCommand(2), MacroCommand(1, 0, 50)))
    assert found(wave) == [
        ("macros[0].commands[2]", 1, 90, 180.0),
        ("macros[0].commands[3]", 1, -90, 180.0),
        ("macros[0].commands[3]", 2, 45, 0.0),
    ]


def test_a_macro_that_is_called_starts_and_repeats_where_it_is_called() -> None:
    bend = Macro(5, "", (MacroCommand(1), MacroCommand(2)))
    whole = Macro(4, "", (MacroCommand(2), MacroCommand(5, 2, 25, 1000)))
    assert found(whole, bend) == [
        ("macros[1].commands[1]", 1, 90, 180.0),
        ("macros[0].commands[1]", 1, -90, 90.0),
        ("macros[0].commands[1]", 1, -90, 90.0),
        ("macros[0].commands[1]", 2, 45, 0.0),
    ]


def test_ratios_multiply() -> None:
    bend = Macro(5, "", (MacroCommand(1, 0, 50),))
    assert found(Macro(4, "", (MacroCommand(2), MacroCommand(5, 2, 50))), bend) == [
        ("macros[0].commands[1]", 1, -90, 90.0)
    ]


def test_the_last_of_two_steps_for_one_servo_counts() -> None:
    twice = Action(3, "", (Step(1, 0, 1), Step(1, 10, 100)))
    (move,) = servo_moves(Project(actions=(twice,)), {1: 0})
    assert (move.path, move.degrees_per_second) == ("actions[0].steps[1]", 10.0)


def test_what_takes_no_time_is_infinitely_fast_if_there_is_a_way() -> None:
    jump = Action(3, "", (Step(1, 10, 0), Step(2, 0, 0), Step(3, 10, -1)))
    moves = servo_moves(Project(actions=(jump,)), {1: 0, 2: 0, 3: 0})
    speeds = {move.step.servo_id: move.degrees_per_second for move in moves}
    assert speeds == {1: math.inf, 2: 0.0, 3: math.inf}


def test_what_is_not_played_has_no_speed() -> None:
    nothing = (
        MacroCommand(1, 0, 0),
        MacroCommand(1, 0, 100, 0),
        MacroCommand(9),
        MacroCommand(9, 2),
        MacroCommand(1, 7),
    )
    assert found(Macro(1, "", (*nothing, MacroCommand(2)))) == []
    assert found(Macro(1, "", (MacroCommand(1), MacroCommand(1, 2)))) == []


def test_a_turn_says_what_it_asks_for() -> None:
    assert str(ServoMove("actions[0].steps[0]", UP, 0, 245, 0.5)) == "step 1 asks servo 1 for 310 degrees/s"
    assert str(ServoMove("actions[0].steps[1]", UP, 1, 0, 0)) == "step 2 asks servo 2 to turn in no time"
    said = "action 1 'up', step 1 asks servo 1 for 180 degrees/s"
    assert str(ServoMove("macros[0].commands[1]", UP, 0, 0, 0.5)) == said


def test_macros_that_call_each_other_a_thousand_deep_are_looked_at_once_each() -> None:
    deep = [Macro(number, "", (MacroCommand(number + 1, 2, 100, 2),)) for number in range(1, 1000)]
    bend = Macro(1000, "", (MacroCommand(1), MacroCommand(2)))
    assert len(found(*deep, bend)) == 1 + 999 * 2
