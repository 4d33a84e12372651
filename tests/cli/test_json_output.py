"""JSON of the commands: what the examples print has the types on the page, which is made from these types.

Module: servolink.cli.screen.result.
"""

from __future__ import annotations

import json
import re
import shlex
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import msgspec
import pytest

from docs.json_output import OTHER_FORMS, WITHOUT, commands_of, page, results, schema
from servolink import cli
from servolink.cli.index import index
from servolink.cli.screen.result import CommandResult
from servolink.cli.stored import NOUNS
from tests.cli import test_command_line
from tests.cli.robot import Robot
from tests.cli.terminals import in_pipe

COMMANDS = [name for name in index() if name]


def test_the_page_has_each_type() -> None:
    headings = re.findall(r"^### (\w+)$", page(), re.MULTILINE)
    assert len(headings) == len(set(headings))
    assert set(headings) == set(schema()["$defs"])


def test_each_command_has_a_type_or_a_reason_for_none() -> None:
    named = {name for result in results().values() for name in commands_of(result)}
    assert [name for name in COMMANDS if name not in {*named, *OTHER_FORMS, *WITHOUT}] == []
    assert named & {*WITHOUT} == set()
    assert [name for name, result in results().items() if not commands_of(result)] == []


def test_the_schema_defines_all_that_it_refers_to() -> None:
    referred = set(re.findall(r'"#/\$defs/(\w+)"', json.dumps(schema())))
    assert referred <= set(schema()["$defs"])


def test_only_the_screen_knows_whether_output_is_json() -> None:
    """A command that asked would print its own JSON, or its own text."""
    folder = Path(cli.__file__).parent
    found = {
        str(path.relative_to(folder).as_posix())
        for path in folder.rglob("*.py")
        if re.search(r"args\.json|Form\.json|\bprint_json\(", path.read_text(encoding="utf-8"))
    }
    assert {name for name in found if not name.startswith("screen/")} == {
        "main.py",  # takes it from the command line
        "usage.py",  # wrong usage is printed before there is a command
        "command_session.py",  # says why nothing is asked
        "first_steps/demo.py",  # leaves people time to read
    }


def fitting(name: str, line: str) -> list[str]:
    """Return the types of a command that a line of JSON has, with no field more or less."""
    found = []
    for result in results().values():
        if name in commands_of(result):
            try:
                value = msgspec.json.decode(line, type=result)
            except msgspec.ValidationError:
                continue
            if _plain(value) == json.loads(line):
                found.append(result.__name__)
    return found


def _plain(value: CommandResult) -> Any:
    return json.loads(msgspec.json.encode(value))


LISTS = {f"{noun}s" for noun in NOUNS}
NOT_RUN = test_command_line.NOT_RUN | {*OTHER_FORMS} | {*WITHOUT}


@pytest.mark.parametrize("name", [name for name in COMMANDS if name not in NOT_RUN])
def test_examples_print_json_of_the_types(
    name: str, robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    test_command_line._prepare(name, robot, tmp_path, monkeypatch)
    for example in test_command_line.ALL[name].examples:
        if "--foxglove" in example and find_spec("foxglove") is None:
            continue  # the tests do not bring this extra
        command = max((each for each in COMMANDS if f"{example} ".startswith(f"{each} ")), key=len)
        if "--print-udev" in example or (command in LISTS and example != command):
            continue  # rules are printed as they are, and a record in the form of project files
        asks = {"--yes"} & {word for option in test_command_line.ALL[name].options for word in names_of(option)}
        said = in_pipe(*shlex.split(example), "--json", *sorted(asks))
        for line in said.out.splitlines():
            assert fitting(command, line), f"{example}: {line}"


def names_of(option: Any) -> list[str]:
    """Return the names of an option, or of all options of a group."""
    inner = getattr(option, "options", None)
    return [name for each in inner for name in names_of(each)] if inner is not None else list(option.names)


def test_a_field_that_no_type_has_is_found() -> None:
    assert fitting("board mode", '{"transmission_mode": 1}') == ["TransmissionMode"]
    assert fitting("board mode", '{"transmission_mode": 1, "more": 2}') == []
    assert fitting("board mode", '{"transmission_mode": "1"}') == []
