"""Units: no angle is sent or read in another unit than that to which it belongs, whoever changes units meanwhile."""

from __future__ import annotations

import asyncio

import pytest

from servolink.client import connecting
from servolink.client.connecting import connect
from servolink.errors import EncodeError, OutcomeUnknown, Rejected, RequestTimeout
from servolink.motion import Adc, Degrees
from servolink.protocol import (
    ExecuteActionRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    Step,
)
from servolink.testing import Fate
from servolink.virtual import BoardKind, VirtualBoard, to_adc
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, connected, late, lie, now, opened, turns_of_the_loop
from tests.client.sockets import Socket

LIMITS = (-90, 90)


@pytest.mark.parametrize("depth", [1, 3])
@pytest.mark.parametrize("speed", [None, 90.0])
async def test_a_movement_asked_for_while_a_unit_changes_is_checked_in_the_new(depth: int, speed: float | None) -> None:
    fake = PipedBoard()
    async with opened(fake, depth=depth, angle_limits=LIMITS) as board:
        await board.servos()
        changing = asyncio.create_task(board.set_angle_unit("adc"))
        await turns_of_the_loop(1)
        with pytest.raises(EncodeError, match=r"this servo is set to adc; write Adc\(60\)"):
            await board.move({1: 60}, duration=None if speed else 1, speed=speed)
        await changing
        assert fake.sent_of(ExecuteActionRequest) == []


async def test_a_movement_asked_for_while_a_unit_changes_is_sent_if_it_fits_the_new_one() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        await asyncio.gather(board.set_angle_unit("adc"), board.move({1: Adc(2048)}, duration=1))
        assert fake.executed_of(ExecuteActionRequest) == [ExecuteActionRequest((Step(1, 2048, 100),))]


async def test_a_movement_that_waits_for_its_turn_is_checked_again_if_a_unit_was_sent_before_it() -> None:
    fake = PipedBoard()
    fake.plan(QueryServoRequest, late(0), late(0.5))
    async with opened(fake, angle_limits=LIMITS) as board:
        await board.servos()
        moving = asyncio.create_task(board.move({1: 60}, speed=90))  # reads the angles first
        await turns_of_the_loop(2)
        blocking = asyncio.create_task(board.servo_ids())
        await turns_of_the_loop(2)
        changing = asyncio.create_task(board.set_angle_unit("adc"))
        with pytest.raises(EncodeError, match="set to adc"):
            await moving
        await asyncio.gather(blocking, changing)
        assert fake.sent_of(ExecuteActionRequest) == []


async def test_targets_that_are_changed_meanwhile_are_not_taken_for_what_was_asked() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        targets = {1: 60}
        changing = asyncio.create_task(board.set_angle_unit("degree"))
        moving = asyncio.create_task(board.move(targets, duration=1))
        await turns_of_the_loop(2)
        targets[1] = 90
        await asyncio.gather(changing, moving)
        assert fake.executed_of(ExecuteActionRequest) == [ExecuteActionRequest((Step(1, 60, 100),))]


async def test_a_movement_that_came_first_goes_first_in_the_old_unit() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        fake.plan(QueryServoListRequest, late(0.5))
        await asyncio.gather(board.servo_ids(), board.move({1: 60}, duration=1), board.set_angle_unit("adc"))
        kinds = [type(packet) for _, packet in fake.sent[-2:]]
        assert kinds == [ExecuteActionRequest, SetAngleUnitRequest]
        assert fake.executed_of(ExecuteActionRequest) == [ExecuteActionRequest((Step(1, 60, 100),))]


async def test_a_movement_is_sent_once_in_degrees_that_are_set_again_after_an_unknown_outcome() -> None:
    fake = PipedBoard()
    async with opened(fake, patience=0.03) as board:
        await board.servos()
        fake.plan(SetAngleUnitRequest, SWALLOWED)
        unknown, _ = await asyncio.gather(
            board.set_angle_unit("adc"), board.move({1: 60}, duration=1), return_exceptions=True
        )
        assert isinstance(unknown, OutcomeUnknown)
        orders = [packet for _, packet in fake.sent if isinstance(packet, SetAngleUnitRequest | ExecuteActionRequest)]
        assert orders[-2:] == [SetAngleUnitRequest(255, 0), ExecuteActionRequest((Step(1, 60, 100),))]
        assert len(fake.sent_of(ExecuteActionRequest)) == 1


@pytest.mark.parametrize("depth", [1, 3])
async def test_an_angle_asked_for_during_an_open_change_is_read_when_the_unit_is_known(
    depth: int,
) -> None:
    fake = PipedBoard()
    async with opened(fake, depth=depth, patience=0.03) as board:
        before = (await board.servo(1)).angle
        fake.plan(SetAngleUnitRequest, SWALLOWED)  # done
        unknown, servo = await asyncio.gather(board.set_angle_unit("adc"), board.servo(1), return_exceptions=True)
        assert isinstance(unknown, OutcomeUnknown)
        assert not isinstance(servo, BaseException)
        assert (type(servo.angle), servo.angle) == (Degrees, before)


