"""`servolink doctor NAME --learn`, as it is typed.

Module: servolink.cli.boards.learn.
"""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

import pytest

from servolink import Action, Step
from servolink.boards import BoardProfile, BoardSettings, ProfileFile, SafetyLimits
from servolink.client import Board
from servolink.errors import OpenError
from servolink.project import BackupStore
from servolink.protocol import ACTION, Codec
from servolink.virtual import BoardKind, VirtualBoard
from tests.cli.programs import Said, call
from tests.cli.robot import Robot
from tests.cli.terminals import ESCAPE, in_terminal

WAVE = Action(1, "挥手", (Step(1, 10, 50),))
OLD_BIG_KIB = BoardKind(mode=0, memory_unit=1024, turnaround=0.002, queue=4)


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


@pytest.fixture(name="learnt")
def _learnt(robot: Robot, capsys: pytest.CaptureFixture[str]) -> Any:
    """Return a function that learns the robot, called rex, and returns what the command said."""
    assert call(capsys, "use", "rex", "virtual://").code == 0

    def run(*options: str) -> Said:
        return call(capsys, "doctor", "rex", "--learn", *options)

    return run


def kept() -> BoardProfile:
    profile = ProfileFile("rex").load()
    assert profile is not None
    return profile


def test_what_is_learnt_is_kept_under_the_name(robot: Robot, learnt: Any) -> None:
    robot.board = VirtualBoard(3, codec=Codec("big"), kind=OLD_BIG_KIB)
    said = learnt("--power-cycled", "--write", "--clear", "--yes")
    assert (said.code, said.err) == (0, "")
    lines = said.out.splitlines()
    assert lines[0].split() == ["setting", "value", "confidence", "evidence"]
    assert [line.split()[:3] for line in lines if line.startswith("depth")] == [["depth", "4", "certain"]]
    assert lines[-1].startswith("kept in ")
    assert kept().settings == BoardSettings(
        byte_order="big",
        power_up_mode=0,
        transmission_mode=1,
        unsupported=(),
        unknown_ids="empty",
        turnaround=kept().settings.turnaround,
        depth=4,
        write_depth=4,
        memory_unit=1024,
        project_id_bits=32,
        on_duplicate="replace",
        clear="all",
        clear_seconds=kept().settings.clear_seconds,
    )
    identity = kept().identity
    assert identity is not None
    assert (identity.servo_ids, identity.memory_total) == ((1, 2, 3), 64)
    assert kept().evidence["depth"].text.startswith("8 bursts of 4 queries")


def test_without_being_asked_nothing_is_written_and_nothing_moves(robot: Robot, learnt: Any) -> None:
    before, angles = robot.board.storage.contents, [servo.angle for servo in robot.board.servos.values()]
    said = learnt("--json")
    assert said.code == 0
    assert robot.board.storage.contents is before
    assert [servo.angle for servo in robot.board.servos.values()] == angles
    assert not BackupStore().backups()
    found = {finding["setting"]: finding for finding in said.json["findings"]}
    assert found["depth"]["value"] == 16
    assert found["caption_encoding"] == {
        "setting": "caption_encoding",
        "value": None,
        "confidence": None,
        "evidence": "no caption is stored on the board",
    }
    assert said.json["name"] == "rex"
    assert said.json["profile"]["settings"]["depth"] == 16
    assert said.json["file"].endswith("rex.toml")


def test_a_servo_is_moved_only_if_it_is_named(robot: Robot, learnt: Any) -> None:
    angles = {number: round(servo.angle) for number, servo in robot.board.servos.items()}
    said = learnt("--servo", "2")
    assert said.code == 0
    goal = angles[2] + (10 if angles[2] <= 0 else -10)
    assert f"servo 2 will turn from {angles[2]}° to {goal}° and back, in 0.1 to 10 s each way" in said.err
    assert kept().settings.interval_unit == 0.01
    assert {number: round(servo.angle) for number, servo in robot.board.servos.items()} == angles


def test_the_servo_may_be_named_by_its_caption(robot: Robot, learnt: Any, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "--board", "virtual://", "servo", "rename", "2", "hip").code == 0
    assert "servo 2 will turn from" in learnt("--servo", "Hip").err
    assert learnt("--servo", "all").code == 2


def test_a_servo_that_is_not_there_is_refused_before_anything_is_learnt(
    robot: Robot, learnt: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.board = VirtualBoard(3, codec=Codec("big"))
    monkeypatch.setattr("servolink.cli.boards.learn.learn_by_asking", None)
    said = learnt("--servo", "tail")
    assert (said.code, said.out) == (1, "")
    assert said.err == "servolink: the board has no servo 'tail'; no servo of it has a caption\n"
    robot.board = VirtualBoard(3, kind=BoardKind(unsupported=("QueryServoParameter",)))
    said = learnt("--servo", "tail")
    assert (said.code, said.out) == (1, "")
    assert said.err.endswith("; without captions, --servo needs an id\n")
    assert ProfileFile("rex").load() is None


def test_nobody_is_asked_to_switch_off_a_board_whose_name_is_unknown() -> None:
    said = in_terminal("doctor", "max", "--learn", "--servo", "hip")
    assert said.code == 2
    assert "switch max off" not in said.out
    assert "max is neither an address nor a name" in said.out


def test_limits_of_the_user_stay_and_are_obeyed(robot: Robot, learnt: Any) -> None:
    limits = SafetyLimits(speed_cap=90, angles={2: (-1, 1)})
    ProfileFile("rex").save(BoardProfile(limits=limits))
    robot.board.servos[2].angle = 0.0
    said = learnt("--servo", "2")
    assert (said.code, "without room for" in said.err) == (1, True)
    assert kept().limits == limits
    assert kept().settings.depth == 16, "what was learnt before is kept"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("--learn",), "so give it one first:\n  servolink use NAME BOARD\n"),
        (("virtual://", "--learn"), "servolink use NAME virtual://\n  servolink doctor NAME --learn"),
        (("--write",), "--write needs --learn"),
        (("--servo", "3"), "--servo needs --learn"),
        (("rex", "--learn", "--clear"), "--clear needs --write"),
        (("rex", "--learn", "--write"), "nobody can be asked here, so give --yes"),
        (("max", "--learn"), "max is neither an address nor a name"),
    ],
)
def test_wrong_usage(arguments: tuple[str, ...], text: str, learnt: Any, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "doctor", *arguments)
    assert said.code == 2
    assert text in said.err
    assert learnt("--json").code == 0


