"""Servos: reading, moving, units, start and hold.

Module: servolink.client.servo_state.
"""

from __future__ import annotations

import asyncio
import pickle
from contextlib import aclosing
from typing import Any

import pytest

from servolink.client.connecting import connect
from servolink.errors import (
    EncodeError,
    MotionRefused,
    NotFound,
    OutcomeUnknown,
    Rejected,
    RequestError,
    RequestTimeout,
    TargetNotReached,
)
from servolink.motion import Adc, Degrees
from servolink.protocol import (
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
)
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, lie, now, opened, turns_of_the_loop


def states(*angles: int) -> QueryServoResponse:
    return QueryServoResponse(tuple(ServoState(1 + at, angle, 0, 0, 0, 1, 1) for at, angle in enumerate(angles)))


# --- reading ------------------------------------------------------------------------------------------------------


async def test_servos_are_reported_with_angles_in_degrees() -> None:
    fake = PipedBoard(servos=2)
    async with opened(fake) as board:
        assert await board.servo_ids() == (1, 2)
        servos = await board.servos()
        assert [servo.servo_id for servo in servos] == [1, 2]
        assert {type(servo.angle) for servo in servos} == {Degrees}
        assert [(servo.is_start, servo.is_hold) for servo in servos] == [(True, True)] * 2
        assert await board.servo(2) == servos[1]


@pytest.mark.parametrize("servo_id", [9, 255])
async def test_a_servo_that_does_not_exist_is_not_found(servo_id: int) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(NotFound, match=f"no servo {servo_id}"):
            await board.servo(servo_id)


async def test_the_state_of_another_servo_is_never_returned() -> None:
    fake = PipedBoard()
    fake.plan(QueryServoRequest, lie(states(10)))
    async with opened(fake) as board:
        assert (await board.servo(2)).servo_id == 2
        assert board.stats.mismatched == 1


# --- units --------------------------------------------------------------------------------------------------------


async def test_the_unit_is_set_once_and_only_before_the_first_command_with_an_angle() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servo_ids()
        assert fake.sent_of(SetAngleUnitRequest) == []
        await asyncio.gather(*(board.servos() for _ in range(5)), board.move({1: 5}, duration=1), board.servo(1))
        assert fake.executed_of(SetAngleUnitRequest) == [SetAngleUnitRequest(255, 0)]
        with_angles = (SetAngleUnitRequest, QueryServoRequest, ExecuteActionRequest)
        assert isinstance(next(packet for _, packet in fake.sent if isinstance(packet, with_angles)), with_angles[0])


async def test_the_unit_is_set_by_the_next_command_when_the_first_was_cancelled_or_failed() -> None:
    fake = PipedBoard()
    fake.plan(SetAngleUnitRequest, LOST, lie(SetAngleUnitResponse(255, 1)))
    async with opened(fake) as board:
        cancelled = asyncio.create_task(board.servos())
        await turns_of_the_loop(3)
        cancelled.cancel()
        with pytest.raises(Rejected, match="angle unit 0; the board answered servo 255, unit 1"):
            await board.servos()
        assert len(await board.servos()) == 4


async def test_units_are_left_alone_if_so_asked_and_angles_are_then_plain_numbers() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_unit=None) as board:
        assert type((await board.servo(1)).angle) is int
        await board.move({1: 90}, duration=1)
        with pytest.raises(EncodeError, match="an unknown unit"):
            await board.move({1: Degrees(90)}, duration=1)
        assert fake.sent_of(SetAngleUnitRequest) == []


async def test_each_servo_has_its_own_unit_and_they_do_not_mix() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.set_angle_unit("adc", 2)
        assert fake.executed_of(SetAngleUnitRequest) == [SetAngleUnitRequest(255, 0), SetAngleUnitRequest(2, 1)]
        await board.move({1: Degrees(10), 2: Adc(2048)}, duration=1)
        for wrong in ({1: Adc(10)}, {2: Degrees(10)}, {2: 10}):
            with pytest.raises(EncodeError, match=r"servo \d: .* this servo is set to"):
                await board.move(wrong, duration=1)
        assert [type(servo.angle) for servo in (await board.servos())[:3]] == [Degrees, Adc, Degrees]
        await board.set_angle_unit("adc")
        assert type((await board.servo(1)).angle) is Adc
        assert len(fake.executed_of(ExecuteActionRequest)) == 1


