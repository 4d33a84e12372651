"""The parser: what it suggests, what its help shows, and that every example in it works.

Modules: servolink.cli.arguments, servolink.cli.command, servolink.cli.first_steps.help, servolink.cli.usage.
"""

from __future__ import annotations

import re
import shlex
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import pytest

from servolink.cli.command import TOPICS
from servolink.cli.command_line import EXIT_CODES, parser_of
from servolink.cli.index import below, index, load
from servolink.project import Figure, Joint, Project, View, save_project
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, Step
from servolink.recorder import Event
from tests.cli.programs import Said, call, program
from tests.cli.robot import Robot
from tests.cli.terminals import in_pipe, in_terminal
from tests.project.pulled import contents_of
from tests.recorder.files import write as write_recording
from tests.tables import over

ALL = {name: load(name) for name in index() if name}
"""Commands as they are typed."""

UNTIL_CTRL_C = {"virtual", "share", "studio", "teach", "remote", "record", "replay", "spy", "mcp", "foxglove", "ros2"}
SLOW = {"demo"}
NEED_A_BROKER = {"fleet", *(f"fleet {name}" for name in below("fleet"))}
"""Those of the fleet, which `tests/fleet` runs with one."""
NEED_A_PICO = {"firmware", "firmware install", "firmware build"}
"""Those that `tests/firmware` runs, with an imitated Pico or a compiler."""
ASK_EACH_TIME = {"twin measure"}
"""Those that ask in a terminal before each movement, which `tests/cli/projects` answers."""
NOT_RUN = ASK_EACH_TIME | UNTIL_CTRL_C | SLOW | NEED_A_BROKER | NEED_A_PICO
CODES = {"plan": (1,), "list": (0, 3)}
"""Codes with which the examples of a command may end, other than 0."""

BOW = Action(1, "Bow", (Step(1, 30, 5),))
NOD = Action(2, "Nod", (Step(2, 10, 5),))
GREET = Macro(1, "Greet", (MacroCommand(1, total_interval=50),))
REST = Macro(2, "Rest", (MacroCommand(500, 1, total_interval=500),))
PAD = JoystickTable(1, "Pad", (Button(3, "greet", button_press_macro=1),))
IN_FILES = Project(actions=(BOW,), macros=(GREET,), joystick_tables=(PAD,), active_joystick_table=1)
DRAWN = Figure(1, "Arm", View(), (Joint("arm", servo=1, length=200, along=(0, 1, 0)),))
ON_THE_BOARD = Project(actions=(BOW, NOD), macros=(GREET, REST), joystick_tables=(PAD,), active_joystick_table=1)


