"""The project file: what it looks like, that nothing is lost in it, and what is said of a wrong one.

Modules: servolink.support.json_text, servolink.project.project_file, servolink.project.single_record.
"""

from __future__ import annotations

import json
import os
import sys
import tracemalloc
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servolink.errors import ProjectError, escape
from servolink.project import ProjectFile, project_file
from servolink.project.model import Project
from servolink.project.project_file import load_project, save_project
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step
from servolink.support import MAX_SIZE
from tests.project.drawn import projects, said_projects
from tests.proofs.fuzz.amounts import MANY

ROBOT = Project(
    7,
    (ServoParameter(2, -3, "right elbow"), ServoParameter(1, 4, "左肘")),
    (
        Action(2, "down", (Step(1, 0, 50),)),
        Action(1, "up", (Step(1, 90, 100), Step(2, -90, 50))),
    ),
    (
        Macro(
            5,
            "wave",
            (MacroCommand(1, 0, 50, 2, 4000), MacroCommand(250, 1, total_interval=250), MacroCommand(6, 2)),
        ),
    ),
    (JoystickTable(1, "pad", (Button(4, "A", 5), Button(5, "B", 0, 5, 5, uninterruptible=1))),),
    1,
)
TEXT = """\
{
  "schema": 1,
  "project_id": 7,
  "servo_parameters": [
    {"servo_id": 1, "adjusted_degree": 4, "servo_caption": "左肘"},
    {"servo_id": 2, "adjusted_degree": -3, "servo_caption": "right elbow"}
  ],
  "actions": [
    {
      "action_id": 1,
      "action_caption": "up",
      "steps": [
        {"servo_id": 1, "degree": 90, "interval_ms": 1000},
        {"servo_id": 2, "degree": -90, "interval_ms": 500}
      ]
    },
    {
      "action_id": 2,
      "action_caption": "down",
      "steps": [
        {"servo_id": 1, "degree": 0, "interval_ms": 500}
      ]
    }
  ],
  "macros": [
    {
      "macro_id": 5,
      "macro_caption": "wave",
      "commands": [
        {"type": "action", "action_id": 1, "ratio_percent": 50, "loop": 2, "total_interval_ms": 4000},
        {"type": "delay", "delay_ms": 250, "ratio_percent": 100, "loop": 1, "total_interval_ms": 250},
        {"type": "macro", "macro_id": 6, "ratio_percent": 100, "loop": 1, "total_interval_ms": 0}
      ]
    }
  ],
  "joystick_tables": [
    {
      "table_id": 1,
      "table_caption": "pad",
      "buttons": [
        {"button_id": 4, "button_caption": "A", "button_press_macro": 5, "button_long_press_macro": 0, \
"button_up_macro": 0, "uninterruptible": 0},
        {"button_id": 5, "button_caption": "B", "button_press_macro": 0, "button_long_press_macro": 5, \
"button_up_macro": 5, "uninterruptible": 1}
      ]
    }
  ],
  "active_joystick_table": 1
}
"""


def refusal(text: str, *, unchecked: bool = False) -> str:
    """Return what is said of a file, empty if it is taken."""
    try:
        ProjectFile.parse(text, unchecked=unchecked)
    except ProjectError as error:
        return str(error)
    return ""


def test_a_file_is_in_order_and_has_a_step_a_line() -> None:
    assert ProjectFile(ROBOT).text() == TEXT
    assert ProjectFile.parse(TEXT).project == ROBOT.sorted()


def test_what_is_left_out_is_as_in_a_new_project() -> None:
    assert ProjectFile.parse('{"schema": 1}').project == Project()
    written = (
        '{"$schema": "x.json", "schema": 1, "actions": [{"action_id": 3}], "macros": [{"macro_id": 4, "commands": '
    )
    written += '[{"type": "delay", "delay_ms": 5}]}]}'
    assert ProjectFile.parse(written).project == Project(
        actions=(Action(3),), macros=(Macro(4, "", (MacroCommand(5, 1),)),)
    )