async def test_a_speed_in_degrees_says_nothing_about_a_servo_in_another_unit() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_unit="adc") as board:
        with pytest.raises(EncodeError, match="not set to degrees"):
            await board.move({1: Adc(2048)}, speed=90)
        assert fake.sent == []


@pytest.mark.parametrize("servo_id", [2, 255])
async def test_a_unit_of_which_it_is_not_known_whether_it_was_set_is_set_again_before_an_angle(servo_id: int) -> None:
    fake = PipedBoard()
    async with opened(fake, patience=0.03) as board:
        await board.servos()
        fake.plan(SetAngleUnitRequest, SWALLOWED)  # done, and not answered
        with pytest.raises(OutcomeUnknown):
            await board.set_angle_unit("adc", servo_id)
        await board.move({1: 50, 2: 50}, duration=1)
        assert fake.executed_of(SetAngleUnitRequest)[-1] == SetAngleUnitRequest(255, 0)
        await asyncio.sleep(1)
        assert [servo.angle for servo in (await board.servos())[:2]] == [50, 50]


async def test_a_unit_that_does_not_exist_is_refused() -> None:
    fake = PipedBoard()
    unit: Any = "radian"
    huge: Any = 10**5000
    async with opened(fake) as board:
        with pytest.raises(EncodeError, match="unit must be 'degree' or 'adc', not 'radian'"):
            await board.set_angle_unit(unit)
        with pytest.raises(EncodeError, match="not this int"):
            await board.set_angle_unit(huge)
        assert fake.sent == []


# --- start and hold -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("start", "hold"), [(True, True), (True, False), (False, True), (False, False)])
async def test_start_and_hold_are_set(start: bool, hold: bool) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.set_servo(2, start=start, hold=hold)
        servo = await board.servo(2)
        assert (servo.is_start, servo.is_hold) == (start, hold)


@pytest.mark.parametrize("value", [None, "1", 1.0, float("nan"), 2, [1]])
async def test_what_is_neither_true_nor_false_is_refused(value: Any) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(EncodeError, match="start must be True or False"):
            await board.set_servo(1, start=value, hold=True)
        with pytest.raises(EncodeError, match="hold must be True or False"):
            await board.set_servo(1, start=True, hold=value)
        assert fake.sent == []


@pytest.mark.parametrize("echo", [(2, 0, 1), (2, 1, 0), (0, 1, 1)])
async def test_an_echo_of_something_else_is_a_refusal(echo: tuple[int, int, int]) -> None:
    fake = PipedBoard()
    fake.plan(SetServoParameterRequest, lie(SetServoParameterResponse(*echo)))
    async with opened(fake) as board:
        with pytest.raises(Rejected, match=r"servo 2 was asked for start 1, hold 1; the board answered") as caught:
            await board.set_servo(2, start=True, hold=True)
        assert caught.value.request == SetServoParameterRequest(2, 1, 1)


async def test_release_lets_all_go_limp() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.release()
        assert {(servo.is_start, servo.is_hold) for servo in await board.servos()} == {(False, False)}
        await board.set_servo(1, start=True, hold=True)
        await board.release(1)
        assert not (await board.servo(1)).is_hold


# --- moving -------------------------------------------------------------------------------------------------------


async def test_move_sends_all_targets_in_one_movement_and_returns_when_sent() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        begun = now()
        assert await board.move({1: 50, 3: -20}, duration=0.5) == 0.5
        assert now() == begun
        assert fake.executed_of(ExecuteActionRequest) == [ExecuteActionRequest((Step(1, 50, 50), Step(3, -20, 50)))]


async def test_move_by_speed_reads_the_angles_first_and_returns_the_longest_time() -> None:
    fake = PipedBoard()
    fake.plan(QueryServoRequest, lie(states(0, 30)))
    async with opened(fake) as board:
        assert await board.move({1: 90, 2: 0}, speed=45) == 2.0
        assert fake.executed_of(ExecuteActionRequest) == [ExecuteActionRequest((Step(1, 90, 200), Step(2, 0, 67)))]


