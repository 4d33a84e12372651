"""Each command against a board in another process, over a real terminal, as text and as JSON.

Module: servolink.cli.developers.bench.
"""

from __future__ import annotations

import asyncio
import re

import pytest

from servolink.client import Board as ClientBoard
from servolink.client import connect
from servolink.errors import OutcomeUnknown
from servolink.protocol import Action, Button, JoystickTable, Macro, MacroCommand, ServoParameter, Step
from servolink.virtual import BoardKind, VirtualBoard
from tests.cli.conftest import Addresses
from tests.cli.programs import Said, call, program, started
from tests.cli.robot import Robot
from tests.cli.terminals import in_pipe, in_terminal

BOW = Action(1, "Bow", (Step(1, 30, 5), Step(2, -30, 10)))
WAVE = Macro(4, "Wave", (MacroCommand(1, loop=2, ratio=50), MacroCommand(500, 1, total_interval=500)))
PAD = JoystickTable(3, "Pad", (Button(7, "wave", button_press_macro=4, uninterruptible=1),))


@pytest.fixture(scope="module")
def url(served: Addresses) -> str:
    """The terminal of a board that has something stored."""

    async def store() -> None:
        async with connect(served.network) as board:
            await board.write_project_id(77)
            await board.add_action(BOW)
            await board.add_macro(WAVE)
            await board.add_joystick_table(PAD)
            await board.add_servo_parameters([ServoParameter(2, 5, "left knee")])

    asyncio.run(store())
    return served.terminal


@pytest.fixture
def board(url: str, capsys: pytest.CaptureFixture[str]) -> Board:
    """Commands to that board, all servos ready."""
    ours = Board(url, capsys)
    ready = [f"{servo_id}=0" for servo_id in range(1, 17)]
    assert ours("move", *ready, "--duration", "0.01", "--start").code == 0
    return ours


class Board:
    """Runs commands in this process."""

    def __init__(self, url: str, capsys: pytest.CaptureFixture[str]) -> None:
        self.url = url
        self._capsys = capsys

    def __call__(self, *arguments: str) -> Said:
        return call(self._capsys, "--url", self.url, *arguments)


def plain(text: str) -> bool:
    """Tell whether a text has nothing in it that only a terminal understands."""
    return all(character == "\n" or character.isprintable() for character in text)


def test_info(board: Board) -> None:
    said = board("info")
    assert (said.code, said.err) == (0, "")
    assert plain(said.out)
    assert re.search(r"^project id +77$", said.out, re.MULTILINE)
    described = board("info", "--json").json
    assert {**described, "round_trip_seconds": None, "battery_percent": None, "memory": None} == {
        "url": board.url,
        "project_id": 77,
        "has_unfinished_import": False,
        "memory": None,
        "battery_percent": None,
        "servos": 16,
        "actions": 1,
        "macros": 1,
        "joystick_tables": 1,
        "transmission_mode": {"found": 1, "set": None},
        "active_joystick_table": 3,
        "angle_unit": "degree",
        "round_trip_seconds": None,
        "unanswered": [],
    }
    assert 0 < described["memory"]["size_bytes"] < described["memory"]["total_size_bytes"]
    assert 0 < described["battery_percent"] <= 100
    assert 0 < described["round_trip_seconds"] < 3, "the time for which it waits"


def test_no_project_id_is_called_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert re.search(r"^project id +none$", call(capsys, "-b", "virtual://", "info").out, re.MULTILINE)


def test_servos(board: Board) -> None:
    said = board("servos")
    assert plain(said.out)
    assert len(said.out.splitlines()) == 17
    assert re.search(r"^ +2 +left knee +0° .* ready$", said.out, re.MULTILINE)
    servos = board("servos", "--json").json["servos"]
    assert [servo["servo_id"] for servo in servos] == list(range(1, 17))
    first = {name: servos[1][name] for name in ("servo_caption", "angle", "angle_unit", "is_start", "is_hold")}
    assert first == {
        "servo_caption": "left knee",
        "angle": 0,
        "angle_unit": "degree",
        "is_start": True,
        "is_hold": True,
    }