def test_reading_keeps_the_order_of_the_file() -> None:
    written = '{"schema": 1, "actions": [{"action_id": 2}, {"action_id": 1}, {"action_id": 2}]}'
    assert [action.action_id for action in ProjectFile.parse(written).project.actions] == [2, 1, 2]


@given(projects)
def test_every_project_comes_back(project: Project) -> None:
    assert ProjectFile.parse(ProjectFile(project).text()).project == project.sorted()


@given(said_projects())
@settings(max_examples=20 * MANY)
def test_whatever_a_board_says_comes_back_from_text_that_can_be_shown(project: Project) -> None:
    text = ProjectFile(project).text()
    assert ProjectFile.parse(text, unchecked=True).project == project.sorted()
    assert all(escape(line) == line for line in text.split("\n"))
    assert ProjectFile.parse(text.encode(), unchecked=True).project == project.sorted()


@given(said_projects())
def test_what_this_library_would_not_say_is_refused_with_its_place(project: Project) -> None:
    said = refusal(ProjectFile(project).text())
    assert said == "" or said.startswith(("servo_parameters[", "actions[", "macros[", "joystick_tables["))


def test_characters_that_hide_or_turn_text_are_escaped() -> None:
    written = ProjectFile(Project(actions=(Action(1, "a\x1b[2J\u202eb\udcff\U000e0041\x7f\u200d"),))).text()
    assert r'"a\u001b[2J\u202eb\udcff\udb40\udc41\u007f' + '\u200d"' in written


def test_a_type_of_command_that_nobody_knows_is_kept_as_a_number_for_backups_only() -> None:
    project = Project(macros=(Macro(1, "", (MacroCommand(-5, 7, 0, -1, -2),)),))
    text = ProjectFile(project).text()
    line = (
        '{"type": "other", "type_number": 7, "command_id": -5, "ratio_percent": 0, "loop": -1, "total_interval_ms": -2}'
    )
    assert line in text
    assert ProjectFile.parse(text, unchecked=True).project == project
    with pytest.raises(
        ProjectError, match=r"^macros\[0\].commands\[0\].type: must be one of action, delay, macro, not 'other'$"
    ):
        ProjectFile.parse(text)


ACTIONS = '"actions": [{{"action_id": 1}}, {{"action_id": 2, "steps": [{}]}}]'
STEP = '{"servo_id": 1, "degree": 2, "interval_ms": 30}'
MACROS = '"macros": [{{"macro_id": 1, "commands": [{}]}}]'


