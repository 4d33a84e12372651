"""Everything that can be asked of a board."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

from servolink.client import Board, Servo
from servolink.project import Project
from servolink.protocol import (
    Action,
    AddActionRequest,
    Button,
    ExecuteActionRequest,
    JoystickTable,
    Macro,
    MacroCommand,
    QueryServoRequest,
    ServoParameter,
    Step,
)

Call = Callable[[Board], Awaitable[Any]]

ACTION = Action(1, "wave", (Step(1, 30, 5), Step(2, -30, 10)))
MACRO = Macro(4, "dance", (MacroCommand(1, loop=2), MacroCommand(500, 1, total_interval=500)))
TABLE = JoystickTable(3, "pad", (Button(7, "wave", button_press_macro=4),))
PROJECT = Project(77, (ServoParameter(2, 5, "left knee"),), (ACTION,), (MACRO,), (TABLE,), 3)


async def _two_events(board: Board) -> int:
    events = 0
    async with board.button_events(8) as coming:
        try:
            async with asyncio.timeout(2.0):
                async for _ in coming:
                    events += 1
                    if events == 2:
                        break
        except TimeoutError:
            pass
    return events


async def _three_readings(board: Board) -> int:
    async with board.watch(50) as readings:
        return sum([(await anext(readings)).missed for _ in range(3)])


async def _followed(readings: AsyncIterator[tuple[Servo, ...]]) -> int:
    return len([servos async for servos in readings])


async def _two_set_points(board: Board) -> list[object]:
    stream = board.stream()
    return [await stream.send({1: angle}) for angle in (5, 6)]


def calls(folder: Path) -> dict[str, Call]:
    """Return a call of each method of a board, by the method's name; files go into `folder`."""
    return {
        "request": lambda board: board.request(QueryServoRequest(1)),
        "send": lambda board: board.send(ExecuteActionRequest((Step(1, 5, 10),))),
        "servo_ids": lambda board: board.servo_ids(),
        "servos": lambda board: board.servos(),
        "watch": _three_readings,
        "servo": lambda board: board.servo(2),
        "set_servo": lambda board: board.set_servo(1, start=True, hold=True),
        "set_angle_unit": lambda board: board.set_angle_unit("adc", 1),
        "move": lambda board: board.move({1: 20, "left knee": -20}, speed=60, wait=True),
        "follow": lambda board: _followed(board.follow({1: 2, 2: 3}, 0.2)),
        "stream": _two_set_points,
        "run_action": lambda board: board.run_action(1, wait=True),
        "play": lambda board: board.play(PROJECT, "dance"),
        "stop": lambda board: board.stop(),
        "release": lambda board: board.release(),
        "set_transmission_mode": lambda board: board.set_transmission_mode(1),
        "clear_all_data": lambda board: board.clear_all_data(),
        "memory": lambda board: board.memory(),
        "battery": lambda board: board.battery(),
        "send_dummy_data": lambda board: board.send_dummy_data(b"data"),
        "actions": lambda board: board.actions(),
        "action": lambda board: board.action(1),
        "add_action": lambda board: board.add_action(ACTION),
        "delete_action": lambda board: board.delete_action(1),
        "macros": lambda board: board.macros(),
        "macro": lambda board: board.macro(4),
        "add_macro": lambda board: board.add_macro(MACRO),
        "delete_macro": lambda board: board.delete_macro(4),
        "run_macro": lambda board: board.run_macro("dance", wait=True),
        "servo_parameters": lambda board: board.servo_parameters(),
        "add_servo_parameters": lambda board: board.add_servo_parameters([ServoParameter(1, 3, "knee")]),
        "project_id": lambda board: board.project_id(),
        "write_project_id": lambda board: board.write_project_id(5),
        "joystick_tables": lambda board: board.joystick_tables(),
        "joystick_table": lambda board: board.joystick_table("pad"),
        "add_joystick_table": lambda board: board.add_joystick_table(TABLE),
        "delete_joystick_table": lambda board: board.delete_joystick_table(3),
        "active_joystick_table": lambda board: board.active_joystick_table(),
        "set_active_joystick_table": lambda board: board.set_active_joystick_table(3),
        "button_events": _two_events,
        "took_effect": lambda board: board.took_effect(AddActionRequest(1, "wave", ACTION.steps)),
        "has_unfinished_import": lambda board: board.has_unfinished_import(),
        "export_project": lambda board: board.export_project(),
        "plan_project": lambda board: board.plan_project(PROJECT),
        "apply_project": lambda board: board.apply_project(PROJECT, folder=folder),
        "rollback_project": lambda board: board.rollback_project(folder=folder),
    }
