"""Projects, plans and servos as text and as tables in notebooks: short, and safe whatever a board stores."""

from __future__ import annotations

import asyncio
import xml.etree.ElementTree as ET
from typing import Any

import servolink
from servolink import Action, Adc, Button, Degrees, JoystickTable, Macro, Project, Servo, build_project
from servolink.client import Servos
from servolink.project.transfer.results import Change, Plan

HOSTILE = "<script>1</script>&amp;\u202e"


def project() -> Project:
    up = Action.pose("up", {1: 60, 2: 45}, seconds=0.2)
    wave = Macro.of("wave", up, 0.3)
    return build_project(wave, JoystickTable.of(HOSTILE, Button.of(3, press=wave)), captions={1: "hip"}, project_id=7)


def plan(*changes: Change) -> Plan:
    return Plan(changes, ("action 3 is listed more than once",), 12, 300, 0.25, None, is_unfinished=False)


def cells(thing: Any) -> list[list[str]]:
    """Return the cells of a table, as a browser reads them."""
    rows = ET.fromstring(thing._repr_html_()).iter("tr")  # noqa: S314 - our own, and it must be well-formed
    return [[cell.text or "" for cell in row] for row in rows]


def test_a_project_shows_how_much_it_holds() -> None:
    assert repr(project()) == (
        "Project(project_id=7, servo_parameters=<1>, actions=<1>, macros=<1>, joystick_tables=<1>, "
        "active_joystick_table=None)"
    )


def test_a_project_is_a_table_of_its_records() -> None:
    assert cells(project()) == [
        ["record", "id", "caption", "holds"],
        ["servo parameter", "1", "hip", "corrected by 0°"],
        ["action", "1", "up", "2 steps, 0.2 s"],
        ["macro", "1", "wave", "2 commands"],
        ["joystick table", "1", "<script>1</script>&amp;\\u202e", "1 button"],
    ]
    assert "<caption>project 7</caption>" in project()._repr_html_()
    assert "<caption>project without id</caption>" in Project()._repr_html_()


def test_a_plan_shows_how_much_it_changes() -> None:
    assert repr(plan(Change("action 1", None, Action(1, "up")))) == (
        "Plan(changes=<1>, inconsistencies=<1>, requests=12, wire_bytes=300, seconds=0.25, memory=None, "
        "is_unfinished=False)"
    )


def test_a_plan_is_a_table_of_its_changes() -> None:
    added = Change("action 1", None, Action.pose(HOSTILE, {1: 5}))
    removed = Change("macro 2", Macro(2, "old"), None)
    assert cells(plan(added, removed, Change("project id", 0, 7))) == [
        ["record", "on the board", "afterwards"],
        ["action 1", "-", "'<script>1</script>&amp;\\u202e': 1 step, 1 s"],
        ["macro 2", "'old': 0 commands", "-"],
        ["project id", "0", "7"],
        ["action 3 is listed more than once", "", "corrected"],
    ]


def test_servos_are_a_table() -> None:
    servos = Servos(
        [
            Servo(1, Degrees(22), 40, 250, 1, is_start=True, is_hold=True),
            Servo(2, Adc(-3), 40, 250, 1, is_start=False, is_hold=True),
            Servo(3, 5, 40, 250, 1, is_start=False, is_hold=False),
        ]
    )
    assert cells(servos) == [
        ["servo", "angle", "state", "current (raw)", "temperature (raw)", "type"],
        ["1", "22°", "ready", "40", "250", "1"],
        ["2", "-3", "stopped", "40", "250", "1"],
        ["3", "5", "released", "40", "250", "1"],
    ]
    assert cells(servos[1]) == [cells(servos)[0], cells(servos)[2]]
    assert servos == tuple(servos)


def test_a_board_is_a_table_too() -> None:
    with servolink.sync.connect("virtual://?servos=2") as board:
        assert cells(board) == [["board", "address", "state"], ["", "virtual://?servos=2", "connected"]]


def test_what_a_board_returns_is_a_table() -> None:
    async def main() -> tuple[Servo, ...]:
        async with servolink.connect("virtual://?servos=2") as board:
            return await board.servos()

    assert len(cells(asyncio.run(main()))) == 3