async def test_a_speed_cap_holds_for_a_duration_too() -> None:
    fake = PipedBoard()
    fake.plan(QueryServoRequest, lie(states(0)))
    async with opened(fake, speed_cap=100) as board:
        with pytest.raises(EncodeError, match="its cap is 100"):
            await board.move({1: 90}, duration=0.5)
        assert fake.sent_of(ExecuteActionRequest) == []


@pytest.mark.parametrize("pace", [{"speed": 45}, {"duration": 1, "wait": True}])
async def test_moving_a_servo_that_does_not_exist_is_not_found_where_angles_are_read(pace: dict[str, Any]) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(NotFound, match="no servo 99"):
            await board.move({1: 0, 99: 0}, **pace)


@pytest.mark.parametrize(
    ("targets", "pace"),
    [
        ({}, {"duration": 1}),
        ({255: 0}, {"duration": 1}),
        ({1: 0.5}, {"duration": 1}),
        ({1: float("nan")}, {"speed": 10}),
        ({1: 0}, {}),
        ({1: 0}, {"duration": 1, "speed": 1}),
        ({1: 0}, {"duration": float("nan")}),
        ({1: 0}, {"duration": 400}),
        ({1: 0}, {"speed": -3}),
        ({1: 0}, {"speed": float("inf")}),
    ],
)
async def test_nothing_is_sent_for_an_impossible_movement(targets: dict[int, float], pace: dict[str, Any]) -> None:
    fake = PipedBoard()
    async with opened(fake, angle_limits=(-90, 90)) as board:
        with pytest.raises(EncodeError):
            await board.move(targets, **pace)
        assert fake.sent == []


@pytest.mark.parametrize("pace", [{"duration": 1}, {"speed": 10}])
async def test_an_angle_outside_the_limits_is_refused_after_a_reading_at_most(pace: dict[str, Any]) -> None:
    fake = PipedBoard()
    async with opened(fake, angle_limits=(-90, 90)) as board:
        with pytest.raises(MotionRefused, match="outside its limits"):
            await board.move({1: 91}, **pace)
        assert {type(packet) for _, packet in fake.sent} <= {
            SetAngleUnitRequest,
            QueryServoRequest,
            QueryServoListRequest,
        }


@pytest.mark.parametrize("way", ["move", "send"])
@pytest.mark.parametrize(
    ("start", "goal", "allowed"),
    [
        (-120, -115, True),
        (-120, -110, True),
        (-120, -109, False),
        (-120, -121, False),
        (-120, 95, False),
        (-120, -90, True),
        (120, 111, True),
        (0, 91, False),
    ],
)
async def test_a_servo_outside_its_limits_may_turn_toward_them_in_small_steps(
    start: int, goal: int, allowed: bool, way: str
) -> None:
    fake = PipedBoard(servos=1)
    fake.servos[1].angle = start
    async with opened(fake, angle_limits=(-90, 90)) as board:
        packet = ExecuteActionRequest((Step(1, goal, 100),))
        moving = board.send(packet) if way == "send" else board.move({1: goal}, duration=1)
        if allowed:
            await moving
        else:
            with pytest.raises(MotionRefused, match=r"outside its limits -90\.\.90"):
                await moving
        await turns_of_the_loop(50)
        assert fake.executed_of(ExecuteActionRequest) == [packet] * allowed


async def test_a_way_back_is_refused_half_a_second_after_its_reading() -> None:
    fake = PipedBoard(servos=1)
    fake.servos[1].angle = 120
    async with opened(fake, angle_limits=(-90, 90)) as board:
        send, packets = board.connection.send, list[float]()

        async def later(packet: Any, *, ticket: Any) -> None:
            packets.append(ticket.until - now())
            await asyncio.sleep(0.51)
            await send(packet, ticket=ticket)

        board.connection.send = later  # type: ignore[method-assign,assignment]
        with pytest.raises(RequestError, match="the time by which it was to begin has passed"):
            await board.move({1: 115}, duration=1)
        assert packets == [pytest.approx(0.5, abs=1e-3)]
        assert fake.sent_of(ExecuteActionRequest) == []


