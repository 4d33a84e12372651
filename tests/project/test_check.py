"""What is wrong with a project.

Modules: servolink.project.model, servolink.project.validate.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from msgspec.structs import replace

from servolink.errors import EncodeError
from servolink.project import ProjectFile
from servolink.project.model import UNFINISHED, Project
from servolink.project.validate import Diagnostic, validate_project
from servolink.protocol import (
    RECORD_TYPES,
    Action,
    AddServoParameterRequest,
    Button,
    Codec,
    JoystickTable,
    Macro,
    MacroCommand,
    Packet,
    ServoParameter,
    Step,
)
from tests.project.drawn import projects, said_projects, storable_projects

STEP = Step(1, 30, 50)
WAVE = Action(1, "wave", (STEP, Step(2, -30, 100)))
SHOW = Macro(1, "show", (MacroCommand(1, 0, 50, 2, 4000), MacroCommand(500, 1, total_interval=500)))
TWICE = Macro(2, "twice", (MacroCommand(1, 2, loop=2, total_interval=9000),))
PAD = JoystickTable(1, "pad", (Button(4, "A", 1), Button(5, "B", 0, 0, 2)))
SOUND = Project(7, (ServoParameter(1, -3, "elbow"),), (WAVE,), (SHOW, TWICE), (PAD,), 1)


def said(project: Project, **known: Any) -> list[str]:
    return [f"{'!' if one.severity == 'error' else ''}{one}" for one in validate_project(project, **known)]


def macro(*commands: MacroCommand, macro_id: int = 1) -> Project:
    return Project(actions=(WAVE,), macros=(Macro(macro_id, "m", commands),))


def pad(*buttons: Button) -> Project:
    return Project(actions=(WAVE,), macros=(SHOW,), joystick_tables=(JoystickTable(1, "", buttons),))


def test_a_sound_project_has_no_problems_on_a_board_that_it_fits() -> None:
    assert validate_project(SOUND, servo_ids=[1, 2], speed_cap=60.0, memory=500, start={1: 0, 2: 0}) == []
    assert validate_project(Project()) == []


@pytest.mark.parametrize(
    ("project", "expected"),
    [
        (
            Project(actions=(Action(0),)),
            ["!actions[0].action_id: a record cannot have the id 0, which boards return for missing records"],
        ),
        (Project(actions=(Action(-3),)), ["actions[0].action_id: -3 is negative; boards use ids from 1 on"]),
        (Project(actions=(Action(2), Action(2, "b"))), ["!actions[1].action_id: 2 is also the id of actions[0]"]),
        (
            Project(macros=(Macro(2), Macro(2))),
            ["!macros[1].macro_id: 2 is also the id of macros[0], which is identical"],
        ),
        (
            Project(servo_parameters=(ServoParameter(0, 1), ServoParameter(0, 2))),
            ["!servo_parameters[1].servo_id: 0 is also the id of servo_parameters[0]"],
        ),
        (
            Project(UNFINISHED[5]),
            ["!project_id: 2046820357 means that an import is under way; choose another id, such as 1"],
        ),
        (Project(2**31), ["!project_id: 2147483648 is outside -2147483648..2147483647"]),
        (
            Project(active_joystick_table=3, joystick_tables=(JoystickTable(1), JoystickTable(2))),
            ["!active_joystick_table: there is no joystick table 3"],
        ),
        (
            Project(servo_parameters=(ServoParameter(255, 1),)),
            ["!servo_parameters[0].servo_id: 255 stands for all servos, not for one"],
        ),
        (
            Project(actions=(Action(1, "", (STEP, STEP)),)),
            ["actions[0].steps[1].servo_id: 1 is also in actions[0].steps[0], with the same values"],
        ),
        (
            Project(actions=(Action(1, "", (STEP, Step(2, 0, 0), Step(1, 0, 0))),)),
            ["actions[0].steps[2].servo_id: 1 is also in actions[0].steps[0], and boards differ in the copy used"],
        ),
        (
            pad(Button(4, "", 1), Button(4, "", 1)),
            [
                (
                    "joystick_tables[0].buttons[1].button_id: 4 is also in joystick_tables[0].buttons[0], "
                    "with the same values"
                )
            ],
        ),
        (pad(Button(4, "A")), ["joystick_tables[0].buttons[0]: button 4 starts no macro"]),
        (
            pad(Button(4, "A", 9, -1, 1)),
            [
                "joystick_tables[0].buttons[0].button_press_macro: there is no macro 9",
                "joystick_tables[0].buttons[0].button_long_press_macro: there is no macro -1",
            ],
        ),
        (macro(MacroCommand(9)), ["macros[0].commands[0].action_id: there is no action 9"]),
        (macro(MacroCommand(9, 2)), ["macros[0].commands[0].macro_id: there is no macro 9"]),
        (
            macro(MacroCommand(5, 1, total_interval=5), MacroCommand(1, 2)),
            ["!macros[0].commands[1].macro_id: macro 1 'm' runs itself, so it never ends"],
        ),
        (macro(MacroCommand(5, 7)), ["!macros[0].commands[0].type: must be one of action, delay, macro, not 'other'"]),
        (macro(MacroCommand(-5, 1)), ["!macros[0].commands[0].delay_ms: -5 is outside 0..2147483647"]),
        (macro(MacroCommand(1, 0, 0)), ["!macros[0].commands[0].ratio_percent: 0 is outside 1..100"]),
        (macro(MacroCommand(1, 0, 101)), ["!macros[0].commands[0].ratio_percent: 101 is outside 1..100", "..."]),
        (macro(MacroCommand(1, 0, 1, -1)), ["!macros[0].commands[0].loop: -1 is outside 0..32767"]),
        (
            macro(MacroCommand(1)),
            ["macros[0].commands[0].total_interval_ms: is not given; the command takes 1000 ms"],
        ),
        (
            macro(MacroCommand(1, total_interval=1011)),
            ["macros[0].commands[0].total_interval_ms: is 1011; the command takes 1000 ms"],
        ),
        (macro(MacroCommand(1, total_interval=1010), MacroCommand(1, 0, 1, 1, 101_000)), []),
        (macro(MacroCommand(500, 1, total_interval=510)), []),
        (
            macro(MacroCommand(500, 1, total_interval=489)),
            ["macros[0].commands[0].total_interval_ms: is 489; the command takes 500 ms"],
        ),
        (
            Project(actions=(Action(1, "é" * 17),)),
            [
                f"!actions[0].action_caption: '{'é' * 17}' takes 34 bytes in utf-8; a caption has 0..32 bytes",
            ],
        ),
        (
            Project(servo_parameters=(ServoParameter(1, 0, "\x13L\x05\x1d"),)),
            [
                (
                    "!servo_parameters[0].servo_caption: '\\x13L\\x05\\x1d' holds control characters; "
                    "captions are plain text"
                )
            ],
        ),
        (
            Project(servo_parameters=(ServoParameter(1), ServoParameter(2, 0, "é" * 17))),
            [f"!servo_parameters[1].servo_caption: '{'é' * 17}' takes 34 bytes in utf-8; a caption has 0..32 bytes"],
        ),
        (
            pad(Button(1, "\ud800", 1)),
            ["!joystick_tables[0].buttons[0].button_caption: '\\ud800' cannot be written in utf-8"],
        ),
        (
            Project(actions=(Action(1, "", tuple(Step(one % 256, 0, 0) for one in range(13_100))),)),
            ["!actions[0].steps: 13100 records are outside 0..13099", "..."],
        ),
        (
            Project(actions=tuple(Action(number) for number in range(1, 1822))),
            ["!actions: there are 1,821; a board can list 1,820"],
        ),
        (Project(actions=tuple(Action(number) for number in range(1, 1821))), []),
    ],
)
def test_each_problem_is_said_with_its_place(project: Project, expected: list[str]) -> None:
    if expected[-1:] == ["..."]:
        assert said(project)[: len(expected) - 1] == expected[:-1]
    else:
        assert said(project) == expected


@pytest.mark.parametrize(
    ("calls", "expected"),
    [
        (
            {1: [2], 2: [1]},
            ["!macros[0].commands[0].macro_id: macro 1 '' runs itself (1 -> 2 -> 1), so it never ends"],
        ),
        (
            {5: [4], 4: [3, 2], 3: [], 2: [4]},
            ["!macros[1].commands[1].macro_id: macro 4 '' runs itself (4 -> 2 -> 4), so it never ends"],
        ),
        (
            {1: [1], 2: [3], 3: [2], 4: [1, 2]},
            [
                "!macros[0].commands[0].macro_id: macro 1 '' runs itself, so it never ends",
                "!macros[1].commands[0].macro_id: macro 2 '' runs itself (2 -> 3 -> 2), so it never ends",
            ],
        ),
        (
            {number: [number % 1000 + 1] for number in range(1, 1001)},
            [
                (
                    "!macros[0].commands[0].macro_id: macro 1 '' runs itself "
                    "(1 -> 2 -> 3 -> 4 -> 5 -> 6 -> ... -> 1), so it never ends"
                )
            ],
        ),
        ({1: [2, 3], 2: [4], 3: [4], 4: []}, []),
    ],
)
def test_macros_that_never_end_are_named_with_the_way_round(calls: dict[int, list[int]], expected: list[str]) -> None:
    macros = (Macro(one, "", tuple(MacroCommand(other, 2) for other in called)) for one, called in calls.items())
    assert said(Project(macros=tuple(macros))) == expected


def test_an_endless_macro_that_others_call_is_found_whichever_is_called_first() -> None:
    """Each walk ends in a cycle, and every macro that never ends is on a walk."""
    calls = {1: [2], 2: [3], 3: [2], 4: [3, 4]}
    macros = (Macro(one, "", tuple(MacroCommand(other, 2) for other in called)) for one, called in calls.items())
    assert len(said(Project(macros=tuple(macros)))) == 1  # 4 runs itself too: said when this is put right


def test_macros_that_nest_deeper_than_virtual_boards_play_are_named() -> None:
    macros = tuple(Macro(one, "", (MacroCommand(one - 1, 2 if one > 1 else 1),)) for one in range(1, 41))
    assert not said(Project(macros=macros[:32]))
    assert said(Project(macros=macros)) == [
        "macros[32]: macro 33 '' nests macros 33 levels deep; a virtual board plays 32, other boards may differ"
    ]


def test_servos_are_looked_up_if_it_is_known_which_there_are() -> None:
    assert said(SOUND, servo_ids={2}) == [
        "!servo_parameters[0].servo_id: there is no servo 1",
        "actions[0].steps[0].servo_id: there is no servo 1",
    ]


def test_speeds_are_looked_at_if_there_is_a_cap() -> None:
    assert said(SOUND, speed_cap=50.0) == []
    assert said(SOUND, speed_cap=50.0, start={1: 0, 2: 0}) == [
        "actions[0].steps[0]: step 1 asks servo 1 for 60 degrees/s; its cap is 50"
    ]


def test_memory_is_looked_at_if_it_is_known() -> None:
    size = 35 + 48 + 62 + 50 + 136
    assert said(SOUND, memory=size) == []
    assert said(SOUND, memory=size - 1) == ["!the project takes 331 bytes; the board has 330"]


def test_captions_are_measured_in_the_encoding_of_the_board() -> None:
    project = Project(actions=(Action(1, "肘" * 16),))
    assert said(project, caption_encoding="big5") == []
    assert said(project)[0].endswith("takes 48 bytes in utf-8; a caption has 0..32 bytes")


def test_what_has_one_right_answer_is_called_fixable() -> None:
    project = Project(
        0,
        (ServoParameter(3, 1), ServoParameter(3, 1)),
        (WAVE, Action(2, "", (STEP, STEP)), Action(2, "other", (Step(1, 0, 0), STEP))),
        (Macro(1, "", (MacroCommand(1), MacroCommand(9))), Macro(2, "", (MacroCommand(2, 2),))),
        (PAD,),
        9,
    )
    assert [problem.path for problem in validate_project(project) if problem.fixable] == [
        "servo_parameters[1].servo_id",
        "actions[1].steps[1].servo_id",
        "macros[0].commands[0].total_interval_ms",
        "active_joystick_table",
    ]
    assert not validate_project(Project(joystick_tables=(PAD, replace(PAD, table_id=2)), active_joystick_table=9))[
        -1
    ].fixable
    assert validate_project(Project(active_joystick_table=9))[0].fixable


def test_problems_come_in_the_order_of_the_file() -> None:
    project = Project(
        actions=(Action(0), *(Action(number) for number in range(1, 11)), Action(0, "x")),
        macros=(Macro(0),),
        joystick_tables=(JoystickTable(0),),
        active_joystick_table=1,
    )
    assert [problem.path for problem in validate_project(project, memory=1)] == [
        "",
        "actions[0].action_id",
        "actions[11].action_id",
        "actions[11].action_id",
        "macros[0].macro_id",
        "joystick_tables[0].table_id",
        "active_joystick_table",
    ]


@pytest.mark.parametrize(
    ("project", "expected"),
    [
        (Project(actions=(Action(1, "", (5,)),)), "actions[0].steps[0]: must be an object, not 5"),  # type: ignore[arg-type]
        (Project(actions=(Action(1, "", None),)), "actions[0].steps: must be a list, not null"),  # type: ignore[arg-type]
        (Project(actions=(Action("1"),)), "actions[0].action_id: must be an integer, not '1'"),  # type: ignore[arg-type]
        (Project(actions=(Action(1, "", (Step(1, 2**40, 0),)),)), "... is outside -32768..32767"),
        (Project(actions=(STEP,)), "... is not a field; the fields are action_id, action_caption, steps"),  # type: ignore[arg-type]
        (Project("7"), "project_id: must be an integer, not '7'"),  # type: ignore[arg-type]
    ],
)
def test_what_is_of_no_type_of_a_project_is_the_one_problem(project: Project, expected: str) -> None:
    (problem,) = validate_project(project)
    assert problem.severity == "error"
    assert str(problem).endswith(expected.removeprefix("..."))


@given(storable_projects)
def test_what_can_be_stored_has_no_errors_but_macros_that_never_end(project: Project) -> None:
    errors = [problem for problem in validate_project(project) if problem.severity == "error"]
    assert all("never ends" in problem.text for problem in errors)
    assert unencodable(project) == ""


@given(projects)
def test_without_an_error_the_encoder_and_the_file_take_everything(project: Project) -> None:
    if not any(problem.severity == "error" for problem in validate_project(project)):
        assert ProjectFile.parse(ProjectFile(project).text()).project == project.sorted()
        assert unencodable(project) == ""


@given(said_projects())
def test_what_the_encoder_refuses_is_an_error(project: Project) -> None:
    found = validate_project(project, servo_ids=(), speed_cap=1e-9, memory=0, start=dict.fromkeys(range(256), 0))
    assert any(problem.severity == "error" for problem in found) or not unencodable(project)
    assert all(within(project, problem) for problem in found)


def unencodable(project: Project) -> str:
    """Return what the encoder has against a project."""
    requests: list[Packet] = [AddServoParameterRequest(project.servo_parameters)]
    requests += [kind.add(record) for kind in RECORD_TYPES for record in getattr(project, kind.field)]
    for request in requests:
        try:
            Codec().encode(request)
        except EncodeError as error:
            return str(error)
    return ""


def within(project: Project, problem: Diagnostic) -> bool:
    """Return whether the place of a problem is one."""
    place = problem.path.partition("[")[0]
    return place == "" or hasattr(project, place)
