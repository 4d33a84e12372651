"""Soft start: the first movement of a servo from an unknown pose is slow."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from itertools import pairwise
from typing import Any

import pytest

from servolink.client import connecting
from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.errors import EncodeError, MotionRefused, RequestError, TargetNotReached
from servolink.project import Project
from servolink.protocol import (
    Action,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Macro,
    MacroCommand,
    QueryActionRequest,
    QueryActionResponse,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetServoParameterRequest,
    Step,
)
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.client.piped_board import PipedBoard, lie, now, opened
from tests.client.sockets import Socket
from tests.project.pulled import contents_of
from tests.virtual_time import run

POSE = Action(1, "pose", (Step(1, 90, 50), Step(2, -30, 50)))
REST = Action(2, "rest", (Step(1, 0, 50), Step(3, 60, 50)))
DANCE = Macro(1, "dance", (MacroCommand(1), MacroCommand(2)))
STORED = Project(actions=(POSE, REST), macros=(DANCE,))
RELEASED = pytest.mark.virtual_only("the firmware does not know the angle of a released servo")

Use = Callable[[Board, VirtualBoard], Awaitable[Any]]


def on_virtual(use: Use, **options: Any) -> VirtualBoard:
    """Return a virtual board on which `use` was done, from all servos at 0."""
    virtual = VirtualBoard(4)
    virtual.storage.contents = contents_of(STORED)
    for servo in virtual.servos.values():
        servo.angle = 0.0

    async def main() -> None:
        async with connect(VirtualTransport(virtual), **options) as board:
            await use(board, virtual)

    run(main())
    return virtual


def test_the_first_movement_takes_longer_and_the_next_ones_do_not() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        assert await board.move({1: 90, 2: 30}, duration=0.5, wait=True) == 3.0
        assert await board.move({1: 0, 2: 0}, duration=0.5, wait=True) == 0.5
        assert await board.move({1: 90, 3: 15}, speed=90, wait=True) == 3.0
        assert await board.move({1: 0, 3: 0}, speed=90) == 1.0

    on_virtual(use, soft_start=30)


def test_what_is_slow_by_itself_is_not_changed() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        assert await board.move({1: 90}, duration=4) == 4.0
        assert await board.move({4: 0}, duration=0.01) == 0.01
        assert await board.move({2: 20}, speed=10, dry_run=True) == 2.0
        with pytest.raises(EncodeError, match="servo 2: the angle 40000 is outside"):
            await board.move({2: 40_000}, duration=4, dry_run=True)

    on_virtual(use, soft_start=30)


def test_the_first_movement_lasts_until_its_end_whatever_is_sent_meanwhile() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        assert await board.move({1: 90}, duration=0.05) == 3.0
        await asyncio.sleep(1)
        assert await board.move({1: 90}, duration=0.05) == 2.0
        await asyncio.sleep(1)
        assert await board.move({1: -90}, duration=0.05) == 5.0
        await asyncio.sleep(1)
        assert await board.move({1: -90}, duration=0.05) == 0.05

    on_virtual(use, soft_start=30)


def test_a_cap_below_the_soft_start_holds_and_one_above_it_is_no_reason_to_refuse() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        assert await board.move({1: 90, 2: 30}, duration=0.5, wait=True) == 9.0
        with pytest.raises(MotionRefused, match=r"servo 1: 90 degrees in 0\.5 s is 180 degrees/s; its cap is 10"):
            await board.move({1: 0}, duration=0.5)

    on_virtual(use, soft_start=30, speed_cap={1: 10})


@pytest.mark.parametrize(
    "interrupt",
    [
        pytest.param(lambda board: board.release(1), marks=RELEASED),
        pytest.param(lambda board: board.release(), marks=RELEASED),
        lambda board: board.set_servo(1, start=False, hold=True),
        pytest.param(lambda board: board.request(SetServoParameterRequest(1, 1, 0)), marks=RELEASED),
        lambda board: board.stop(),
    ],
)
def test_the_pose_of_a_servo_that_was_stopped_or_released_is_unknown(interrupt: Callable[[Board], Any]) -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        await board.move({1: 30}, duration=0.5, wait=True)
        await interrupt(board)
        for servo_id in (1, 2):
            await board.set_servo(servo_id, start=True, hold=True)
        assert await board.move({1: 0}, duration=0.5, wait=True) == 1.0
        assert await board.move({1: 30}, duration=0.5) == 0.5

    on_virtual(use, soft_start=30)


@pytest.mark.parametrize(
    "move",
    [
        lambda board: board.move({1: 30}, duration=0.5),
        lambda board: board.send(ExecuteActionRequest((Step(1, 30, 50),))),
    ],
)
async def test_a_movement_that_a_stop_overtakes_on_a_full_line_makes_no_pose_known(
    move: Callable[[Board], Any],
) -> None:
    room = asyncio.Event()

    class FullBehindMovements(PipedBoard):
        def take(self, data: bytes) -> Awaitable[object] | None:
            super().take(data)
            return room.wait() if self.sent and isinstance(self.sent[-1][1], ExecuteActionRequest) else None

    fake = FullBehindMovements(servos=1)
    fake.servos[1].angle = 0.0
    async with opened(fake, soft_start=60) as board:
        moving = asyncio.ensure_future(move(board))
        await asyncio.sleep(0.1)
        asyncio.get_running_loop().call_later(0.1, room.set)
        await board.stop()
        await moving
        await asyncio.sleep(1)  # longer than the movement would have taken
        await board.set_servo(1, start=True, hold=True)
        here = (await board.servo(1)).angle
        assert await board.move({1: here + 60}, duration=0.5) == 1.0


async def test_after_a_reconnect_all_poses_are_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    socket = Socket(VirtualBoard(2))
    monkeypatch.setattr(connecting, "create", socket.transport)
    async with connect("virtual://", soft_start=30, reconnect=True) as board:
        await board.move({1: 60}, duration=0.5, wait=True)
        assert await board.move({1: 30}, duration=0.5, wait=True) == 0.5
        there = socket.board
        assert there is not None
        socket.pull()
        socket.plug(there)
        async for state in board.states():
            if state == "connected" and board.stats.reconnects:
                break
        assert await board.move({1: 90}, duration=0.5) == 2.0


def test_a_packet_is_refused_not_changed() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        fast = ExecuteActionRequest((Step(1, 90, 50),))
        with pytest.raises(
            MotionRefused, match=r"180 degrees/s; from an unknown pose its soft start allows 30 \(from an"
        ):
            await board.send(fast)
        await board.send(ExecuteActionRequest((Step(1, -30, 100),)))
        with pytest.raises(MotionRefused, match="soft start"):
            await board.send(fast)
        await asyncio.sleep(1)
        await board.send(fast)

    on_virtual(use, soft_start=30)


def test_a_run_begins_with_a_slow_movement_to_its_first_pose() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        begun = now()
        assert await board.run_action(1) == 0.5
        assert 3 <= now() - begun < 3.5
        await asyncio.sleep(0.5)
        begun = now()
        await board.run_macro(1)  # servo 3 makes its first movement
        assert 2 <= now() - begun < 2.5
        assert round(virtual.servos[3].angle) == 60
        await asyncio.sleep(1)
        begun = now()
        await board.run_macro(1)
        assert now() - begun < 0.1

    on_virtual(use, soft_start=30)


def test_no_servo_is_ever_faster_in_its_first_movement() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        running = asyncio.ensure_future(board.run_macro(1))
        readings = []
        while not running.done():
            await asyncio.sleep(0.1)
            readings.append((now(), [servo.angle for servo in await board.servos()]))
        for (before, angles), (after, later) in pairwise(readings[:-1]):
            for angle, other in zip(angles, later, strict=True):
                assert abs(other - angle) / (after - before) < 30 * 1.2
        await running

    on_virtual(use, soft_start=30)


def test_all_is_checked_before_the_slow_movement() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        with pytest.raises(
            MotionRefused, match=r"macro 1 'dance' was not run: command 2: .*step 1 asks servo 1 for 180 "
        ):
            await board.run_macro(1)
        await asyncio.sleep(2)
        assert [servo.angle for servo in await board.servos()] == [0, 0, 0, 0]

    on_virtual(use, soft_start=30, speed_cap={1: 100}, angle_limits={4: (0, 50)})


def test_where_a_servo_comes_from_is_no_reason_to_refuse_if_it_starts_softly() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        await board.run_action(1)
        await asyncio.sleep(1)
        await board.move({1: 0}, duration=2, wait=True)
        with pytest.raises(MotionRefused, match="servo 1 for 180 degrees/s"):
            await board.run_action(1)

    on_virtual(use, soft_start=30, speed_cap=100)


def test_servos_that_would_not_move_are_not_waited_for() -> None:
    async def use(board: Board, virtual: VirtualBoard) -> None:
        await board.release(1)
        begun = now()
        await board.run_action(1)
        assert 1 <= now() - begun < 1.5
        await board.set_servo(1, start=True, hold=True)
        assert await board.move({1: 90}, duration=0.5) == 3.0

    on_virtual(use, soft_start=30)


# --- what can come in between -------------------------------------------------------------------------------------


def on_fake(use: Callable[[Board, PipedBoard], Awaitable[Any]], **options: Any) -> PipedBoard:
    """Return a fake board on which `use` was done, from all servos at 0."""
    fake = PipedBoard()
    fake.storage.contents = contents_of(STORED)
    for servo in fake.servos.values():
        servo.angle = 0.0

    async def main() -> None:
        async with opened(fake, **options) as board:
            await use(board, fake)

    run(main())
    return fake


@pytest.mark.parametrize("seconds", [0.0, 0.5, 2.0, 2.99])
def test_a_stop_during_the_slow_movement_ends_the_run(seconds: float) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        running = asyncio.ensure_future(board.run_macro(1))
        await asyncio.sleep(seconds)
        await board.stop()
        with pytest.raises(RequestError, match="a stop came first"):
            await running

    fake = on_fake(use, soft_start=30)
    assert fake.executed_of(ExecuteMacroRequest) == []


def test_a_cancelled_run_does_not_run() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        running = asyncio.ensure_future(board.run_action(1))
        await asyncio.sleep(1)
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running

    assert on_fake(use, soft_start=30).executed_of(ExecuteActionExRequest) == []


def test_a_servo_that_does_not_arrive_ends_the_run() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        states = tuple(ServoState(number, 5, 0, 0, 0, 1, 1) for number in (1, 2, 3, 4))
        fake.plan(QueryServoRequest, *[lie(QueryServoResponse(states))] * 1000)
        with pytest.raises(TargetNotReached, match=r"action 1 .*was not run, as .*: servo 1 is at 5, not at 90"):
            await board.run_action(1)

    assert on_fake(use, soft_start=30).executed_of(ExecuteActionExRequest) == []


def test_a_record_that_changed_during_the_slow_movement_is_checked_again() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        fake.plan(
            QueryActionRequest,
            lie(QueryActionResponse(1, "tame", POSE.steps)),
            lie(QueryActionResponse(1, "wild", (Step(1, 170, 50), Step(2, -30, 50)))),
        )
        with pytest.raises(MotionRefused, match=r"'wild' was not run: .*170 degrees"):
            await board.run_action(1)

    fake = on_fake(use, soft_start=30, angle_limits=(-90, 90))
    assert len(fake.executed_of(ExecuteActionRequest)) == 1
    assert fake.executed_of(ExecuteActionExRequest) == []


def test_a_soft_start_that_would_take_too_long_is_refused() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        for going in (board.move({1: 90}, duration=1), board.run_action(1)):
            with pytest.raises(EncodeError, match=r"servo 1: 900 s is outside 0\.01\.\.327\.67 s"):
                await going

    fake = on_fake(use, soft_start=0.1)
    assert fake.executed_of(ExecuteActionRequest) == fake.executed_of(ExecuteActionExRequest) == []


@pytest.mark.parametrize("soft_start", [0, -1, "fast", True])
def test_a_soft_start_that_is_no_speed_is_refused(soft_start: Any) -> None:
    with pytest.raises((ValueError, TypeError), match="soft_start must be"):
        connect("virtual://", soft_start=soft_start)