def test_servos_of_a_board_that_does_not_answer_for_their_captions(robot: Robot) -> None:
    robot.board = VirtualBoard(3, kind=BoardKind(unsupported=("QueryServoParameter",)))
    said = robot("servos", "--json")
    assert said.code == 0
    assert [servo["servo_caption"] for servo in said.json["servos"]] == [None] * 3
    assert said.err.startswith("servolink: shown without captions: QueryServoParameterRequest() was not answered")


def test_servos_in_raw_readings(board: Board) -> None:
    servo = board("servos", "--adc", "--json").json["servos"][0]
    assert servo["angle_unit"] == "adc"
    assert servo["angle"] > 1000  # the middle of the converter's range, where degrees are 0


def test_move_waits_until_the_servos_are_there(board: Board) -> None:
    said = board("move", "1=40", "2=-45", "--duration", "0.2", "--json")
    assert (said.code, said.err) == (0, "")
    moved = said.json
    assert (moved["duration_seconds"], moved["arrived"]) == (0.2, True)
    assert [(servo["servo_id"], servo["target_angle"], servo["angle_unit"]) for servo in moved["servos"]] == [
        (1, 40, "degree"),
        (2, -45, "degree"),
    ]
    assert all(abs(servo["angle"] - servo["target_angle"]) <= 2 for servo in moved["servos"])
    assert re.search(r"^ +1 +40° +10° +10°$", board("move", "1=10", "--speed", "600").out, re.MULTILINE)


def test_move_that_does_not_wait(board: Board) -> None:
    moved = board("move", "1=60", "--no-wait", "--json").json
    assert moved["arrived"] is False
    assert moved["duration_seconds"] == pytest.approx(60 / 60)  # at the usual speed
    assert moved["servos"][0]["angle"] is None
    assert board("stop").code == 0


def test_move_at_no_speed_in_particular_keeps_to_the_caps(robot: Robot) -> None:
    robot.board.servos[1].angle = robot.board.servos[2].angle = 0
    assert robot("move", "1=60", "--speed-cap", "30", "--json").json["duration_seconds"] == 2
    assert robot("move", "1=0", "--speed-cap", "90", "--json").json["duration_seconds"] == 1
    assert "its cap is 30" in robot("move", "1=60", "--speed-cap", "30", "--speed", "60").err


def test_move_in_raw_readings(board: Board) -> None:
    moved = board("move", "3=2100", "--adc", "--duration", "0.05", "--json").json
    assert moved["servos"][0]["angle_unit"] == "adc"
    assert abs(moved["servos"][0]["angle"] - 2100) <= 2


def test_a_servo_that_would_ignore_a_move_is_told_of(board: Board) -> None:
    assert board("release", "5", "--yes").code == 0
    said = board("move", "5=10", "6=10", "--duration", "0.05")
    assert (said.code, said.out) == (1, "")
    assert "servo 5 is stopped or released" in said.err
    assert "--start" in said.err
    refused = board("move", "5=100", "--limit", "0", "90", "--start")
    assert refused.code == 1
    servos = board("servos", "--json").json["servos"]
    assert servos[4]["is_hold"] is False, "it must not be started for a move that is refused"
    assert servos[5]["angle"] == 0, "nothing must be sent"
    assert board("move", "5=10", "--duration", "0.05", "--start", "--json").json["arrived"] is True


def test_stop_says_what_the_servos_report(board: Board) -> None:
    assert board("move", "1=90", "--duration", "30", "--no-wait").code == 0
    said = board("stop", "--json")
    assert said.code == 0
    servos = said.json["servos"]
    assert [(servo["is_start"], servo["is_hold"]) for servo in servos] == [(False, True)] * 16
    assert servos[0]["angle"] < 90
    text = board("stop").out
    assert text.startswith("all 16 servos report that they are stopped and held\n")
    assert text.count("stopped\n") == 16


def test_release(board: Board) -> None:
    servos = board("release", "2", "3", "--yes", "--json").json["servos"]
    assert [servo["servo_id"] for servo in servos if not servo["is_hold"]] == [2, 3]
    assert board("release", "--yes").out.count("released\n") == 16


def test_nothing_is_released_if_a_servo_is_not_there(board: Board) -> None:
    said = board("release", "2", "99", "--yes")
    assert (said.code, said.err) == (1, "servolink: the board has no servo 99; nothing was moved\n")
    assert all(servo["is_hold"] for servo in board("servos", "--json").json["servos"])


