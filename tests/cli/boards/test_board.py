"""`servolink board`: what is known of a board is shown, set and forgotten, and every command uses it.

Modules: servolink.cli.boards.board_settings, servolink.cli.boards.set.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from servolink.boards import (
    BoardIdentityRecord,
    BoardNormals,
    BoardProfile,
    BoardSettings,
    Evidence,
    ProfileFile,
    SafetyLimits,
    ServoNormal,
)
from servolink.protocol import ServoParameter
from servolink.virtual import BoardKind, VirtualBoard
from tests.cli.programs import Said, call, in_terminal
from tests.cli.robot import Robot

HOSTILE = "\x1b]0;x\a\u202e"


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))


@pytest.fixture(name="say")
def _say(capsys: pytest.CaptureFixture[str]) -> type:
    class Say:
        def __new__(cls, line: str) -> Said:  # type: ignore[misc]
            return call(capsys, *line.split())

    Say("use rex virtual://?servos=3")
    return Say


def profile() -> BoardProfile:
    found = ProfileFile("rex").load()
    assert found is not None
    return found


def test_limits_and_settings_are_set_and_unset(say: type) -> None:
    said = say("board set rex --angle 3=20..160 --angle 1=-90.5..0 --speed 3=90 --speed all=120 --soft-start 60")
    assert (said.code, said.err) == (0, "")
    assert profile().limits == SafetyLimits(
        angles={3: (20, 160), 1: (-90.5, 0)}, speed_cap=120, speed_caps={3: 90}, soft_start=60
    )
    assert say("board set rex --byte-order big --caption-encoding big5 --depth 4 --write-depth 2").code == 0
    assert say("board set rex --transmission-mode 1 --memory-unit 1024 --unsupported QueryAction,QueryMacro").code == 0
    assert say("board set rex --transmission-mode keep --interval-unit 0.02 --unknown-ids silent").code == 0
    assert profile().settings == BoardSettings(
        byte_order="big",
        caption_encoding="big5",
        depth=4,
        write_depth=2,
        transmission_mode="keep",
        memory_unit=1024,
        unsupported=("QueryAction", "QueryMacro"),
        interval_unit=0.02,
        unknown_ids="silent",
    )
    assert profile().evidence["depth"].confidence == "certain"
    said = say("board set rex --unset byte-order --unset depth --angle 3=unset --speed all=unset --unset soft-start")
    assert said.code == 0
    assert (profile().settings.byte_order, profile().settings.depth) == (None, None)
    assert "depth" not in profile().evidence
    assert profile().limits == SafetyLimits(angles={1: (-90.5, 0)}, speed_caps={3: 90})


def test_angles_of_all_servos_are_limited_besides_those_of_one(say: type) -> None:
    said = say("board set rex --angle all=-90..90 --angle 3=20..160 --speed all=120")
    assert (
        said.out.partition("\n")[2]
        == "all servos  -90..90 degrees, at most 120 degrees/s\nservo 3     20..160 degrees\n"
    )
    refused = say("-b rex move 1=100")
    assert refused.err == 'servolink: servo 1: 100 degrees is outside its limits -90..90 (from profile "rex")\n'
    limits = profile().limits.for_motions("profile")
    assert [limits.of(servo_id) for servo_id in (1, 3)] == [(-90, 90), (20, 90)]
    assert say("board set rex --angle all=unset").code == 0
    assert profile().limits == SafetyLimits(angles={3: (20, 160)}, speed_cap=120)


def test_the_help_writes_values_as_a_shell_takes_them(say: type) -> None:
    told = " ".join(say("board set --help").out.split("settings (and")[1].split())
    assert "auto (if the board is silent), 1 (always) or keep (never)" in told
    assert "--unsupported NAME,... queries without a response of the board, such as QueryMemorySize" in told
    assert '"' not in told
    say("board set rex --unsupported QueryMemorySize,QueryRemainPower --transmission-mode auto")
    assert profile().settings.unsupported == ("QueryMemorySize", "QueryRemainPower")


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ("", "give at least one limit or setting"),
        ("--depth 900", "argument --depth: must be 1..64, not 900"),
        ("--depth 4.5", "argument --depth: must be 1..64, not 4.5"),
        ("--depth nan", "argument --depth: must be 1..64, not nan"),
        ("--transmission-mode 2", "argument --transmission-mode: must be auto, keep or 1, not 2"),
        ("--unsupported QueryX", "argument --unsupported: 'QueryX' is not a query of the protocol"),
        ("--angle 3", "argument --angle: must be SERVO=VALUE, not '3'"),
        ("--angle 3=20", "argument --angle: must have the form 3=20..160, all=-90..90 or 3=unset, not '3=20'"),
        ("--angle 3=20..10", "argument --angle: '3=20..10' has the highest angle first"),
        ("--angle 3=1.2.3..4", "argument --angle: must be from -32768 to 32767 degrees, not '1.2.3'"),
        ("--angle 255=0..1", "argument --angle: must be an integer from 0 to 254, not '255'"),
        ("--speed 3=0", "argument --speed: must be from 0.001 to 100000 degrees per second, not '0'"),
        ("--speed 300=3", "argument --speed: must be an integer from 0 to 254, not '300'"),
        ("--angle =3..4", "argument --angle: must not be empty"),
        ("--unset colour", "argument --unset: 'colour' is not a setting; `servolink board show` lists them"),
        ("--depth 3 --unset depth", "--depth is set and unset"),
    ],
)
def test_what_cannot_be_is_wrong_usage_and_changes_nothing(options: str, why: str, say: type) -> None:
    said = say(f"board set rex {options}")
    assert (said.code, said.out) == (2, "")
    assert f"servolink board set: error: {why}" in said.err
    assert ProfileFile("rex").load() is None


def test_a_caption_is_looked_up_on_the_board_and_its_id_kept(robot: Robot, say: type) -> None:
    say("use rex virtual:// --yes")
    robot.ask(lambda board: board.add_servo_parameters([ServoParameter(2, 0, "hip"), ServoParameter(3, 0, "a=b")]))
    said = say("board set rex --angle Hip=20..160 --speed a=b=90 --speed all=120 --angle 1=0..9")
    assert (said.code, said.err) == (0, "")
    assert "'Hip' is servo 2; its limits are kept by this id\n" in said.out
    limits = SafetyLimits(angles={1: (0, 9), 2: (20, 160)}, speed_cap=120, speed_caps={3: 90})
    assert profile().limits == limits
    unknown = say("board set rex --angle hop=20..160 --speed 1=5")
    assert (unknown.code, unknown.out) == (1, "")
    assert unknown.err == "servolink: the board has no servo 'hop'; did you mean servo 2 'hip'?\n"
    ProfileFile("rex").save(BoardProfile(identity=BoardIdentityRecord(servo_ids=(2, 5)), limits=limits))
    other = say("board set rex --angle hip=unset")
    assert (other.code, other.out) == (1, "")
    assert "rex was learnt with servos 2, 5; the board at virtual:// has servos 1..3. If it is the same" in other.err
    assert say("board set rex --angle 2=20..160").code == 0
    ProfileFile("rex").save(BoardProfile(limits=limits))
    robot.unplug()
    without = say("board set rex --angle hip=unset")
    assert (without.code, without.out) == (3, "")
    assert without.err == "servolink: there is no board; ids in place of captions need no board\n"
    assert profile().limits == limits
    assert say("board set rex --angle 2=unset").code == 0
    robot.plug_in()
    robot.board.kind = BoardKind(unsupported=("QueryServoParameter",))
    silent = say("board set rex --angle hip=20..160")
    assert silent.code == 1
    assert silent.err.endswith("; ids in place of captions need no board\n")
    assert say("use --remove rex").code == 0
    gone = say("board set rex --angle hip=20..160")
    assert (gone.code, "rex has no address, so its captions are unknown; give ids" in gone.err) == (2, True)


LEARNT = BoardProfile(
    identity=BoardIdentityRecord(servo_ids=(1, 2, 3, 9), memory_total=64, vendor_id=0x1A86, serial_number=HOSTILE),
    settings=BoardSettings(depth=4, turnaround=0.0012, unsupported=()),
    evidence={"depth": Evidence("likely", f"4 of 4 {HOSTILE}"), "write_depth": Evidence("guess", "nothing was asked")},
)


def test_everything_known_is_shown_with_its_reason(say: type) -> None:
    ProfileFile("rex").save(LEARNT)
    lines = say("board show rex").out.splitlines()
    assert lines[0] == "rex"
    assert "address        virtual://?servos=3" in lines
    assert f"file           {ProfileFile('rex').path}" in lines
    assert "servos         1..3, 9" in lines
    assert "USB            1a86:0000" in lines
    assert "serial number  '\\x1b]0;x\\x07\\u202e'" in lines
    assert "byte order         unknown" in lines
    assert "turnaround         0.0012 s" in lines
    assert "unsupported        none" in lines
    assert "depth              4; likely: 4 of 4 \\x1b]0;x\\x07\\u202e" in lines
    assert "write depth        unknown; guess: nothing was asked" in lines
    assert "none  `servolink board set` sets them" in lines
    assert lines[-1] == "what is unknown can be learnt: servolink doctor rex --learn"


def test_settings_and_normals_of_the_guard_are_shown_with_their_age_and_forgotten(
    say: type, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert "\nguard\nstops stalls  in the studio, and with share --guard\n" in say("board show rex").out
    limits = SafetyLimits(guard=True, temperature=620, ease_off=(2, 3))
    ProfileFile("rex").save(BoardProfile(limits=limits))
    now = datetime.now(UTC)
    fresh = ServoNormal.of(range(100), range(50), [3], seconds=75.2, learnt_at=now - timedelta(hours=2))
    old = ServoNormal.of([1], [], [], seconds=9.0, learnt_at=now - timedelta(days=40))
    BoardNormals(BoardIdentityRecord(), {11: old, 2: fresh}).save("rex")
    assert say("board show rex").out.split("guard\n")[1].splitlines()[:5] == [
        "stops stalls  in every hub",
        "warns before  temperature_raw 620",
        "eases off     servo 2, servo 3",
        "servo 2       normally at most: moving 90, resting 45, degrees behind 3; learnt over 75 s, today",
        "servo 11      normally at most: moving 1; learnt over 9 s, 40 days ago, too old to count",
    ]
    described = say("board show rex --json").json["normals"]
    assert described["2"] == {
        "moving_current_raw": 90,
        "resting_current_raw": 45,
        "lag_degrees": 3,
        "seconds": 75.2,
        "learnt_at": described["2"]["learnt_at"],
        "is_trusted": True,
    }
    assert (described["11"]["resting_current_raw"], described["11"]["is_trusted"]) == (None, False)
    assert say("board forget rex --yes").code == 0
    assert BoardNormals.load("rex") is None


def test_a_board_of_which_nothing_is_known_is_shown_too(say: type) -> None:
    said = say("board show rex")
    assert said.code == 0
    assert "identity  unknown: any board at this address is accepted under this name" in said.out
    described = say("board show rex --json").json
    assert (described["path"], described["identity"]) == (None, None)
    assert set(described["settings"]) == set(BoardSettings.__struct_fields__)


def test_json_has_the_names_of_the_file(say: type) -> None:
    ProfileFile("rex").save(LEARNT)
    described = say("board show rex --json").json
    assert described["name"] == "rex"
    assert described["path"] == str(ProfileFile("rex").path)
    assert described["identity"]["servo_ids"] == [1, 2, 3, 9]
    assert described["settings"]["depth"] == {
        "value": 4,
        "confidence": "likely",
        "text": f"4 of 4 {HOSTILE}",
        "learnt_at": None,
    }
    assert described["settings"]["byte_order"]["value"] is None
    assert say("board set rex --angle 3=0..9 --json").json["limits"]["angles"] == {"3": [0, 9]}
    assert say("board list --json").json == {
        "boards": [
            {"name": "rex", "url": "virtual://?servos=3", "known_settings": 3, "limits": 1, "problem": ""},
        ]
    }


@pytest.mark.parametrize("command", ["board", "board list"])
def test_all_boards_are_listed_also_damaged_and_nameless_ones(command: str, say: type) -> None:
    say("use max tcp://pi:9000")
    ProfileFile("rex").save(LEARNT)
    ProfileFile("lost").save(BoardProfile(limits=SafetyLimits(speed_cap=3)))
    ProfileFile("max").path.write_text("x")
    said = say(command)
    assert said.code == 0
    assert said.out.splitlines() == [
        "name  address              known settings  limits",
        "lost                       0                    1",
        "max   tcp://pi:9000        damaged",
        "rex   virtual://?servos=3  3                    0",
    ]
    assert f"servolink: {ProfileFile('max').path}, line 1: is not TOML" in said.err


def test_no_board_has_a_name(say: type) -> None:
    say("use --remove rex")
    assert say("board").out == "no board has a name; `servolink use NAME BOARD` gives one\n"


def test_limits_of_a_servo_that_is_not_there_are_kept_with_a_warning(say: type) -> None:
    ProfileFile("rex").save(LEARNT)
    assert say("board set rex --angle 9=0..5").err == ""
    said = say("board set rex --angle 30=0..5 --speed 31=5")
    assert (said.code, said.err) == (0, "servolink: rex was learnt to have no servo 30, 31\n")
    assert set(profile().limits.angles) == {9, 30}


@pytest.mark.parametrize("command", ["show", "set"])
def test_an_unknown_name_is_wrong_usage(command: str, say: type) -> None:
    said = say(f"board {command} lassie")
    assert said.code == 2
    assert "no board is named 'lassie' (names: rex); give it: servolink use NAME BOARD" in said.err


def test_a_profile_is_forgotten_damaged_or_not_and_the_name_stays(say: type) -> None:
    ProfileFile("rex").save(LEARNT)
    said = say("board forget rex")
    assert said.code == 2
    assert "with all limits of rex; --yes does so without asking" in said.err
    ProfileFile("rex").path.write_text("damaged")
    assert say("board show rex").code == 1
    assert say("board forget rex --yes").out == "what was known of rex is forgotten; it keeps its name\n"
    assert say("board show rex").code == 0
    said = say("board forget rex --yes")
    assert (said.code, said.err) == (
        1,
        "servolink: nothing is known of a board 'rex' (profiles: none); nothing was changed\n",
    )


def test_a_name_that_is_removed_leaves_its_profile(say: type) -> None:
    ProfileFile("rex").save(LEARNT)
    assert (
        "what was learnt of it is kept; to forget that too: servolink board forget rex" in say("use --remove rex").out
    )
    assert say("board show rex").code == 0


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
@pytest.mark.parametrize(("typed", "code"), [("y\n", 0), ("n\n", 1)])
def test_a_terminal_is_asked(typed: str, code: int, say: type) -> None:
    ProfileFile("rex").save(LEARNT)
    said = in_terminal("board", "forget", "rex", typed=typed)
    assert (said.code, ProfileFile("rex").load() is None) == (code, code == 0)


# --- every command uses it --------------------------------------------------------------------------------------------


def test_limits_are_those_of_every_command(robot: Robot, say: type) -> None:
    say("use rex virtual:// --yes")
    say("board set rex --angle 1=0..20")
    for board in ("rex", "virtual://"):
        said = say(f"--board {board} move 1=50")
        assert (said.code, said.out) == (1, "")
        assert 'servo 1: 50 degrees is outside its limits 0..20 (from profile "rex")' in said.err
    assert say("--board rex move 1=15").code == 0


def test_another_board_is_stopped_and_read_with_a_warning_and_not_moved(
    robot: Robot, say: type, caplog: pytest.LogCaptureFixture
) -> None:
    say("use rex virtual:// --yes")
    ProfileFile("rex").save(BoardProfile(identity=BoardIdentityRecord(servo_ids=(1, 2, 3, 4))))
    assert say("-b rex servos").code == 0
    difference = "rex was learnt with servos 1..4; the board at virtual:// has servos 1..3"
    assert f"{difference}; it can be read, but neither moved nor changed" in caplog.text
    said = say("-b rex move 1=5")
    assert said.code == 1
    assert f"{difference}: ExecuteActionRequest was not sent" in said.err
    assert say("-b rex stop").code == 0
    assert say("-b rex release --yes").code == 0


def test_a_board_without_project_ids_is_not_asked_for_an_unfinished_import(robot: Robot, say: type) -> None:
    robot.board = VirtualBoard(3, kind=BoardKind(unsupported=("QueryProjectID",)))
    say("use rex virtual:// --yes")
    assert say("-b rex servos --timeout 0.5").code == 0
    said = say("-b rex info --timeout 0.5")
    assert said.code == 0
    assert said.err == "left out, as the board does not answer: QueryProjectID\n"
    assert "project id" not in said.out
    say("board set rex --unsupported QueryProjectID")
    assert say("-b rex servos --timeout 0.5").code == 0


def test_queries_that_a_board_does_not_answer_delay_nothing(robot: Robot, say: type) -> None:
    robot.board = VirtualBoard(3, kind=BoardKind(unsupported=("QueryRemainPower", "QueryServoParameter")))
    say("use rex virtual:// --yes")
    say("board set rex --unsupported QueryRemainPower,QueryServoParameter")
    said = say("-b rex watch --hz 10 --seconds 1 --json")
    assert (said.code, said.err) == (0, "")
    assert len(said.objects) == 10
    assert not any(reading["missed"] for reading in said.objects)
    assert {reading["battery_percent"] for reading in said.objects} == {None}
    assert say("-b rex servos").err == ""


def test_a_damaged_profile_keeps_nobody_from_stopping(robot: Robot, say: type) -> None:
    say("use rex virtual:// --yes")
    ProfileFile("rex").save(LEARNT)
    ProfileFile("rex").path.write_text("[settings]\ndepth = 900\n")
    said = say("-b rex servos")
    assert said.code == 1
    assert said.err == f"servolink: {ProfileFile('rex').path}, line 2: depth must be 1..64, not 900\n"
    said = say("-b rex stop")
    assert said.code == 0
    assert said.err.endswith("line 2: depth must be 1..64, not 900; stopping without it\n")


def test_a_move_at_no_speed_in_particular_keeps_to_the_limits(say: type) -> None:
    say("board set rex --speed 1=20")
    assert say("-b rex move 1=62 2=63 --no-wait --json").json["duration_seconds"] == 3
    assert "its cap is 20" in say("-b rex move 1=62 --speed 60").err
