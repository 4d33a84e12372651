"""One servo that the user named is moved a little and back, and the time that this takes is the unit of intervals."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink import connect
from servolink.boards import Measured, SafetyLimits
from servolink.doctor import learn_motion
from servolink.doctor.learn_motion import PlannedMovement, interval_finding, plan_movement
from servolink.errors import ServolinkError
from servolink.virtual import BoardKind, SimulatedServo, VirtualBoard, VirtualTransport
from tests.virtual_time import run


def planned_on(board: VirtualBoard, limits: SafetyLimits) -> PlannedMovement:
    async def main() -> PlannedMovement:
        async with connect(VirtualTransport(board)) as connected:
            return await plan_movement(connected, 3, limits)

    return run(main())


def timed(kind: BoardKind, limits: SafetyLimits | None = None) -> tuple[Measured, VirtualBoard]:
    board = VirtualBoard(servos=4, kind=kind)

    async def main() -> Measured:
        async with connect(VirtualTransport(board)) as connected:
            return await interval_finding(connected, await plan_movement(connected, 3, limits or SafetyLimits()))

    return run(main()), board


@pytest.mark.parametrize("unit", [0.001, 0.01, 0.1])
@pytest.mark.parametrize("turnaround", [0.0, 0.016])
def test_each_unit_is_learnt(unit: float, turnaround: float) -> None:
    still = VirtualBoard(servos=4)
    found, board = timed(BoardKind(interval_unit=unit, turnaround=turnaround))
    assert (found.value, found.confidence) == (unit, "certain")
    assert [servo.angle for servo in board.servos.values()] == [
        pytest.approx(servo.angle, abs=0.5) for servo in still.servos.values()
    ]


@pytest.mark.parametrize("unit", [0.002, 0.0075, 0.0145, 0.03])
@pytest.mark.parametrize("turnaround", [0.0, 0.016])
def test_another_unit_is_a_guess_at_what_was_measured(unit: float, turnaround: float) -> None:
    found, _ = timed(BoardKind(interval_unit=unit, turnaround=turnaround))
    assert (found.value, found.confidence) == (pytest.approx(unit, rel=0.15), "guess")
    assert found.evidence.endswith(", not a unit of 1, 10 or 100 ms")


@pytest.mark.virtual_only("the test changes how the virtual servo moves")
def test_a_servo_that_reports_the_commanded_angle_at_once_cannot_be_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    move = SimulatedServo.move

    def jump(servo: SimulatedServo, angle: int, *others: Any) -> None:
        move(servo, angle, *others)
        servo.angle = angle

    monkeypatch.setattr(SimulatedServo, "move", jump)
    found, _ = timed(BoardKind())
    assert (found.value, found.confidence) == (None, "guess")
    assert "it reports the commanded angle, not where it is" in found.evidence


def test_times_that_differ_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((1.0, 2.0))

    async def seconds_to(*_: object) -> learn_motion._TimedMotion:
        seconds = next(times)
        return learn_motion._TimedMotion(seconds, seconds, seconds)

    monkeypatch.setattr(learn_motion, "_seconds_to", seconds_to)
    found, _ = timed(BoardKind())
    assert (found.value, found.confidence) == (None, "guess")


def test_limits_decide_how_far_and_how_fast() -> None:
    board = VirtualBoard(servos=4)
    start = round(board.servos[3].angle)
    away = 10 if start <= 0 else -10
    assert planned_on(board, SafetyLimits()) == PlannedMovement(3, start, start + away, 100)
    other_way = SafetyLimits(angles={3: (min(start, start - away), max(start, start - away))})
    assert planned_on(board, other_way).goal == start - away
    slow = planned_on(board, SafetyLimits(speed_cap=90, speed_caps={3: 20, 4: 1}))
    assert slow.interval == 500, "10 degrees in 0.5 s, if the unit is 1 ms"


@pytest.mark.parametrize(
    ("limits", "text"),
    [
        (SafetyLimits(angles={3: (-4, 4)}), "without room for 10"),
        (SafetyLimits(angles={3: (100, 160)}), "may only be moved within 100..160"),
        (SafetyLimits(speed_caps={3: 2}), "too slow to be timed"),
        (SafetyLimits(soft_start=2), "too slow to be timed"),
    ],
    ids=str,
)
def test_limits_without_room_are_refused(limits: SafetyLimits, text: str) -> None:
    board = VirtualBoard(servos=4)
    board.servos[3].angle = 0.0
    with pytest.raises(ServolinkError, match=text):
        planned_on(board, limits)


def test_a_stopped_servo_is_not_started() -> None:
    board = VirtualBoard(servos=4)
    board.servos[3].is_start = 0
    with pytest.raises(ServolinkError, match="servo 3 is stopped or released and would not move"):
        planned_on(board, SafetyLimits())


def test_a_servo_that_does_not_arrive_tells_nothing() -> None:
    board = VirtualBoard(servos=4)

    async def main() -> Any:
        async with connect(VirtualTransport(board)) as connected:
            planned = await plan_movement(connected, 3, SafetyLimits())
            board.servos[3].is_hold = 0
            return await interval_finding(connected, planned)

    found = run(main())
    assert found.value is None
    assert "longer than was waited" in found.evidence or "0.0" in found.evidence


@pytest.mark.virtual_only("the test asks the virtual servo whether it is moving")
async def test_a_cancellation_stops_the_servo() -> None:
    board = VirtualBoard(servos=4)
    async with connect(VirtualTransport(board)) as connected:
        planned = await plan_movement(connected, 3, SafetyLimits())
        task = asyncio.ensure_future(interval_finding(connected, planned))
        await asyncio.sleep(0.5)
        begun = board.servos[3].moving
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert (begun, board.servos[3].moving, board.servos[3].is_start) == (True, False, 0)