def replaced(old: str, new: str) -> str:
    """Return the actions with the second one's second step changed."""
    return ACTIONS.format(f"{STEP}, {STEP.replace(old, new)}")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (replaced("2", "40000"), "actions[1].steps[1].degree: 40000 is outside -32768..32767"),
        (replaced("2", "-32769"), "actions[1].steps[1].degree: -32769 is outside -32768..32767"),
        (replaced("2", "9" * 70), f"actions[1].steps[1].degree: {'9' * 70} is outside -32768..32767"),
        (replaced("1", "256"), "actions[1].steps[1].servo_id: 256 is outside 0..255"),
        (replaced("2", "2.0"), "actions[1].steps[1].degree: must be an integer, not 2.0"),
        (replaced("2", "true"), "actions[1].steps[1].degree: must be an integer, not true"),
        (replaced("2", '"2"'), "actions[1].steps[1].degree: must be an integer, not '2'"),
        (replaced("2", "null"), "actions[1].steps[1].degree: must be an integer, not null"),
        (
            replaced("30", "35"),
            "actions[1].steps[1].interval_ms: must be a multiple of 10, the unit in which boards count, not 35",
        ),
        (replaced("30", "327680"), "actions[1].steps[1].interval_ms: 327680 is outside 0..327670"),
        (replaced("30", "-10"), "actions[1].steps[1].interval_ms: -10 is outside 0..327670"),
        (replaced(', "interval_ms": 30', ""), "actions[1].steps[1]: 'interval_ms' is missing"),
        (replaced(', "degree": 2, "interval_ms": 30', ""), "actions[1].steps[1]: 'degree', 'interval_ms' are missing"),
        (
            replaced("_ms", ""),
            "actions[1].steps[1]: 'interval' is not a field; the fields are servo_id, degree, interval_ms",
        ),
        (replaced("degree", "servo_id"), "actions[1].steps[1]: 'servo_id' is a duplicate key; keep one entry"),
        (ACTIONS.format("[]"), "actions[1].steps[0]: must be an object, not []"),
        ('"actions": {}', "actions: must be a list, not {}"),
        ('"actions": [{"action_id": 1, "action_caption": 5}]', "actions[0].action_caption: must be text, not 5"),
        (
            '"actions": [{"action_id": 1, "action_caption": "a\\n"}]',
            "actions[0].action_caption: 'a\\n' holds control characters; captions are plain text",
        ),
        (
            f'"actions": [{{"action_id": 1, "action_caption": "{"é" * 33}"}}]',
            f"actions[0].action_caption: '{'é' * 33}' has 33 characters; a caption has at most 32 bytes",
        ),
        (MACROS.format("{}"), 'macros[0].commands[0]: "type" is missing; it must be one of action, delay, macro'),
        (MACROS.format('{"type": 1}'), "macros[0].commands[0].type: must be one of action, delay, macro, not 1"),
        (
            MACROS.format('{"type": ["x"]}'),
            "macros[0].commands[0].type: must be one of action, delay, macro, not ['x']",
        ),
        (MACROS.format("7"), "macros[0].commands[0]: must be an object, not 7"),
        (
            MACROS.format('{"type": "delay", "delay_ms": -1}'),
            "macros[0].commands[0].delay_ms: -1 is outside 0..2147483647",
        ),
        (
            MACROS.format('{"type": "macro", "action_id": 1}'),
            "macros[0].commands[0]: 'action_id' is not a field; the fields are type, macro_id, ratio_percent, ...",
        ),
        (
            MACROS.format('{"type": "action", "action_id": 1, "ratio_percent": 0}'),
            "macros[0].commands[0].ratio_percent: 0 is outside 1..100",
        ),
        ('"active_joystick_table": "pad"', "active_joystick_table: must be an integer or null, not 'pad'"),
        ('"active_joystick_table": 4294967296', "active_joystick_table: 4294967296 is outside -2147483648..2147483647"),
        (
            '"action": []',
            "'action' is not a field; the fields are schema, $schema, values, figure, blocks, ...",
        ),
        ('"$schema": 1', "$schema: must be text, not 1"),
        ('"\\u001b[2J": 1', "'\\x1b[2J' is not a field; the fields are schema, ..."),
        ('"\\ud800": 1', "'\ufffd' is not a field; the fields are schema, ..."),
        (
            MACROS.format('{"type": "\\udc00"}'),
            "macros[0].commands[0].type: must be one of action, delay, macro, not '\ufffd'",
        ),
        ('"project_id": 1, "x": {"y": [0, {"z": 1, "z": 2}]}', "x.y[1]: 'z' is a duplicate key; keep one entry"),
        ('"x": {"z": 1, "z": {"y": 1, "y": 2}}', "x: 'z' is a duplicate key; keep one entry"),
        (f'"{"x" * 300}": [{{"z": 1, "z": 2}}]', f"{'x' * 197}...: 'z' is a duplicate key; keep one entry"),
    ],
)
def test_what_is_wrong_is_said_with_its_place_and_what_it_should_be(fields: str, said: str) -> None:
    with pytest.raises(ProjectError) as caught:
        ProjectFile.parse(f'{{"schema": 1, {fields}}}')
    if said.endswith("..."):
        assert str(caught.value).startswith(said[:-3])
    else:
        assert str(caught.value) == said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is not JSON: Expecting value in line 1, column 1; correct the text there"),
        ('{"schema": 1,\n  "actions": [}', "is not JSON: Expecting value in line 2, column 15; correct the text there"),
        ("[1]", "is not a project file: a JSON object is needed, not [1]"),
        ("null", "is not a project file: a JSON object is needed, not null"),
        ("{}", '"schema" is missing; a project file begins with "schema": 1'),
        ('{"schema": 2, "new": 1}', "schema: 2 is newer than 1, the newest this servolink reads; update servolink"),
        ('{"schema": 0}', "schema: must be 1, the version of the format, not 0"),
        ('{"schema": "1"}', "schema: must be 1, the version of the format, not '1'"),
        ('{"schema": true}', "schema: must be 1, the version of the format, not true"),
        ('{"schema": 1, "schema": 1}', "'schema' is a duplicate key; keep one entry"),
        ('{"schema": NaN}', "is not JSON: NaN is not a number"),
        ('{"schema": ' + "1" * 5000, "contains an integer of thousands of digits"),
        ("[" * 200_000, "is nested too deeply"),
        (b'{"schema": "\xe9"}', "is not text in UTF-8 (byte 12); save the file as UTF-8"),
        (b"\xff\xfe{\0}\0", "is not text in UTF-8 (byte 0); save the file as UTF-8"),
        (b" " * (MAX_SIZE + 1), "is larger than 16 MiB, the limit"),
    ],
    ids=lambda value: str(value[:20]),
)
def test_what_is_no_project_file_is_told_from_one(text: str | bytes, said: str) -> None:
    with pytest.raises(ProjectError) as caught:
        ProjectFile.parse(text)
    assert str(caught.value) == said