def test_what_was_released_before_it_failed_is_named(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    release = ClientBoard.release

    async def failing(self: ClientBoard, servo_id: int) -> None:
        if servo_id == 3:
            raise OutcomeUnknown("lost")
        await release(self, servo_id)

    monkeypatch.setattr(ClientBoard, "release", failing)
    said = board("release", "2", "3", "--yes")
    assert said.code == 1
    assert said.err == ("servolink: released and limp: 2; `servolink stop` holds all servos again\nservolink: lost\n")


@pytest.mark.parametrize("command", [["servos"], ["move", "1=5"], ["release", "--yes"], ["teach", "x", "--yes"]])
def test_a_board_without_servos_is_called_so(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "--url", "virtual://?servos=0", *command)
    assert (said.code, said.out, said.err) == (1, "", "servolink: the board has no servos\n")


def test_release_asks_a_person(url: str) -> None:
    refused = in_terminal("--url", url, "release", typed="n\n")
    assert refused.code == 1
    assert "raised limbs fall" in refused.out
    agreed = in_terminal("--url", url, "release", "4", typed="y\n")
    assert agreed.code == 0
    assert "released" in agreed.out.rpartition("[y/N]")[2]


def test_run_action(board: Board) -> None:
    said = board("run", "action", "1", "--json")
    assert said.json == {
        "action_id": 1,
        "action_caption": "Bow",
        "duration_seconds": 0.1,
        "servo_ids": [1, 2],
        "idle_servos": [],
        "arrived": False,
    }
    assert board("run", "action", "bow").out == "action 1 'Bow' was started; it takes 0.1 s and moves servos 1, 2\n"
    assert board("release", "2", "--yes").code == 0
    warned = board("run", "action", "1", "--json")
    assert warned.json["idle_servos"] == [2]
    assert "servo 2 is stopped or released" in warned.err
    started_first = board("run", "action", "1", "--start", "--json")
    assert (started_first.json["idle_servos"], started_first.err) == ([], "")


def test_run_macro(board: Board) -> None:
    assert board("run", "macro", "4").out == "macro 4 'Wave' was started; it takes 0.9 s and moves servos 1, 2\n"
    said = board("run", "macro", "4", "--json")
    assert (said.json["macro_id"], said.json["macro_caption"], said.json["idle_servos"]) == (4, "Wave", [])
    assert board("stop").code == 0  # or it would go on to move servos in the next test


def test_run_macro_warns_of_the_servos_it_uses(robot: Robot) -> None:
    async def prepare(board: ClientBoard) -> None:
        await board.add_action(Action(1, "Bow", (Step(1, 30, 5),)))
        await board.add_macro(Macro(1, "Inner", (MacroCommand(1),)))
        await board.add_macro(Macro(2, "Outer", (MacroCommand(500, 1), MacroCommand(1, 2))))
        await board.add_macro(Macro(3, "Broken", (MacroCommand(9),)))
        await board.release(3)

    robot.ask(prepare)
    said = robot("run", "macro", "2", "--json")
    assert (said.json["idle_servos"], said.err) == ([], ""), "servo 3 is not used"
    robot.ask(lambda board: board.release(1))
    warned = robot("run", "macro", "2", "--json")
    assert warned.json["idle_servos"] == [1]
    assert warned.err == "servolink: servo 1 is stopped or released and will not move; --start starts and holds first\n"
    missing = robot("run", "macro", "3").err
    assert missing == (
        "servolink: macro 3 'Broken' was not run: macro 3 'Broken' runs action 9, which could not be read\n"
    )


def test_what_exceeds_limits_is_not_run_and_starts_no_servo(robot: Robot) -> None:
    async def prepare(board: ClientBoard) -> None:
        await board.add_action(Action(1, "Bow", (Step(1, 80, 100),)))
        await board.add_macro(Macro(2, "Greet", (MacroCommand(1, loop=2),)))
        await board.release()

    robot.ask(prepare)
    before = [servo.angle for servo in robot.board.servos.values()]
    for kind, label in (("action", "action 1 'Bow'"), ("macro", "macro 2 'Greet'")):
        record_id = label.split()[1]
        for limit, words in (
            (("--limit", "-60", "60"), "step 1 asks servo 1 to go to 80 degrees; its limits are -60..60"),
            (("--speed-cap", "40"), "degrees/s; its cap is 40"),
        ):
            said = robot("run", kind, record_id, "--start", *limit)
            assert (said.code, said.out) == (1, "")
            assert said.err.startswith(f"servolink: {label} was not run: ")
            assert said.err.endswith(f"{words} (from an argument)\n")
    assert not any(servo.is_hold for servo in robot.board.servos.values())
    assert [servo.angle for servo in robot.board.servos.values()] == before
    assert robot("run", "macro", "2", "--limit", "60", "-60").code == 2


def test_a_soft_start_comes_before_the_run(robot: Robot) -> None:
    robot.ask(lambda board: board.add_action(Action(1, "Bow", (Step(1, 80, 100),))))
    assert (
        robot("run", "action", "1", "--soft-start", "20").out
        == "action 1 'Bow' was started; it takes 1 s and moves servo 1\n"
    )
    assert robot.board.servos[1].angle == 80
    assert robot("move", "1=40", "--soft-start", "20", "--json").json["duration_seconds"] == 2.0


@pytest.mark.parametrize(
    ("target", "problem"),
    [
        ("1=45.5", "the angle of servo 1 must be a whole number of degrees, not 45.5"),
        ("1=40000", "the angle of servo 1 must be from -32768 to 32767, not 40000"),
        ("255=1", "'255=1' is not of the form SERVO=ANGLE; the servo must be an integer from 0 to 254, not '255'"),
        ("=1", "'=1' is not of the form SERVO=ANGLE, as in 1=90, hip=-45 or all=0"),
        ("hip=x", "the angle of 'hip' must be a whole number of degrees, not x"),
        ("1", "'1' is not of the form SERVO=ANGLE"),
    ],
)
def test_a_wrong_angle_is_explained(target: str, problem: str, capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "-b", "virtual://", "move", target)
    assert (said.code, said.out) == (2, "")
    assert problem in said.err


def test_a_servo_that_cannot_turn_that_far_is_said_to_be(robot: Robot) -> None:
    said = robot("move", "1=400", "--duration", "0.5", "--any-angle")
    assert (said.code, said.out) == (1, "")
    assert "servo 1 is at 180, not at 400" in said.err
    assert "unable to turn that far" in said.err


def test_more_than_a_turn_is_refused_unless_limits_or_the_user_allow_it(robot: Robot) -> None:
    said = robot("move", "1=9999")
    assert (said.code, said.out) == (1, "")
    assert "servo 1: 9999 degrees is beyond ±360, and no limits say that it can turn that far" in said.err
    assert not robot.board.servos[1].moving
    assert "outside its limits 0..400" in robot("move", "1=401", "--limit", "0", "400").err
    assert robot("move", "1=361", "--limit", "0", "400", "--no-wait").code == 0
    assert robot("move", "1=9999", "--adc", "--duration", "1", "--no-wait").code == 0


def test_one_servo_is_not_called_servos(capsys: pytest.CaptureFixture[str]) -> None:
    said = call(capsys, "-b", "virtual://?servos=1", "stop")
    assert said.out.startswith("the only servo reports that it is stopped and held\n")


@pytest.mark.parametrize(
    ("command", "described", "line"),
    [
        ("actions", {"action_id": 1, "action_caption": "Bow"}, r"^ +1 +Bow$"),
        ("macros", {"macro_id": 4, "macro_caption": "Wave"}, r"^ +4 +Wave$"),
        ("tables", {"table_id": 3, "table_caption": "Pad", "is_active": True}, r"^ +3 +Pad +yes$"),
    ],
)
def test_lists(board: Board, command: str, described: dict[str, object], line: str) -> None:
    assert board(command, "--json").json == {command.replace("tables", "joystick_tables"): [described]}
    text = board(command).out
    assert plain(text)
    assert re.search(line, text, re.MULTILINE)


@pytest.mark.parametrize("command", ["actions", "macros", "tables"])
def test_empty_lists(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(capsys, "--url", "virtual://", command, "--json").json == {
        command.replace("tables", "joystick_tables"): []
    }
    assert re.fullmatch(r"no .+ is stored on the board\n", call(capsys, "--url", "virtual://", command).out)


def test_one_action(board: Board) -> None:
    assert board("actions", "1", "--json").json == {
        "action_id": 1,
        "action_caption": "Bow",
        "steps": [
            {"servo_id": 1, "degree": 30, "interval_ms": 50},
            {"servo_id": 2, "degree": -30, "interval_ms": 100},
        ],
    }
    assert re.fullmatch(r"action 1 'Bow'\nservo .*\n +1 +30 +0\.05\n +2 +-30 +0\.1\n", board("actions", "1").out)


def test_one_macro(board: Board) -> None:
    common = {"ratio_percent": 100, "loop": 1, "total_interval_ms": 500}
    assert board("macros", "4", "--json").json["commands"] == [
        {"type": "action", "action_id": 1, "ratio_percent": 50, "loop": 2, "total_interval_ms": 0},
        {"type": "delay", "delay_ms": 500, **common},
    ]
    assert re.search(r"^wait 0\.5 s +100 +1 +0\.5$", board("macros", "4").out, re.MULTILINE)


def test_one_table(board: Board) -> None:
    assert board("tables", "3", "--json").json["buttons"] == [
        {
            "button_id": 7,
            "button_caption": "wave",
            "button_press_macro": 4,
            "button_long_press_macro": 0,
            "button_up_macro": 0,
            "uninterruptible": 1,
        }
    ]
    assert re.search(r"^ +7 +wave +4 +yes$", board("tables", "3").out, re.MULTILINE)


def test_bench(board: Board) -> None:
    described = board("bench", "--requests", "20", "--json").json
    assert [result["request"] for result in described["results"]] == [
        "QueryMemorySizeRequest",
        "QueryServoRequest",
        "QueryActionListRequest",
    ]
    for result in described["results"]:
        assert result["requests_per_second"] > 0
        times = result["round_trip_seconds"]
        assert 0 < times["p50"] <= times["p90"] <= times["p99"]
    assert described["stats"]["frames_received"] >= 3 * 20
    said = board("bench", "--requests", "5")
    assert (len(said.out.splitlines()), said.err) == (6, "")


def test_bench_shows_how_far_it_is(url: str) -> None:
    said = in_terminal("--url", url, "bench", "--requests", "50")
    assert said.code == 0
    for what in ("shortest response: free memory", "state of all servos", "list of actions"):
        assert re.search(rf"{what} \S*\x1b.* \S*50/50", said.out), "the last picture of each bar"


def test_programs_reach_the_board_as_functions_do(url: str) -> None:
    said = program("servos", "--json", SERVOLINK_URL=url)
    assert (said.code, said.err) == (0, "")
    assert len(said.json["servos"]) == 16
    assert program("--url", url, "info").out.startswith("board  ")


def test_events_until_there_are_enough(tmp_path_factory: pytest.TempPathFactory) -> None:
    script = tmp_path_factory.mktemp("buttons") / "script"
    script.write_text("\n".join(f"{at / 5} press 3" for at in range(1, 100)), encoding="utf-8")
    server = started("virtual", "--tcp", "127.0.0.1:0", "--script", str(script))
    assert server.stdout is not None
    address = server.stdout.readline().split()[1]
    said = in_pipe("--url", address, "events", "--count", "3", "--json")
    text = in_pipe("--url", address, "events", "--count", "1")
    assert said.code == 0
    assert {(event["button_id"], event["event"], event["kind"]) for event in said.objects} == {
        (3, 1, "press"),
        (3, 4, "up"),
    }
    assert len(said.objects) == 3
    assert re.fullmatch(r" +\d\.\d{3} s  button 3  (press|up)\n", text.out)


def test_events_for_a_time(board: Board) -> None:
    said = board("events", "--seconds", "0.05")
    assert (said.code, said.out) == (0, "")
    assert said.err == "listening for button events; Ctrl-C ends it\n"


@pytest.mark.parametrize(("command", "sign"), [("servos", "─"), ("info", "battery"), ("macros", "─")])
def test_tables_are_drawn_on_a_terminal(url: str, command: str, sign: str) -> None:
    said = in_terminal("--url", url, command)
    assert said.code == 0
    assert sign in said.out


def test_a_move_is_drawn_on_a_terminal(url: str) -> None:
    said = in_terminal("--url", url, "move", "1=-60", "--duration", "0.2", "--start")
    assert said.code == 0
    assert "█" in said.out
    assert "-60°" in said.out
    assert "servo 2 " not in said.out, "only the servos that were asked for are shown"
