"""`servolink watch`: what it shows on a screen, in a pipe and in files, alarms, lost boards, and how it ends.

Modules: servolink.cli.motion.servo_output, servolink.cli.screen.servo_picture.
"""

from __future__ import annotations

import asyncio
import csv
import re
import signal
import sys
from argparse import Namespace
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from servolink.cli.command_session import Interruption
from servolink.cli.motion.watch import ReadingPrinter, Screen, _ReadingLoop
from servolink.cli.screen.servo_picture import Watched, picture
from servolink.client import Alarm, RaisedAlarm, Servo, ServoReading
from servolink.connection import Stats
from servolink.errors import RequestTimeout
from servolink.motion import Adc, Degrees, MotionLimits
from servolink.protocol import ButtonEventResponse, ServoParameter
from servolink.transports import Faults
from tests.cli.programs import in_terminal
from tests.cli.robot import Robot
from tests.virtual_time import run


def watched(*angles: int, **known: object) -> Watched:
    """Return a board with servos at these degrees."""
    watched = Watched("virtual://", 10.0, Stats())
    for name, value in known.items():
        setattr(watched, name, value)
    servos = (Servo(at, Degrees(angle), 40, 250, 1, is_start=True, is_hold=True) for at, angle in enumerate(angles, 1))
    watched.take(ServoReading(1.5, tuple(servos)))
    return watched


def texts(watched: Watched, width: int, height: int = 24) -> list[str]:
    return [text.rstrip() for text, _ in picture(watched, width, height, blocks=False)]


# --- the picture --------------------------------------------------------------------------------------------------


def test_the_picture_of_a_board() -> None:
    board = watched(0, 90, -180, captions={1: "hip", 3: "\x1b[2J"}, battery=87.3)
    board.press(ButtonEventResponse(4, 1), 1.25)
    assert texts(board, 80) == [
        "connected  1.5 s  battery 87.3 %  virtual://",
        "10 Hz, 0 missed; noise 0 bytes; 0 late, 0 repeated, 0 reconnects",
        "buttons: 4 press (1.2 s)",
        "",
        "servo          angle                                   current  temp.  state",
        "  1 hip           0°  ...............|...............       40    250  ready",
        "  2              90°  ...............|#######........       40    250  ready",
        r"  3 \x1b[2J    -180°  ###############|...............       40    250  ready",
        "bars: ±180° or the servo's limits; numbers are raw; q quits",
    ]


@pytest.mark.parametrize(
    ("angle", "limits", "bar"),
    [
        (0, None, "......|......"),
        (181, None, "......|#####>"),
        (-359, None, "<#####|......"),
        (0, (0, 120), "|............"),
        (60, (0, 120), "|######......"),
        (60, (30, 120), "|####........"),
        (20, (30, 120), "<............"),
        (-60, (-120, -30), "........####|"),
        (0, (9, 9), "......|......"),
    ],
)
def test_a_bar_lies_between_the_limits(angle: int, limits: tuple[float, float] | None, bar: str) -> None:
    board = watched(angle, limits=MotionLimits({} if limits is None else {1: limits}))
    line = next(line for line in texts(board, 37 + 5 + 13) if line.startswith("  1 "))
    assert line.split()[2] == bar


def test_an_angle_that_is_not_in_degrees_has_no_bar() -> None:
    board = watched()
    board.take(ServoReading(0.0, (Servo(1, Adc(512), 40, 250, 1, is_start=True, is_hold=False),)))
    assert texts(board, 80)[5].split() == ["1", "512", "ADC", "40", "250", "released"]


@pytest.mark.parametrize("width", [80, 60, 40, 20, 1])
@pytest.mark.parametrize("height", [50, 24, 20, 8, 1])
def test_the_picture_fits(width: int, height: int) -> None:
    board = watched(*range(0, 320, 20), captions={1: "左膝" * 10, 2: "x" * 31})
    board.raised.extend([(1.0, RaisedAlarm(Alarm.parse("current_raw>10"), 1, 40))] * 3)
    lines = texts(board, width, height)
    assert len(lines) <= height
    assert all(sum(2 if letter in "左膝" else 1 for letter in line) <= width for line in lines)


def test_without_bars_captions_take_their_room() -> None:
    board = watched(0, captions={1: "left knee"})
    assert "  1 left knee    0°       40    250  ready" in texts(board, 50)
    assert "  1 left    0°       40    250  ready" in texts(board, 40)


def test_servos_for_which_there_is_no_room_are_counted() -> None:
    lines = texts(watched(*range(16)), 80, 12)
    assert "11 more: a larger terminal shows them" in lines
    assert [line.split()[0] for line in lines[5:10]] == ["1", "2", "3", "4", "5"]
    assert "more" not in " ".join(texts(watched(*range(16), servo_ids=frozenset({7, 8})), 80, 12))


def test_a_servo_with_a_bad_value_is_marked() -> None:
    board = watched(0, alarms=[Alarm.parse("temperature_raw>240")])
    assert picture(board, 80, 24)[5][1] == "bold red"