def test_a_path_takes_memory_for_one_place_only() -> None:
    text = f'{{"{"k" * 20_000}": [{{"a": 1, "a": 1}}{", [], {}" * 2000}]}}'
    tracemalloc.start()
    try:
        with pytest.raises(ProjectError, match="is a duplicate key"):
            ProjectFile.parse(text)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 5_000_000


_nonsense = st.recursive(
    st.sampled_from((None, True, 0, -1, 2**70, 0.5, "action", "delay", "\udc00", "\x1b")) | st.text(st.characters()),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(st.characters(), max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)


@given(st.data(), _nonsense, st.booleans())
@settings(max_examples=30 * MANY)
def test_nonsense_in_any_place_gives_one_clear_error(data: st.DataObject, nonsense: Any, unchecked: bool) -> None:
    said = place = json.loads(TEXT)
    while True:
        key = data.draw(st.sampled_from(list(place) if isinstance(place, dict) else range(len(place))))
        if not isinstance(place[key], (dict, list)) or data.draw(st.booleans()):
            break
        place = place[key]
    place[key] = nonsense
    message = refusal(json.dumps(said), unchecked=unchecked)
    assert escape(message) == message
    assert len(message) < 400
    assert not any(word in message for word in ("Expected", "Object", "Invalid"))  # msgspec's


def test_a_saved_project_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "robot.servolink.json"
    save_project(path, ROBOT)
    assert path.read_bytes() == TEXT.encode()
    assert load_project(path) == ROBOT.sorted()
    save_project(path, Project())
    assert load_project(path) == Project()
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_from_an_editor_that_marks_utf_8_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "robot.json"
    path.write_text(TEXT, encoding="utf-8-sig")
    assert load_project(path) == ROBOT.sorted()


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("none.json", None, "none.json: cannot be read: No such file or directory"),
        ("", None, ": cannot be read: Is a directory"),
        ("a\0b", None, "a\\x00b: cannot be read: "),
        ("a\x1b.json", b"{", "a\\x1b.json: is not JSON: "),
        (
            "x.json",
            TEXT.replace(": 90", ": 40000").encode(),
            "x.json: actions[0].steps[0].degree: 40000 is outside -32768..32767",
        ),
    ],
)
def test_the_file_stands_in_front_of_what_is_wrong_with_it(
    tmp_path: Path, name: str, content: bytes | None, said: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(ProjectError) as caught:
        load_project(tmp_path / name)
    assert str(caught.value).removeprefix(str(tmp_path)).removeprefix("/").startswith(said)


@pytest.mark.skipif(sys.platform == "win32", reason="there is no such device")
def test_a_file_without_end_is_not_read_to_its_end() -> None:
    with pytest.raises(ProjectError, match=r"^/dev/zero: cannot be read: is not a regular file$"):
        load_project(Path("/dev/zero"))


def test_what_cannot_be_written_is_said_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"none/x.json: cannot be written: No such file or directory$"):
        save_project(tmp_path / "none" / "x.json", ROBOT)
    (tmp_path / "folder").mkdir()
    with pytest.raises(ProjectError, match=r"folder: cannot be written: Is a directory$"):
        save_project(tmp_path / "folder", ROBOT)
    assert list(tmp_path.iterdir()) == [tmp_path / "folder"]