async def test_an_angle_too_large_for_the_protocol_is_refused_before_anything_moves() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(EncodeError, match="servo 1: the angle 40000 is outside"):
            await board.move({1: 40_000}, duration=1)
        assert fake.sent_of(ExecuteActionRequest) == []


async def test_the_same_servo_twice_in_one_movement_is_refused() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with pytest.raises(EncodeError, match="servo 2 is there twice"):
            await board.send(ExecuteActionRequest((Step(2, 0, 1), Step(1, 0, 1), Step(2, 5, 1))))
        assert fake.sent == []


async def test_move_can_wait_until_all_have_arrived() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        begun = now()
        await board.move({1: 100, 2: -100}, duration=2, wait=True)
        assert 2 <= now() - begun < 2.2
        assert [servo.angle for servo in (await board.servos())[:2]] == [100, -100]


async def test_move_looks_again_when_a_servo_is_a_little_late() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        fake.plan(QueryServoRequest, lie(states(40, 0, 0, 0)), lie(states(97, 0, 0, 0)))
        begun = now()
        await board.move({1: 100}, duration=2, wait=True)
        assert len(fake.sent_of(QueryServoRequest)) == 4
        assert now() - begun < 2.3


async def test_move_says_which_servo_has_not_arrived() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        at = int((await board.servo(2)).angle)
        fake.servos[2].is_start = False
        begun = now()
        with pytest.raises(TargetNotReached, match=rf"servo 2 is at {at}, not at 100, 1 s after .* start and hold"):
            await board.move({1: 100, 2: 100}, duration=2, wait=True)
        assert 3 <= now() - begun < 3.2


async def test_a_servo_that_has_not_arrived_is_no_reason_to_ask_again() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        at = (await board.servo(2)).angle
        fake.servos[2].is_start = False
        with pytest.raises(TargetNotReached, match="the motion was sent, so look at the robot") as caught:
            await board.move({1: 100, 2: 100}, duration=0.5, wait=True)
        assert caught.value.late == {2: (at, Degrees(100))}
        assert not isinstance(caught.value, TimeoutError)
        assert pickle.loads(pickle.dumps(caught.value)).late == {2: (at, 100)}  # noqa: S301 - made here


async def test_whether_servos_have_arrived_is_unknown_if_the_board_falls_silent() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        fake.plan(QueryServoRequest, *[LOST] * 100)
        with pytest.raises(OutcomeUnknown, match=r"the motion was sent, and whether .* is unknown: QueryServo"):
            await board.move({1: 100}, duration=0.5, wait=True)


async def test_servos_are_followed_until_they_have_arrived() -> None:
    async with connect("virtual://?servos=2") as board:
        seconds = await board.move({1: 60}, duration=1)
        begun = now()
        angles = [servos[0].angle async for servos in board.follow({1: 60}, seconds)]
        assert angles == sorted(angles)
        assert (abs(angles[-1] - 60) <= 2, len(angles) > 20) == (True, True)
        assert 1 <= now() - begun < 1.2
        async with aclosing(board.follow({1: 60}, 0, settle=True)) as following:
            settled = [servos async for servos in following]
        assert settled[-1] == settled[-2]


async def test_following_a_servo_that_does_not_come_or_is_not_there_fails() -> None:
    async with connect("virtual://?servos=2") as board:
        begun = now()
        with pytest.raises(TargetNotReached, match="servo 2 is at 3, not at 100, 1 s after"):
            async for _ in board.follow({2: 100}, 0.5):
                pass
        assert 1.5 <= now() - begun < 1.6
        with pytest.raises(NotFound, match="no servo 9"):
            async for _ in board.follow({9: 100}, 0.5):
                pass
        with pytest.raises(EncodeError, match="this servo is set to degree"):
            async for _ in board.follow({1: Adc(100)}, 0.5):
                pass


async def test_a_board_that_does_not_answer_about_a_servo_it_does_not_have_stays_connected() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        fake.plan(QueryServoRequest, *[LOST] * 100)
        with pytest.raises(RequestTimeout, match="answers other requests, so it may not know this one"):
            await board.servo(9)
        fake.forget_plans()
        assert len(await board.servos()) == 4
