"""Movements of the control interface: planned once, by the hub, when they are sent."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from servolink.boards import SafetyLimits
from servolink.control import Greeting
from servolink.hub.methods.control_session import ControlInterface
from servolink.protocol import ExecuteActionRequest, QueryServoListRequest, QueryServoRequest, SetAngleUnitRequest, Step
from tests.client.piped_board import late
from tests.hub.control_program import RpcFailed, RpcProgram
from tests.hub.shared_world import World, on_hub

LIMITS = SafetyLimits(angles={1: (-90, 90)}, speed_caps={1: 45})


def with_page(use: Callable[[World, RpcProgram], Awaitable[None]], limits: SafetyLimits | None = None) -> None:
    """Run `use` with a program on the control interface of a hub."""

    async def main(there: World) -> None:
        interface = ControlInterface(there.hub)
        page = RpcProgram(there.hub, interface, Greeting(wants="rpc", who="page", role="edit"))
        await use(there, page)
        await page.channel.close()
        await interface.close()

    on_hub(main, limits)


def sent(there: World, kind: type[object]) -> int:
    """Return how many packets of a kind the board got."""
    return sum(isinstance(packet, kind) for _, packet in there.fake.executed)


def test_the_servos_are_read_once_for_a_movement_under_limits() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        await page.call("move", targets={"1": 10}, duration=1)
        before = sent(there, QueryServoRequest)
        assert await page.call("move", targets={"1": 20}, speed=20) == {"seconds": 1.0}
        assert sent(there, QueryServoRequest) == before + 1
        assert there.motions[-1] == ExecuteActionRequest((Step(1, 20, 100),))

    with_page(use, LIMITS)


def test_a_movement_without_limits_asks_the_board_nothing_more_after_the_first() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        await page.call("move", targets={"1": 10}, duration=1)
        before = len(there.fake.executed)
        await page.call("move", targets={"1": 20}, duration=1)
        assert [packet for _, packet in there.fake.executed[before:]] == [ExecuteActionRequest((Step(1, 20, 100),))]

    with_page(use)


def test_a_dry_run_plans_without_the_lease_and_moves_nothing() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        other = there.join("other")
        assert await there.move(other)
        moved = len(there.motions)
        assert await page.call("move", targets={"1": 20}, duration=1, dry_run=True) == {"seconds": 1.0}
        with pytest.raises(RpcFailed, match="other"):
            await page.call("move", targets={"1": 20}, duration=1)
        assert len(there.motions) == moved

    with_page(use)


def test_a_dry_run_names_stopped_servos_and_not_a_stop_that_came_earlier() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        await page.call("stop")
        with pytest.raises(RpcFailed, match="stopped or released") as failed:
            await page.call("move", targets={"1": 20}, duration=1, dry_run=True)
        assert "a stop came first" not in str(failed.value)
        assert await page.call("move", targets={"1": 20}, duration=1, dry_run=True, start=True) == {"seconds": 1.0}

    with_page(use)


def test_a_dry_run_that_a_stop_overtakes_says_so() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        there.fake.plan(QueryServoListRequest, late(0.5))
        planning = page.begin("move", targets={"1": 20}, duration=1, dry_run=True)
        await asyncio.sleep(0.1)
        await there.hub.stop("somebody")
        with pytest.raises(RpcFailed, match="a stop came first"):
            await planning

    with_page(use)


def test_a_refused_movement_takes_no_lease() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        with pytest.raises(RpcFailed, match="outside its limits") as failed:
            await page.call("move", targets={"1": 95}, duration=9)
        assert failed.value.kind == "MotionRefused"
        assert there.hub.lease is None

    with_page(use, LIMITS)


@pytest.mark.parametrize("limits", [None, LIMITS])
def test_what_was_planned_before_a_stop_is_never_sent_after_it(limits: SafetyLimits | None) -> None:
    async def use(there: World, page: RpcProgram) -> None:
        await page.call("move", targets={"1": 10}, duration=1)
        moved = len(there.motions)
        there.fake.plan(QueryServoListRequest, late(0.5))
        blocking = there.join("other")
        blocking.send(QueryServoListRequest())
        await asyncio.sleep(0.1)
        moving = page.begin("move", targets={"1": 20}, duration=1)
        await asyncio.sleep(0.1)
        await there.hub.stop("somebody")
        with pytest.raises(RpcFailed, match="stop"):
            await moving
        await asyncio.sleep(2)
        assert len(there.motions) == moved

    with_page(use, limits)


def test_a_movement_in_degrees_follows_a_program_with_raw_angles() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        other = there.join("other")
        await other.ask(SetAngleUnitRequest(255, 1))
        await page.call("move", targets={"1": 20}, duration=1)
        units = [packet for _, packet in there.fake.executed if isinstance(packet, SetAngleUnitRequest)]
        assert units[-1].unit_type == 0
        assert there.motions == [ExecuteActionRequest((Step(1, 20, 100),))]

    with_page(use)


def test_programs_with_the_same_unit_set_it_once() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        await page.call("servos.list")
        await page.call("move", targets={"1": 20}, duration=0.1, wait=True)
        await page.call("servo.set", servo=1, start=True, hold=True)
        await page.call("servos.list")
        assert sent(there, SetAngleUnitRequest) == 1

    with_page(use)


def test_stopped_servos_are_started_with_the_movement_and_by_the_same_permission() -> None:
    async def use(there: World, page: RpcProgram) -> None:
        await page.call("stop")
        with pytest.raises(RpcFailed, match="stopped or released"):
            await page.call("move", targets={"1": 20}, duration=1)
        assert await page.call("move", targets={"1": 20}, duration=1, start=True, wait=True) == {"seconds": 1.0}
        assert [type(packet).__name__ for packet in there.motions] == [
            "SetServoParameterRequest",
            "ExecuteActionRequest",
        ]
        assert there.fake.servos[1].angle == 20

    with_page(use)