def test_no_file_is_written_that_could_not_be_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(project_file, "MAX_SIZE", 1 << 20)
    large = Project(actions=(Action(1, "", (Step(1, -30000, 30000),) * 20_000),))
    with pytest.raises(ProjectError, match=r"x.json: would be larger than 1 MiB, the limit for reading$"):
        save_project(tmp_path / "x.json", large)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("action", "said"),
    [
        (Action(1, "a", (Step(1, 12.5, 50),)), "steps[0].degree: must be an integer, not 12.5"),  # type: ignore[arg-type]
        (Action(1, "a", (Step(300, 0, 1),)), "steps[0].servo_id: 300 is outside 0..255"),
        (Action(1, "a", (Step(1, 0, -5),)), "steps[0].interval_ms: -50 is outside 0..327670"),
        (Action(1, 40 * "x"), f"action_caption: '{40 * 'x'}' has 40 characters; a caption has at most 32 bytes"),
    ],
)
def test_a_good_file_is_not_replaced_by_one_that_cannot_be_loaded(action: Action, said: str, tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    save_project(path, ROBOT)
    with pytest.raises(ProjectError) as caught:
        save_project(path, Project(1, actions=(action,)))
    why = "was not written, because loading the text again would fail"
    assert str(caught.value) == f"{path}: {why}: actions[0].{said}"
    assert load_project(path) == ROBOT.sorted()


def test_a_path_may_be_text(tmp_path: Path) -> None:
    save_project(str(tmp_path / "x.json"), Project(7))
    assert load_project(str(tmp_path / "x.json")) == Project(7)


def test_swapped_arguments_are_refused_with_the_right_order(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match=r"save_project\(path, project\): the path comes first, then the project"):
        save_project(Project(), tmp_path / "x")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"save_project\(path, project\): the project must be a Project, not 'x'"):
        save_project(tmp_path / "x", "x")  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"load_project\(path\): the path must be text or a Path, not 3"):
        load_project(3)  # type: ignore[arg-type]


def test_an_export_with_values_that_are_not_written_unasked_can_be_loaded(tmp_path: Path) -> None:
    odd = Project(actions=(Action(1, "\x1b[2J"),), macros=(Macro(2, "", (MacroCommand(1, 9, ratio=0),)),))
    save_project(tmp_path / "x", odd, unchecked=True)
    assert ProjectFile.read(tmp_path / "x") == (odd, True, None, None)
    (tmp_path / "x").write_text('{"schema": 1, "values": "odd"}', encoding="utf-8")
    with pytest.raises(ProjectError, match="values: must be one of unchecked, not 'odd'"):
        load_project(tmp_path / "x")


def test_a_pipe_is_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ProjectError, match="pipe: cannot be read: is not a regular file"):
        load_project(tmp_path / "pipe")
    with pytest.raises(ProjectError, match="null: cannot be read: is not a regular file"):
        load_project("/dev/null")