def test_alarms_of_one_reading_are_drawn_with_it_at_once() -> None:
    async def main() -> list[int]:
        board, drawn = watched(0), list[int]()
        screen = Screen(board, lambda: drawn.append(len(board.raised)))
        for alarms in ((), (), tuple(RaisedAlarm(Alarm.parse("current_raw>10"), servo, 40) for servo in (1, 2))):
            board.take(ServoReading(1.5, (), 0, alarms))
            screen.reading()
            screen.alarms(alarms)
        return drawn

    assert run(main()) == [0, 2]


# --- in a pipe ----------------------------------------------------------------------------------------------------


def test_plain_lines(robot: Robot) -> None:
    robot.script("0.3 press 3\n")
    said = robot("watch", "1", "--hz", "2", "--seconds", "1.2")
    assert (said.code, said.err) == (0, "")
    header, *rows = said.out.splitlines()
    assert header.split() == ["seconds", "servo", "angle", "current_raw", "temperature_raw", "state"]
    assert [row.split()[1] for row in rows] == ["1", "button", "button", "1", "1"]
    assert all(re.fullmatch(r" +\d\.\d{3} +1 +-?\d+° +\d+ +\d+  ready", row) for row in rows if "button" not in row)


def test_an_object_for_each_reading(robot: Robot) -> None:
    robot.script("0.3 press 3\n")
    robot.ask(lambda board: board.add_servo_parameters([ServoParameter(2, 0, "左膝")]))
    said = robot("watch", "--hz", "2", "--seconds", "1.2", "--json", "--alarm", "temperature_raw>1")
    assert said.code == 0
    first, second, third = said.objects
    assert [servo["servo_caption"] for servo in first["servos"]] == [None, "左膝", None]
    assert first["battery_percent"] is None or first["battery_percent"] > 90
    assert third["battery_percent"] > 90
    assert [alarm["servo_id"] for alarm in first["alarms"]] == [1, 2, 3]
    assert first["alarms"][0] == {"alarm": "temperature_raw>1", "servo_id": 1, "value_raw": 250}
    assert [event["kind"] for event in second["button_events"]] == ["press", "up"]
    assert third["button_events"] == third["alarms"] == []
    assert third["missed"] == third["noise_bytes"] == third["reconnects"] == 0


