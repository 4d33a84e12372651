"""`servolink events` outlives the board's absence."""

from __future__ import annotations

from tests.cli.robot import Robot


def test_events_go_on_when_the_board_is_back(robot: Robot) -> None:
    robot.script("1 press 3\n9 press 4\n")
    robot.at(2.0, robot.unplug)
    robot.at(4.0, robot.plug_in)
    said = robot("events", "--json", "--count", "4")
    assert said.code == 0
    assert [(event["button_id"], event["kind"]) for event in said.objects] == [
        (3, "press"),
        (3, "up"),
        (4, "press"),
        (4, "up"),
    ]
    assert said.objects[2]["seconds"] > said.objects[1]["seconds"] + 7
    assert said.err.splitlines() == [
        "listening for button events; Ctrl-C ends it",
        "servolink: the connection is lost; trying to get it back",
        "servolink: the board is back",
    ]
