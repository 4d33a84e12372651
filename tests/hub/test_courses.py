"""Lag of servos: how far they are from the angles that they should have by now, where the hub knows these.

Module: servolink.hub.rules.courses.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.hub.rules.courses import Courses
from servolink.motion import AngleUnit
from servolink.protocol import (
    Action,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    Macro,
    MacroCommand,
    Packet,
    SetServoParameterRequest,
    Step,
)
from tests.hub.control_program import RpcProgram, shared


def degrees(servo_id: int) -> AngleUnit:
    return "degree"


def moved(*steps: Step, unit: AngleUnit = "degree") -> Courses:
    """Return the courses after a movement at 0 s to 10 degrees, and others at 10 s; an interval of 1 is 10 ms."""
    courses = Courses()
    courses.sent(ExecuteActionRequest((Step(1, 10, 100), Step(2, 10, 100))), 0.0, degrees, 0.01)
    courses.sent(ExecuteActionRequest(steps), 10.0, lambda servo_id: unit, 0.01)
    return courses


def test_a_course_leads_evenly_from_one_target_to_the_next() -> None:
    courses = moved(Step(1, 30, 100))
    assert [courses.lag(1, 10, now) for now in (10.0, 10.5, 11.0, 99.0)] == [0, 10, 20, 20]
    assert courses.lag(1, 35, 11.0) == 5
    assert courses.lag(3, 0, 11.0) is None


def test_without_a_known_start_a_course_is_known_from_its_end() -> None:
    courses = moved(Step(3, 30, 100))
    assert [courses.lag(3, 30, now) for now in (10.0, 10.9, 11.0)] == [None, None, 0]


@pytest.mark.parametrize(
    ("packet", "known"),
    [
        (ExecuteActionExRequest(1), set()),
        (SetServoParameterRequest(1, 1, 1), {2}),
        (SetServoParameterRequest(255, 1, 1), set()),
    ],
)
def test_what_turns_servos_in_other_ways_ends_their_courses(packet: Packet, known: set[int]) -> None:
    courses = moved()
    courses.sent(packet, 10.0, degrees, 0.01)
    assert {servo_id for servo_id in (1, 2) if courses.lag(servo_id, 0, 20.0) is not None} == known
    assert moved(Step(1, 500, 10), unit="adc").lag(1, 0, 20.0) is None


async def read(page: RpcProgram) -> list[tuple[int, int | None]]:
    """Return angle and lag of each servo."""
    return [(servo["angle"], servo.get("lag")) for servo in (await page.call("servos.list"))["servos"]]


async def test_watchers_are_told_the_lag_until_a_stop() -> None:
    async with shared() as here, here.program("page") as page:
        assert [lag for _, lag in await read(page)] == [None, None, None]
        await page.call("move", targets={"1": 60, "2": 60}, duration=0.1, wait=True)
        here.virtual.servos[2].angle = 50.0  # as if a load had pulled it
        assert await read(page) == [(60, 0), (50, 10), (6, None)]
        await page.call("servos.watch", hz=10)
        frame: dict[str, Any] = await page.until("servos")
        assert [servo.get("lag") for servo in frame["servos"]] == [0, 10, None]
        await page.call("stop")
        await asyncio.sleep(0.1)
        assert [lag for _, lag in await read(page)] == [None, None, None]


@pytest.mark.parametrize("is_prepared", [True, False])
async def test_after_a_stored_run_the_last_pose_is_expected_unless_something_else_was_sent(is_prepared: bool) -> None:
    async def run(page: RpcProgram) -> None:
        if is_prepared:
            await page.call("run.prepare", type="macro", id=1)
            await page.call("run.start")
        else:
            await page.call("run", type="macro", id=1)

    async with shared() as here, here.program("page") as page:
        await here.hub.board.add_action(Action(1, "a", (Step(1, 20, 100), Step(2, 30, 50))))
        await here.hub.board.add_macro(Macro(1, "m", (MacroCommand(1),)))
        await run(page)
        await asyncio.sleep(0.5)
        assert [lag for _, lag in await read(page)] == [None, None, None]
        await asyncio.sleep(2)
        assert await read(page) == [(20, 0), (30, 0), (6, None)]
        await run(page)
        await page.call("move", targets={"1": 25}, duration=0.1)
        await asyncio.sleep(3)
        assert [lag for _, lag in await read(page)] == [None, None, None]  # the run may have turned servo 1 again
        await page.call("move", targets={"1": 20}, duration=0.1, wait=True)
        assert [lag for _, lag in await read(page)] == [0, None, None]
