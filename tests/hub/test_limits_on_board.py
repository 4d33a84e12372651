"""Roles, limits and units through a hub: what is refused to raw programs, and what keeps its place.

Module: servolink.hub.engine.unit_switch.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.boards import SafetyLimits
from servolink.control import RefusedNotice, Role
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    Packet,
    Query,
    QueryActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    Step,
    WriteProjectIDRequest,
)
from tests.client.piped_board import SWALLOWED, late, lie
from tests.control.test_roles import REQUESTS, example
from tests.hub.raw_program import RawProgram
from tests.hub.shared_world import MOVE, STOP, World, on_hub

# --- roles and limits -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("role", list(Role))
def test_only_what_a_role_allows_reaches_the_board(role: Role) -> None:
    async def use(there: World) -> None:
        program = there.join("program", role=role)
        names = [name for name in REQUESTS if name != "TransmissionModeSettingRequest"]
        for name in names:
            program.send(example(name))
            await asyncio.sleep(20)
        allowed = {name for name in names if Role.needed_for(example(name)) <= role}
        assert {type(packet).__name__ for _, packet in there.fake.executed} == allowed | {"SetAngleUnitRequest"}
        assert {one.packet for one in there.of(RefusedNotice)} == set(names) - allowed
        assert program.session.counters.refused == len(names) - len(allowed)

    on_hub(use)


@pytest.mark.parametrize(
    ("packet", "unit", "words"),
    [
        (ExecuteActionRequest((Step(1, 31, 300),)), "degree", "31 degrees is outside its limits -30..30"),
        (ExecuteActionRequest((Step(1, 30, 1),)), "degree", "its cap is 60"),
        (ExecuteActionExRequest(2), "degree", "asks servo 1 to go to 90 degrees"),
        (ExecuteMacroRequest(2), "degree", "asks servo 1 to go to 90 degrees"),
        (ExecuteMacroRequest(3), "degree", "never ends"),
        (ExecuteActionRequest((Step(1, 2048, 300),)), "adc", "not set to degrees"),
        (ExecuteActionExRequest(1), "adc", "not set to degrees"),
    ],
)
def test_limits_of_the_board_hold_for_raw_programs(packet: Packet, unit: Any, words: str) -> None:
    async def use(there: World) -> None:
        program = there.join("program", unit=unit)
        assert not await there.move(program, packet)
        await asyncio.sleep(20)
        assert there.motions == []
        assert [words in one.reason for one in there.of(RefusedNotice)] == [True]
        assert program.heard == ([ExecuteMacroResponse(0)] if isinstance(packet, ExecuteMacroRequest) else [])

    on_hub(use, SafetyLimits(angles={1: (-30, 30)}, speed_cap=60))


def test_motion_within_the_limits_is_sent_and_keeps_its_place() -> None:
    async def use(there: World) -> None:
        program = there.join("program")
        program.send(MOVE)
        program.send(WriteProjectIDRequest(5))  # must not overtake the movement, which is checked first
        program.send(SetAngleUnitRequest(ALL_SERVOS, 1))
        program.send(QueryServoRequest(1))
        await asyncio.sleep(1)
        sent = [type(packet) for _, packet in there.fake.executed if not isinstance(packet, Query)]
        assert sent == [SetAngleUnitRequest, ExecuteActionRequest, WriteProjectIDRequest, SetAngleUnitRequest]
        assert there.of(RefusedNotice) == []

    on_hub(use, SafetyLimits(speed_cap=60), depth=4)


def test_movements_that_are_checked_first_are_not_disturbed_by_programs_with_other_units() -> None:
    async def use(there: World) -> None:
        mover, reader = there.join("mover"), there.join("reader", unit="adc")
        for _ in range(20):
            mover.send(MOVE)
            reader.send(QueryServoRequest(1))
            await asyncio.sleep(0.011)
        await asyncio.sleep(2)
        assert len(there.motions) == 20
        assert len(reader.heard) == 20
        assert there.of(RefusedNotice) == []

    on_hub(use, SafetyLimits(speed_cap=60), depth=4)


def test_a_servo_outside_its_limits_comes_back_in_small_steps_of_any_program() -> None:
    async def use(there: World) -> None:
        program = there.join("program")
        there.fake.servos[1].angle = 170.0
        for angle, is_sent in (
            (172, False),
            (150, False),
            (161, True),
            (140, False),
            (152, True),
            (-91, False),
            (20, True),
        ):
            assert await there.move(program, ExecuteActionRequest((Step(1, angle, 100),))) == is_sent, angle
            await asyncio.sleep(2)
        assert all("outside its limits -90..90" in one.reason for one in there.of(RefusedNotice))

    on_hub(use, SafetyLimits(angles={1: (-90, 90)}))


def test_a_unit_that_is_perhaps_set_is_set_again_before_limits_are_checked() -> None:
    async def use(there: World) -> None:
        program = there.join("program")
        assert await there.move(program)
        there.fake.plan(SetAngleUnitRequest, *[SWALLOWED] * 40)
        assert await program.ask(SetAngleUnitRequest(1, 1)) is None
        there.fake.forget_plans()
        assert await program.ask(SetAngleUnitRequest(2, 1)) is not None
        assert await there.move(program, ExecuteActionRequest((Step(1, 20, 300),)))  # in degrees, as it was told
        assert await program.ask(QueryServoRequest(2)) is not None
        assert [one.reason for one in there.of(RefusedNotice)] == []
        units = {servo.servo_id: servo.unit for servo in there.fake.servos.values()}
        assert units == {1: 0, 2: 1, 3: 0, 4: 0}

    on_hub(use, SafetyLimits(angles={1: (-90, 90)}))


def test_nobody_waits_for_the_soft_start_of_another_program() -> None:
    async def use(there: World) -> None:
        ann, bob, cid = there.join("ann"), there.join("bob", unit="adc"), there.join("cid")
        ann.send(ExecuteActionExRequest(1))  # goes softly to its first pose for 3 s
        await asyncio.sleep(0.5)
        assert len(there.motions) == 1
        assert await bob.ask(QueryServoRequest(1), 0.1) is None  # which has other units
        for _ in range(3):
            assert await cid.ask(QueryServoListRequest(), 0.1) is not None
            assert await cid.ask(QueryServoRequest(1), 0.1) is not None
            assert await cid.ask(QueryActionRequest(1), 0.1) is not None
        assert await cid.ask(WriteProjectIDRequest(5), 0.1) is not None
        await asyncio.sleep(10)
        assert await bob.ask(QueryServoRequest(1), 0.1) is not None

    on_hub(use, SafetyLimits(soft_start=10))


def test_nothing_with_angles_is_sent_if_the_board_refuses_its_units() -> None:
    async def use(there: World) -> None:
        program = there.join("program", unit="adc")
        there.fake.usual_of[SetAngleUnitRequest] = lie(SetAngleUnitResponse(0, 0))
        assert not await there.move(program)
        assert await program.ask(QueryServoRequest(1), 5) is None
        assert there.fake.executed_of(QueryServoRequest) == []
        there.fake.forget_plans()
        assert await program.ask(QueryServoRequest(1), 5) is not None
        assert there.fake.servos[1].unit == 1

    on_hub(use)


@pytest.mark.virtual_only("the firmware sends no response for a servo that does not exist")
def test_a_unit_that_the_board_refuses_is_not_that_of_the_program() -> None:
    async def use(there: World) -> None:
        program = there.join("program")
        assert await program.ask(SetAngleUnitRequest(9, 1)) == SetAngleUnitResponse(0, 0)
        there.fake.plan(SetAngleUnitRequest, lie(SetAngleUnitResponse(1, 0)))
        assert await program.ask(SetAngleUnitRequest(1, 1)) == SetAngleUnitResponse(1, 0)
        assert await program.ask(QueryServoRequest(1)) is not None
        assert there.fake.servos[1].unit == 0

    on_hub(use)


# --- units of a running macro -----------------------------------------------------------------------------------------


async def is_read(program: RawProgram, seconds: float = 0.1) -> bool:
    """Return whether a program is told within some time where a servo is."""
    return await program.ask(QueryServoRequest(1), seconds) is not None


def test_other_units_wait_for_the_end_of_a_macro() -> None:
    async def use(there: World) -> None:
        ann, bob, cid = there.join("ann"), there.join("bob", unit="adc"), there.join("cid")
        assert await ann.ask(ExecuteMacroRequest(1)) == ExecuteMacroResponse(1)
        assert await is_read(cid)
        assert not await is_read(bob, 5)  # the macro takes 4 s
        assert await bob.ask(SetAngleUnitRequest(1, 1)) == SetAngleUnitResponse(1, 1)
        assert await is_read(bob)
        assert [one.reason for one in there.of(RefusedNotice)] == [
            "another program runs a stored record, whose angles are in other units than those of this program"
        ]

    on_hub(use)


def test_a_unit_that_a_program_has_already_is_not_refused() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob", unit="adc")
        await ann.ask(ExecuteMacroRequest(1))
        assert await bob.ask(SetAngleUnitRequest(ALL_SERVOS, 1)) == SetAngleUnitResponse(ALL_SERVOS, 1)
        assert await bob.ask(SetAngleUnitRequest(2, 1)) == SetAngleUnitResponse(2, 1)
        assert await bob.ask(SetAngleUnitRequest(ALL_SERVOS, 0)) == SetAngleUnitResponse(ALL_SERVOS, 0)
        assert there.of(RefusedNotice) == []

    on_hub(use)


def test_a_stop_ends_the_macro_for_its_units_too() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob", unit="adc")
        there.fake.usual_of[QueryActionRequest] = late(1.0)  # read to know how long the macro takes
        ann.send(ExecuteMacroRequest(1))
        await asyncio.sleep(0.5)
        assert not await is_read(bob)
        assert await bob.ask(STOP) is not None
        assert await is_read(bob, 0.7)
        await asyncio.sleep(1)
        assert await is_read(bob)

    on_hub(use, depth=4)


def test_a_macro_that_was_perhaps_started_keeps_its_units() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob", unit="adc")
        there.fake.plan(ExecuteMacroRequest, SWALLOWED)
        ann.send(ExecuteMacroRequest(1))
        await asyncio.sleep(3.5)
        assert ann.session.counters.unanswered == 1
        before = len(there.of(RefusedNotice))
        bob.send(QueryServoRequest(1))
        await asyncio.sleep(0.1)
        assert len(there.of(RefusedNotice)) == before + 1

    on_hub(use)


def test_a_macro_that_the_board_refuses_keeps_no_units() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob", unit="adc")
        assert await ann.ask(ExecuteMacroRequest(9)) == ExecuteMacroResponse(0)
        assert await is_read(bob)

    on_hub(use)