async def test_an_angle_is_asked_for_again_if_a_unit_was_sent_before_its_answer_came() -> None:
    fake = PipedBoard()
    async with opened(fake, depth=2) as board:
        degrees = (await board.servo(1)).angle
        fake.plan(QueryServoRequest, *[LOST] * 5)  # at the fifth one it pauses, and the change goes first
        servo, _ = await asyncio.gather(board.servo(1), board.set_angle_unit("adc"))
        assert type(servo.angle) is Adc
        assert servo.angle == Adc((await board.servo(1)).angle)
        assert int(servo.angle) != int(degrees)


async def test_an_arrival_that_is_reported_in_another_unit_is_unknown() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        moving = asyncio.create_task(board.move({1: 60}, duration=1, wait=True))
        await asyncio.sleep(0.5)
        await board.set_angle_unit("adc")
        with pytest.raises(OutcomeUnknown, match=r"servo 1 was moved to Degrees\(60\) and now reports Adc\("):
            await moving


async def test_a_unit_that_was_refused_changes_nothing() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.set_angle_unit("adc", 2)
        fake.plan(SetAngleUnitRequest, lie(SetAngleUnitResponse(3, 0)))
        with pytest.raises(Rejected, match="servo 3, unit 0"):
            await board.set_angle_unit("adc", 3)
        assert [board.unit_of(servo_id) for servo_id in (1, 2, 3)] == ["degree", "adc", "degree"]


@pytest.mark.parametrize("fates", [[lie(SetAngleUnitResponse(255, 0))], [Fate(), lie(SetAngleUnitResponse(2, 1))]])
async def test_a_board_that_comes_back_and_refuses_a_unit_is_not_resumed(fates: list[Fate]) -> None:
    fake, again = PipedBoard(), PipedBoard()
    async with opened(fake, angle_unit="adc") as board, connected(again) as link:
        await board.set_angle_unit("degree", 2)
        again.plan(SetAngleUnitRequest, *fates)
        with pytest.raises(Rejected, match=r"asked for angle unit \d; the board answered"):
            await board._servos.units._restore(link)
        await board._servos.units._restore(link)


async def test_a_change_that_is_given_up_before_it_is_sent_changes_nothing() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.set_angle_unit("adc", 2)
        fake.plan(QueryServoRequest, late(0.5))
        reading = asyncio.create_task(board.servo(2))
        await turns_of_the_loop(2)
        changing = asyncio.create_task(board.set_angle_unit("degree", 3))  # waits for its turn
        await turns_of_the_loop(2)
        changing.cancel()
        assert isinstance((await reading).angle, Adc)
        assert board.unit_of(2) == "adc"


@pytest.mark.parametrize("timeout", [0.1, 2.9, 4.5])
async def test_a_timeout_counts_while_another_change_is_under_way(timeout: float) -> None:
    fake = PipedBoard()
    fake.usual_of[SetAngleUnitRequest] = LOST
    async with opened(fake, patience=3.0) as board:
        changing = asyncio.create_task(board.set_angle_unit("adc"))
        await turns_of_the_loop(2)
        begun = now()
        with pytest.raises((RequestTimeout, OutcomeUnknown), match=f" in {timeout} s"):
            await board.request(SetAngleUnitRequest(255, 0), timeout=timeout)
        assert now() == pytest.approx(begun + timeout)
        await asyncio.wait((changing,))
        assert isinstance(changing.exception(), OutcomeUnknown)


@pytest.mark.parametrize("timeout", [0, "1"])
async def test_a_timeout_that_is_none_is_refused(timeout: float) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises((TypeError, ValueError), match="timeout must be"):
            await board.request(SetAngleUnitRequest(255, 0), timeout=timeout)


async def test_a_change_behind_one_of_which_the_outcome_is_not_known_holds() -> None:
    fake = PipedBoard()
    async with opened(fake, patience=0.03) as board:
        await board.servos()
        fake.plan(SetAngleUnitRequest, late(0), SWALLOWED)
        changes = (board.set_angle_unit("adc", servo_id) for servo_id in (1, 2, 3))
        first, second, third = await asyncio.gather(*changes, return_exceptions=True)
        assert (first, type(second), third) == (None, OutcomeUnknown, None)
        assert isinstance((await board.servo(3)).angle, Adc)


@pytest.mark.virtual_only("the raw angles of the firmware are pulse widths")
async def test_units_of_single_servos_are_set_again_where_that_of_all_is_not_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    toy = VirtualBoard(servos=3, kind=BoardKind(bus_powered=True))
    socket = Socket(toy)
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", reconnect=True, angle_unit=None) as board:
        await board.set_angle_unit("adc", 3)
        socket.pull()
        socket.plug(toy)
        await asyncio.sleep(5)
        assert board.stats.reconnects == 1
        angle = (await board.servo(3)).angle
        assert isinstance(angle, Adc)
        assert angle == to_adc(toy.servos[3].angle)