def test_a_file_with_numbers_for_a_spreadsheet(robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "watch.csv"
    robot.ask(lambda board: board.add_servo_parameters([ServoParameter(1, 0, "=1+1")]))
    said = robot("watch", "--hz", "5", "--seconds", "1", "--csv", str(file))
    assert said.code == 0
    with file.open(newline="") as text:
        rows = list(csv.DictReader(text))
    assert len(rows) == 3 * 5
    for name in ("seconds", "servo_id", "angle", "current_raw", "temperature_raw", "missed"):
        assert all(float(row[name]) >= -180 for row in rows)
    assert {(row["angle_unit"], row["state"]) for row in rows} == {("degree", "ready")}
    assert "=" not in file.read_text()
    again = robot("watch", "--seconds", "1", "--csv", str(file))
    assert again.code == 2
    assert f"{file} exists; --yes replaces it" in again.err
    assert robot("watch", "--seconds", "0.1", "--csv", str(file), "--yes").code == 0
    assert len(file.read_text().splitlines()) == 4


def test_a_file_that_holds_something_else_is_not_replaced(robot: Robot, tmp_path: Path) -> None:
    file = tmp_path / "take.mcap"
    file.write_bytes(b"a recording")
    said = robot("watch", "--seconds", "0.1", "--csv", str(file), "--yes")
    assert said.code == 2
    assert said.err.endswith(f"{file} exists and holds no such rows, so it is not replaced; choose another name\n")
    assert file.read_bytes() == b"a recording"
    file.write_bytes(b"")
    assert robot("watch", "--seconds", "0.1", "--csv", str(file), "--yes").code == 0
    assert len(file.read_text().splitlines()) == 4


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_named(robot: Robot) -> None:
    said = robot("watch", "--csv", "/dev/full", "--yes")
    assert said.code == 1
    assert said.err.splitlines()[0] == "servolink: /dev/full cannot be written: No space left on device"


def test_a_servo_that_is_not_there(robot: Robot) -> None:
    said = robot("watch", "1", "9")
    assert (said.code, said.out, said.err) == (1, "", "servolink: the board has no servo 9\n")


def test_servos_are_chosen_by_caption(robot: Robot) -> None:
    robot.ask(lambda board: board.add_servo_parameters([ServoParameter(2, 0, "hip")]))
    said = robot("watch", "hip", "3", "--seconds", "0.05", "--json")
    assert [servo["servo_id"] for servo in said.objects[0]["servos"]] == [2, 3]


@pytest.mark.parametrize("rule", ["current_raw=3", "celsius>40"])
def test_an_alarm_that_cannot_be_is_wrong_usage(rule: str, robot: Robot) -> None:
    said = robot("watch", "--alarm", rule)
    assert (said.code, said.out) == (2, "")
    assert "argument --alarm: an alarm" in said.err


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
def test_a_terminal_that_cannot_draw_gets_lines() -> None:
    lines = in_terminal("-b", "virtual://?servos=1", "watch", "--seconds", "0.2", env={"TERM": "dumb"})
    assert lines.code == 0
    assert lines.out.startswith("  seconds  servo")
    assert "\x1b" not in lines.out


# --- alarms -------------------------------------------------------------------------------------------------------


def test_an_alarm_warns_once(robot: Robot) -> None:
    said = robot("watch", "1", "--seconds", "2", "--alarm", "temperature_raw>1")
    assert said.code == 0
    assert said.err.splitlines()[0] == "servolink: servo 1: temperature_raw is 250 (alarm temperature_raw>1)"
    assert len(said.err.splitlines()) == 3, "the other servos as well"
    assert robot.ask(lambda board: board.servo(1)).state == "ready"


def test_an_alarm_stops_the_robot(robot: Robot) -> None:
    robot.at(0.5, lambda: robot.meanwhile(lambda board: board.move({1: 90}, duration=5)))
    robot.at(3.0, lambda: signal.raise_signal(signal.SIGINT))
    said = robot("watch", "--hz", "20", "--alarm", "current_raw>100 for 0.2s", "--on-alarm", "stop")
    assert said.code == 0
    raised, ended = said.err.splitlines()
    assert re.fullmatch(
        r"servolink: servo 1: current_raw is \d+ \(alarm current_raw>100 for 0\.2s\); stopping all servos", raised
    )
    assert ended == "ended: an alarm has sent a stop to all servos"
    servo = robot.ask(lambda board: board.servo(1))
    assert servo.state == "stopped"
    assert servo.angle < 30
    assert "stopped" in said.out


def test_an_alarm_exits(robot: Robot) -> None:
    said = robot("watch", "--alarm", "temperature_raw>1", "--on-alarm", "exit", "--json")
    assert said.code == 1
    assert said.error == {
        "kind": "ServolinkError",
        "message": "servo 1: temperature_raw is 250 (alarm temperature_raw>1)",
    }
    assert len(said.objects) == 1


# --- lost boards and the end --------------------------------------------------------------------------------------


def test_watching_goes_on_when_the_board_is_back(robot: Robot) -> None:
    robot.at(2.0, robot.unplug)
    robot.at(4.0, robot.plug_in)
    said = robot("watch", "--seconds", "10", "--json")
    assert said.code == 0
    assert said.err.splitlines() == [
        "servolink: the connection is lost; trying to get it back",
        "servolink: the board is back",
    ]
    assert said.objects[-1]["seconds"] > 9
    assert said.objects[-1]["reconnects"] == 1


def test_a_board_that_does_not_answer_ends_it(robot: Robot) -> None:
    robot.faults = Faults(drop=1.0)
    assert robot("watch").code == 3


def test_ctrl_c(robot: Robot) -> None:
    robot.at(0.5, lambda: signal.raise_signal(signal.SIGINT))
    said = robot("watch")
    assert (said.code, said.err) == (0, "ended: no servo was moved\n")


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
@pytest.mark.parametrize("by", ["q", "\x03", signal.SIGTERM])
def test_the_terminal_is_as_before(by: str | signal.Signals) -> None:
    said = in_terminal("-b", "virtual://?servos=2", "watch", later=("q quits", by))
    assert said.code == 0
    for left, entered in (("\x1b[?1049l", "\x1b[?1049h"), ("\x1b[?25h", "\x1b[?25l")):
        assert said.out.count(left) == said.out.count(entered) == 1
        assert said.out.index(left) > said.out.index(entered)
    last = said.out[said.out.index("\x1b[?1049l") :]
    assert "connected" in last, "the last picture stays"
    assert ("ended: no servo was moved" in last) == (by != "q")


async def test_the_battery_is_asked_for_again_when_a_hub_has_its_board_back() -> None:
    class Shared:
        """A board that nobody answers for while its hub has lost it."""

        profile = None
        unanswered: frozenset[str] = frozenset()

        def __init__(self) -> None:
            self.state = "connected"
            self.asked = 0

        async def states(self) -> AsyncIterator[str]:
            for self.state in ("connected", "lost", "connected"):
                yield self.state
                await asyncio.sleep(5)

        async def battery(self) -> float:
            self.asked += 1
            await asyncio.sleep(7 if self.asked == 1 else 0)  # as long as a hub is waited for
            if self.asked == 1:
                raise RequestTimeout("nothing came")
            return 80.0

    board, shown = Shared(), watched(0)
    watch = _ReadingLoop(board, shown, Namespace(), ReadingPrinter(shown), Interruption("ended"))  # type: ignore[arg-type]
    tasks = [asyncio.create_task(each) for each in (watch._states(), watch._battery())]
    await asyncio.sleep(60)
    assert shown.battery == 80.0
    for task in tasks:
        task.cancel()
    await asyncio.wait(tasks)
