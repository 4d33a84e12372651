"""Permissions: for one motion, for ten seconds, void after a stop; and motions that end with whoever asked."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

import pytest

from servolink.client import connect
from servolink.errors import ConnectionLost, MotionRefused, NotFound, RequestRefused
from servolink.gateways import supervisor as module
from servolink.gateways.supervisor import Permission, SupervisedMotion, Supervisor
from servolink.protocol import ACTION, MACRO
from tests.gateways.robots import GUARD, RobotSeen, page_that_answers, shared_robot, supervised_robot

FAR = SupervisedMotion("move", {"targets": {"1": 90}, "duration": 5.0}, "move servo 1 to 90 degrees", 5.0)


def on_robot(use: Callable[[RobotSeen, Supervisor], Awaitable[None]], **options: Any) -> None:
    async def main() -> None:
        async with asyncio.timeout(GUARD), supervised_robot(**options) as (robot, supervisor):
            robot.motions.clear()
            await use(robot, supervisor)

    asyncio.run(main())


def test_a_permitted_motion_is_carried_out_once() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        motion = await supervisor.check_move({"1": 5}, 0.05, None)
        question = supervisor.ask(motion)
        assert question.text == "May the robot move servo 1 to 5 degrees? The motion lasts 0.1 s."
        permission = supervisor.answer(question.number, is_yes=True)
        assert robot.motions == []
        await supervisor.perform(permission)
        assert len(robot.motions) == 1
        with pytest.raises(MotionRefused, match="not open any more"):
            supervisor.answer(question.number, is_yes=True)
        assert robot.log == ["move servo 1 to 5 degrees: done"]

    on_robot(use)


def test_a_no_and_an_older_question_move_nothing() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        older, newer = supervisor.ask(FAR), supervisor.ask(FAR)
        with pytest.raises(MotionRefused, match="ask again"):
            supervisor.answer(older.number, is_yes=True)
        with pytest.raises(MotionRefused, match="not open"):
            supervisor.answer(newer.number, is_yes=True)  # answered by the answer to the other one
        refused = supervisor.ask(FAR)
        with pytest.raises(MotionRefused, match="said no"):
            supervisor.answer(refused.number, is_yes=False)
        assert robot.motions == []

    on_robot(use)


@pytest.mark.parametrize("by_another", [False, True])
def test_a_stop_voids_questions_and_permissions(by_another: bool) -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        question = supervisor.ask(FAR)
        permission = supervisor.permit_unasked(FAR)
        question = supervisor.ask(FAR)
        if by_another:
            async with connect("share://rex") as other:
                await other.stop()
            await robot.until(lambda: not supervisor.is_valid(permission))
        else:
            await supervisor.stop()
        with pytest.raises(MotionRefused, match="stop"):
            supervisor.answer(question.number, is_yes=True)
        with pytest.raises(MotionRefused, match="stop"):
            await supervisor.perform(permission)
        assert robot.motions == []

    on_robot(use)


def test_a_stop_while_a_motion_is_checked_voids_the_request() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        ticket = supervisor.ticket()
        await supervisor.stop()
        for ask in (supervisor.ask, supervisor.permit_unasked):
            with pytest.raises(MotionRefused, match="stop"):
                ask(FAR, ticket)
        assert robot.motions == []

    on_robot(use)


def test_a_permission_and_a_question_are_void_when_they_are_old(monkeypatch: pytest.MonkeyPatch) -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        monkeypatch.setattr(module, "PERMITTED", -1.0)
        with pytest.raises(MotionRefused, match="too old"):
            await supervisor.perform(supervisor.permit_unasked(FAR))
        monkeypatch.setattr(module, "OPEN", -1.0)
        with pytest.raises(MotionRefused, match="too old"):
            supervisor.permit_unasked(FAR)
        assert robot.motions == []

    on_robot(use)


def test_long_motions_fast_motions_and_idle_servos_are_refused() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        with pytest.raises(MotionRefused, match=r"15\.0 s are too long; at most 9\.5 s"):
            await supervisor.check_run(ACTION, "Long")
        with pytest.raises(MotionRefused, match="at most"):
            await supervisor.check_move({"1": 5}, 9.6, None)
        with pytest.raises(MotionRefused, match="its cap is 200"):
            await supervisor.check_move({"1": 90}, 0.1, None)
        await supervisor.stop()
        with pytest.raises(MotionRefused, match="is stopped, and ignores movements"):
            await supervisor.check_move({"1": 5}, 1.0, None)
        with pytest.raises(MotionRefused, match="is stopped"):
            await supervisor.check_run(MACRO, 1)
        assert robot.motions == []
        await supervisor.perform(supervisor.permit_unasked(await supervisor.check_start()))
        run = await supervisor.check_run(MACRO, "Again")
        assert run.seconds == pytest.approx(0.4)
        await supervisor.perform(supervisor.permit_unasked(run))

    on_robot(use)


def test_a_question_in_the_studio_ends_with_its_program_and_with_a_stop() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        with pytest.raises(NotFound, match="nobody can be asked"):
            await supervisor.ask_in_studio(FAR)
        async with page_that_answers(None) as heard:
            for number in (1, 2):
                asking = asyncio.create_task(supervisor.ask_in_studio(FAR))
                await robot.until(partial(is_shown, heard, "question", number))
                if number == 1:
                    asking.cancel()
                    await asyncio.wait((asking,))
                else:
                    await supervisor.stop()
                    with pytest.raises(MotionRefused, match="a stop came first"):
                        await asking
                await robot.until(partial(is_shown, heard, "question.over", number))
        assert robot.motions == []

    def is_shown(heard: list[dict[str, Any]], name: str, number: int) -> bool:
        return any((each["name"], each.get("number")) == (name, number) for each in heard)

    on_robot(use)


def test_motions_are_off_unless_allowed() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        motion = await supervisor.check_move({"1": 5}, 0.1, None)
        with pytest.raises(RequestRefused, match="--allow-motion"):
            supervisor.ask(motion)
        forged = Permission(motion, supervisor._stops.ticket())
        with pytest.raises(RequestRefused, match="role"):  # the hub refuses it too
            await supervisor.perform(forged)
        assert robot.motions == []
        await supervisor.stop()
        assert robot.stops

    on_robot(use, may_move=False)


def test_one_motion_at_a_time_and_a_cancelled_one_is_stopped() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        moving = asyncio.create_task(supervisor.perform(supervisor.permit_unasked(FAR)))
        await robot.until(lambda: bool(robot.motions))
        with pytest.raises(MotionRefused, match="under way"):
            await supervisor.perform(supervisor.permit_unasked(FAR))
        moving.cancel()
        await robot.until(lambda: bool(robot.stops))
        assert robot.log[-1] == "move servo 1 to 90 degrees: stopped, as the program that asked for it has gone"

    on_robot(use)


def test_a_stop_by_another_program_ends_the_motion() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        moving = asyncio.create_task(supervisor.perform(supervisor.permit_unasked(FAR)))
        await robot.until(lambda: bool(robot.motions))
        async with connect("share://rex") as other:
            await other.stop()
        with pytest.raises(MotionRefused, match="has stopped all servos"):
            await moving

    on_robot(use)


def test_a_motion_that_takes_too_long_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        monkeypatch.setattr(module, "LONGEST", 0.2)
        with pytest.raises(MotionRefused, match=r"longer than 0\.2 s, and was stopped"):
            await supervisor.perform(supervisor.permit_unasked(FAR))
        await robot.until(lambda: bool(robot.stops))

    on_robot(use)


def test_another_program_with_the_lease_is_named() -> None:
    async def use(robot: RobotSeen, supervisor: Supervisor) -> None:
        async with connect("share://rex") as other:
            await other.move({2: 1}, duration=0.02)
            await robot.until(lambda: len(robot.motions) == 1)
            with pytest.raises(MotionRefused, match="are moved by"):
                await supervisor.perform(supervisor.permit_unasked(FAR))
        assert len(robot.motions) == 1

    on_robot(use)


def test_the_end_of_the_hub_ends_a_motion() -> None:
    async def main() -> None:
        async with asyncio.timeout(GUARD), shared_robot() as robot:
            async with module.supervised("rex", may_move=True, speed_cap=200, log=robot.log.append) as supervisor:
                moving = asyncio.create_task(supervisor.perform(supervisor.permit_unasked(FAR)))
                await robot.until(lambda: len(robot.motions) > 0)
                supervisor._channel.abort()
                with pytest.raises((MotionRefused, ConnectionLost)):
                    await moving
            await robot.until(lambda: bool(robot.stops))  # by the hub: the program with the lease has left

    asyncio.run(main())