def test_another_board_takes_the_name_only_if_the_user_says_so(robot: Robot, learnt: Any) -> None:
    assert learnt().code == 0
    robot.board = VirtualBoard(5, kind=BoardKind(memory=1024, turnaround=0.001, queue=0))
    said = learnt()
    assert said.code == 1
    assert "this is not the board that rex was:\n" in said.err
    assert "  servo ids: 1, 2, 3 was kept, 1, 2, 3, 4, 5 is here\n" in said.err
    assert "  memory total: 65536 was kept, 1024 is here\n" in said.err
    assert kept().settings.depth == 16
    assert learnt("--yes").code == 0
    identity = kept().identity
    assert identity is not None
    assert identity.servo_ids == (1, 2, 3, 4, 5)
    assert kept().settings.depth == 1


def test_a_damaged_profile_is_refused_before_anything_is_measured(robot: Robot, learnt: Any) -> None:
    path = ProfileFile("rex").save(BoardProfile())
    path.write_text("[settings]\ndepth = 1000\n", encoding="utf-8")
    said = learnt()
    assert said.code != 0
    assert f"{path}, line 2: depth must be 1..64" in said.err


def test_what_is_on_the_board_is_restored(robot: Robot, learnt: Any) -> None:
    async def fill(board: Board) -> None:
        await board.add_action(WAVE)
        await board.write_project_id(9)

    robot.ask(fill)
    before = robot.board.storage.contents
    assert learnt("--write", "--yes").code == 0
    assert robot.board.storage.contents == before


@pytest.mark.parametrize("where", ["address", "profile"])
def test_the_backup_is_read_as_commands_will_read_it(
    where: str, robot: Robot, learnt: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    if where == "address":
        assert call(capsys, "use", "rex", "virtual://?caption_encoding=big5", "--yes").code == 0
    else:
        ProfileFile("rex").save(BoardProfile(settings=BoardSettings(caption_encoding="big5")))
    assert learnt("--write", "--yes").code == 0
    assert [backup.caption_encoding for backup in BackupStore().backups()] == ["big5"]


def test_a_pulled_cable_names_the_way_back(robot: Robot, learnt: Any, capsys: pytest.CaptureFixture[str]) -> None:
    async def fill(board: Board) -> None:
        await board.add_action(WAVE)
        await board.write_project_id(9)

    def pull() -> None:
        if len(robot.board.storage.all(ACTION)) > 5:
            asyncio.get_running_loop().call_soon(robot.unplug)

    robot.ask(fill)
    before = robot.board.storage.contents
    robot.board.watch(pull)
    said = learnt("--write", "--yes")
    assert said.code == 3
    assert "nothing is lost: `servolink -b rex rollback 1` restores what was on it" in said.err
    robot.board.unwatch(pull)
    robot.plug_in()
    again = learnt("--write", "--yes")
    assert again.code == 1
    assert "holds an unfinished import" in again.err
    assert call(capsys, "-b", "rex", "rollback", "1", "--yes").code == 0
    assert robot.board.storage.contents == before


def test_a_board_that_was_just_switched_on_is_waited_for(robot: Robot, learnt: Any) -> None:
    robot.board.powered = True
    tries = []

    def opened() -> None:
        tries.append(1)
        if len(tries) < 10:
            raise OpenError("its port is not there yet")

    robot.opened = opened  # type: ignore[method-assign]
    assert learnt("--power-cycled").code == 0
    assert len(tries) == 10
    tries.clear()
    said = learnt()
    assert (said.code, len(tries)) == (3, 1)
    assert "its port is not there yet" in said.err


@pytest.mark.usefixtures("learnt")
def test_in_a_terminal_it_asks() -> None:
    said = in_terminal("doctor", "rex", "--learn", "--write", typed="\nn\n")
    assert said.code == 0
    assert "switch rex off and on, and press Enter when it has started" in said.out
    assert said.out.index("press Enter") < said.out.index("restored [y/N]")
    assert re.search("power_up_mode +1 +certain", ESCAPE.sub("", said.out))
    assert "memory_unit" not in said.out
    said = in_terminal("doctor", "rex", "--learn", typed="n\n")
    assert said.code == 0
    assert re.search("power_up_mode +unknown", ESCAPE.sub("", said.out))
