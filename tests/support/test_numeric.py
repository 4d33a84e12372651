"""Numbers of other libraries: wherever a program gives one, it counts as the number of Python that it equals."""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable
from decimal import Decimal
from fractions import Fraction
from numbers import Real
from typing import Any

import pytest
from msgspec.structs import astuple

from servolink.client import Alarm, Board, connect
from servolink.connection import ConnectionOptions
from servolink.errors import EncodeError
from servolink.motion import Adc, Degrees, MotionLimits, motion_limits
from servolink.project import build_project, scale_project
from servolink.protocol import (
    Action,
    Button,
    ExecuteActionRequest,
    JoystickTable,
    Macro,
    MacroCommand,
    QueryServoRequest,
    Step,
    record_to_json,
)
from servolink.recorder import Wanted
from servolink.support.numeric import as_number
from tests.client.piped_board import PipedBoard, opened


class Whole:
    """An integer of another library, as `numpy.int64` is one."""

    def __init__(self, value: int) -> None:
        self.value = value

    def __index__(self) -> int:
        return self.value

    def __eq__(self, other: object) -> bool:
        return self.value == other

    def __hash__(self) -> int:
        return hash(self.value)


class Measure:
    """A number of another library, as `numpy.float32` is one."""

    def __init__(self, value: float) -> None:
        self.value = value

    def __float__(self) -> float:
        return float(self.value)


class Truth:
    """A truth value of another library, as `numpy.bool` is one."""

    def __init__(self, value: bool) -> None:
        self.value = value

    def __float__(self) -> float:
        return float(self.value)

    def __eq__(self, other: object) -> bool:
        return self.value == other

    def __hash__(self) -> int:
        return hash(self.value)


class Double(float):
    """A float of another library, as `numpy.float64` is one."""


Real.register(Measure)
# What the types of the library do not promise, since no type stands for the numbers of all libraries.
whole: Callable[[int], Any] = Whole
measure: Callable[[float], Any] = Measure
truth: Callable[[bool], Any] = Truth


@pytest.mark.parametrize(
    ("given", "plain"),
    [
        (3, 3),
        (0.5, 0.5),
        (Whole(3), 3),
        (Measure(0.5), 0.5),
        (Double(0.5), 0.5),
        (Fraction(1, 2), 0.5),
        (True, True),
        (None, None),
        ("3", "3"),
        (Adc(3), Adc(3)),
        (Degrees(3), Degrees(3)),
        (Decimal("0.5"), Decimal("0.5")),
    ],
)
def test_a_number_is_one_of_pythons_own(given: object, plain: object) -> None:
    number = as_number(given)
    assert number == plain
    assert type(number) is type(plain)


def test_a_truth_value_is_no_number() -> None:
    assert isinstance(as_number(Truth(True)), Truth)


MOVES: list[Callable[[Board], Awaitable[object]]] = [
    lambda board: board.move({whole(1): 60}, duration=0.5),
    lambda board: board.move({1: whole(60)}, duration=0.5),
    lambda board: board.move({1: measure(60)}, duration=0.5),
    lambda board: board.move({1: 60}, duration=measure(0.5)),
    lambda board: board.move({"1": whole(60)}, duration=0.5),
]


@pytest.mark.parametrize("move", MOVES)
async def test_a_movement_takes_them(move: Callable[[Board], Awaitable[object]]) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        assert await move(board) == 0.5
        assert fake.executed_of(ExecuteActionRequest) == [ExecuteActionRequest((Step(1, 60, 50),))]


async def test_a_speed_may_be_one() -> None:
    async with opened(PipedBoard()) as board:
        assert await board.move({1: 60}, speed=whole(5)) == await board.move({1: 60}, speed=5)


@pytest.mark.parametrize("angle", [measure(60.5), truth(True)])
async def test_a_fraction_and_a_truth_value_are_no_angle(angle: Any) -> None:
    async with opened(PipedBoard()) as board:
        with pytest.raises(EncodeError, match="the angle must be a whole number, not "):
            await board.move({1: angle}, duration=1)


async def test_methods_of_a_board_take_them() -> None:
    async with opened(PipedBoard()) as board:
        assert (await board.servo(whole(1))).servo_id == 1
        await board.set_servo(whole(1), start=truth(True), hold=whole(1))
        assert (await board.servo(1)).state == "ready"
        await board.set_servo(1, start=truth(False), hold=True)
        assert (await board.servo(1)).state == "stopped"
        await board.write_project_id(whole(7))
        assert await board.project_id() == 7
        stored = await board.add_action(Action.pose("Bow", {whole(1): whole(60)}, action_id=whole(3)))
        assert await board.action(whole(3)) == stored
        await board.request(QueryServoRequest(255), timeout=measure(2))
        async with board.watch(measure(20)) as readings:
            assert (await anext(readings)).servos
        assert len([servos async for servos in board.follow({2: whole(3)}, measure(0.1))]) > 1


def test_options_and_limits_hold_plain_numbers() -> None:
    limits = motion_limits({whole(1): (whole(-90), measure(90))}, {whole(2): measure(50)}, measure(30))
    assert limits == MotionLimits({1: (-90, 90.0)}, None, {2: 50.0}, 30.0)
    assert type(limits.soft_start) is float
    assert isinstance(limits.angles, dict)
    assert [type(servo_id) for servo_id in (*limits.angles, *limits.speed_caps)] == [int, int]
    assert motion_limits((whole(-90), whole(90)), measure(50)) == MotionLimits((-90, 90), 50.0)
    options = ConnectionOptions(patience=measure(2.5), depth=whole(4), write_depth=whole(2))
    assert [type(value) for value in astuple(options)[3:6]] == [float, int, int]
    assert Alarm("current_raw", ">", whole(800), measure(0.5)) == Alarm("current_raw", ">", 800, 0.5)
    assert Wanted(__file__, measure(5)).rate == 5  # type: ignore[arg-type]
    connect("virtual://", patience=measure(2.5), depth=whole(4), soft_start=measure(30))


def test_parts_of_a_project_hold_plain_numbers() -> None:
    bow = Action.pose("Bow", {whole(1): whole(60), 2: measure(30.0)}, seconds=measure(0.5), action_id=whole(3))
    assert bow == Action(3, "Bow", (Step(1, 60, 50), Step(2, 30, 50)))
    pause = MacroCommand.of(measure(0.3), ratio=whole(50), loop=whole(2))
    hello = Macro.of("Hello", bow, pause, loop=whole(2), macro_id=whole(4))
    pad = JoystickTable.of("Pad", Button.of(whole(3), press=hello), table_id=whole(5))
    project = build_project(pad, captions={whole(1): "hip"})
    scaled, _ = scale_project(project, measure(2.0))
    assert scaled.actions[0].seconds == 1.0
    for record in (*scaled.actions, *scaled.macros, *scaled.joystick_tables, *scaled.servo_parameters):
        json.dumps(record_to_json(record))


def test_a_whole_number_is_added_to_an_angle() -> None:
    assert Degrees(3) + whole(4) == Degrees(7)
    with pytest.raises(TypeError, match="only whole numbers"):
        _ = Degrees(3) + measure(4)