@over("name", ALL)
def test_every_command_has_examples(name: str) -> None:
    assert ALL[name].examples
    assert all(example.startswith(name) for example in ALL[name].examples)


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("mvoe 1=5", "there is no command 'mvoe'; did you mean move?"),
        ("servoes", "did you mean servos?"),
        ("action", "no command is given; `servolink action --help` lists the commands"),
        ("hlep", "there is no command 'hlep'; did you mean help?"),
        ("version", "did you mean --version?"),
        ("xylophone", "there is no command 'xylophone'; `servolink --help` lists the commands"),
        ("board shwo x", "there is no command 'shwo'; did you mean show?"),
        ("project shwo x", "there is no command 'shwo'; did you mean show?"),
        ("--jsn info", "`servolink` has no option --jsn; did you mean --json?"),
        ("move --durration 1 1=5", "`servolink move` has no option --durration; did you mean --duration?"),
        ("move 1=5 --durration=1", "did you mean --duration?"),
        ("move 1=5 --dur 1", "did you mean --duration?"),
        ("move -x 1=5", "`servolink move` has no option -x"),
        ("macro add Dance --steps", "has no option --steps\n"),
        ("use arm virtual:// --as", "has no option --as\n"),
        ("run acton 1", "argument action|macro: must be action or macro, not 'acton'"),
        ("info more", "unexpected argument: more\n"),
        ("stop 3", "unexpected argument: 3; `servolink stop` stops all servos, `servolink servo hold SERVO` one\n"),
        ("demo --url virtual://", "`servolink demo` has no option --url"),
    ],
)
def test_what_was_meant_is_suggested(typed: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    ended = call(capsys, *typed.split())
    assert (ended.code, ended.out) == (2, "")
    assert said in ended.err


@over("name", ALL)
def test_only_required_arguments_are_called_required(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    usage = _without_options(" ".join(parser_of(ALL[name]).format_usage().split()))
    required = usage.split("servolink")[-1].split()[len(name.split()) :]
    said = call(capsys, *name.split()) if ALL[name].run is None or required else Said(0, "", "")
    for argument in re.findall(r"required: (.*)", said.err):
        for each in argument.split(", "):
            assert each in usage, "it is optional"


def _without_options(usage: str) -> str:
    """Return a usage without what is in brackets, which may hold brackets: `[--fleet [URL]]`."""
    while (shorter := re.sub(r"\[[^\[\]]*\]", "", usage)) != usage:
        usage = shorter
    return usage


@over("name", ["", *ALL])
def test_help_fits_and_names_no_section(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, *name.split(), "--help")
    assert said.code == 0
    assert said.out.endswith(f"{EXIT_CODES}\n")
    lines = said.out.splitlines()
    assert max(map(len, lines)) <= 80
    short = [one for one, two in pairwise(lines) if len(one) < 60 and re.match("[a-z]", two)]
    assert [one for one in short if re.fullmatch("[^ ].*[a-z,]", one)] == [], "a paragraph breaks at the width only"
    assert all(f"\n  servolink {example}\n" in said.out for example in (ALL[name].examples if name else ()))
    assert not re.search(r"\b3\.\d\.\d|\(3\.\d", said.out), "people have no idea of the document's sections"


def test_the_help_groups_all_commands(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--help").out
    at = [said.index(f"\n{topic}:\n") for topic in TOPICS]
    assert at == sorted(at)
    listed = re.findall(r"^  ([a-z0-9]+) +(.*)$", said[at[0] :], re.MULTILINE)
    assert listed == [(name, entry.help) for name, entry in below("").items() if entry.topic]


@pytest.mark.parametrize(
    "words",
    [
        "use all tcp://127.0.0.1:7878",
        "share virtual:// --name all",
        "fleet join mqtt://127.0.0.1 virtual:// --name all",
    ],
)
def test_no_board_can_be_called_as_all_of_them_are(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, *words.split())
    assert said.code == 2
    assert "'all' means every board of a fleet: choose another name" in said.err


def test_the_version_is_that_of_the_package() -> None:
    said = program("--version")
    assert said.code == 0
    assert re.fullmatch(r"servolink \d+\.\d+\S* on \w+ 3\.\d+\.\d+, \w+ \w+\n", said.out)


@pytest.mark.parametrize("name", [name for name in ALL if name not in NOT_RUN])
def test_examples_of_a_page_work_one_after_the_other(
    name: str, robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _prepare(name, robot, tmp_path, monkeypatch)
    for example in ALL[name].examples:
        if "--foxglove" in example and find_spec("foxglove") is None:
            continue  # the tests do not bring this extra
        said = in_pipe(*shlex.split(example), encoding="ascii")  # what cannot be shown must not end a command
        assert said.code in CODES.get(name, (0,)), f"{example}: {said.err}"


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "cp437"])
@pytest.mark.parametrize("name", [name for name in ALL if name not in NOT_RUN])
def test_a_terminal_without_utf_8_shows_all_that_a_command_prints(
    name: str, encoding: str, robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _prepare(name, robot, tmp_path, monkeypatch)
    said = in_terminal(*shlex.split(ALL[name].examples[0]), typed="y\n", encoding=encoding)
    assert said.code in CODES.get(name, (0,)), said.out


@pytest.mark.parametrize("name", sorted(NOT_RUN))
def test_examples_of_commands_that_do_not_end_are_understood(name: str) -> None:
    for example in ALL[name].examples:
        assert parser_of().parse_args(shlex.split(example)).run


def _prepare(name: str, robot: Robot, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Write the files that examples of a command name, and store on the board what they change."""
    for variable in ("XDG_CONFIG_HOME", "XDG_DATA_HOME", "HOME", "APPDATA"):
        monkeypatch.setenv(variable, str(folder / variable))
    monkeypatch.setenv("SERVOLINK_BOARD", "virtual://")
    monkeypatch.chdir(folder)
    for file in ("robot.servolink.json", "other.json"):
        save_project(folder / file, IN_FILES, figure=DRAWN)
    write_recording(folder / "out.mcap", [(0.0, Event("mark", "mark", text="here"))])
    if ALL[name].needs_records:
        robot.board.storage.contents = contents_of(ON_THE_BOARD)
    if name == "export":  # without --yes, it writes a new file only
        (folder / "robot.servolink.json").unlink()
    if name == "figure import":
        in_pipe("figure", "export", "robot.servolink.json", "robot.urdf")
    if name == "rollback":
        in_pipe("apply", "robot.servolink.json", "--yes")
    if name.startswith("board"):
        in_pipe("use", "rex", "virtual://")
        in_pipe("board", "set", "rex", "--depth", "2")


@pytest.mark.parametrize(("command", "seconds"), [("info", "3"), ("doctor", "about 0.5")])
def test_the_help_says_how_long_a_command_waits(command: str, seconds: str, capsys: pytest.CaptureFixture[str]) -> None:
    told = " ".join(call(capsys, command, "--help").out.split())
    assert f"how long to wait for each response, {seconds} unless given" in told


def test_without_a_command_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys)
    assert (said.code, said.err) == (0, "")
    assert said == call(capsys, "--help")


@pytest.mark.parametrize("words", ["", "move", "project", "project play"])
def test_help_is_a_command_too(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "help", *words.split()) == call(capsys, *words.split(), "--help")


def test_help_suggests_what_was_meant(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "help", "mvoe")
    assert (said.code, said.out) == (2, "")
    assert "there is no command 'mvoe'; did you mean move?" in said.err
