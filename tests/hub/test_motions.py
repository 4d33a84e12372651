"""Motion that a hub sends for its programs: the limits of the board hold, and its end is computed or observed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, TypeVar

import pytest

from servolink.boards import BoardProfile, BoardSettings, SafetyLimits
from servolink.client import Board, connect
from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.hub.engine.motions import Motions, Outcome
from servolink.project import Project
from servolink.protocol import (
    ALL_SERVOS,
    Action,
    AddServoParameterRequest,
    AddServoParameterResponse,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    Macro,
    MacroCommand,
    Packet,
    QueryServoRequest,
    QueryServoResponse,
    Response,
    ServoParameter,
    ServoState,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
)
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.client.piped_board import LOST, PipedBoard, lie, now, opened
from tests.project.pulled import contents_of
from tests.virtual_time import run

T = TypeVar("T")

NEAR = Action(1, "near", (Step(1, 20, 100),))
FAR = Action(2, "far", (Step(1, 90, 300),))
STORED = Project(
    actions=(NEAR, FAR),
    macros=(
        Macro(1, "near twice", (MacroCommand(1, loop=2),)),
        Macro(2, "far", (MacroCommand(2),)),
        Macro(3, "endless", (MacroCommand(3, 2),)),
    ),
)
ALL_DEGREE, ALL_ADC = SetAngleUnitRequest(ALL_SERVOS, 0), SetAngleUnitRequest(ALL_SERVOS, 1)
LIMITS = SafetyLimits(angles={1: (-30, 30)})


def on_board(
    use: Callable[[Motions, Board, VirtualBoard], Awaitable[T]],
    limits: SafetyLimits | None = None,
    unit: SetAngleUnitRequest = ALL_DEGREE,
    **settings: Any,
) -> T:
    """Return what `use` returns on a board of three servos at 0 with everything stored, whose units are set."""

    async def main() -> T:
        virtual = VirtualBoard(3)
        virtual.storage.contents = contents_of(STORED)
        for servo in virtual.servos.values():
            servo.angle = 0.0
        profile = BoardProfile(limits=limits or SafetyLimits(), settings=BoardSettings(**settings))
        async with connect(VirtualTransport(virtual), angle_unit=None, profile=profile) as board:
            await board.request(unit)
            return await use(Motions(board), board, virtual)

    return run(main())


def sent(packet: Packet, limits: SafetyLimits | None = None, unit: SetAngleUnitRequest = ALL_DEGREE) -> Outcome:
    """Return the outcome of a motion; one that is refused moves nothing, even long after."""

    async def use(motions: Motions, board: Board, virtual: VirtualBoard) -> Outcome:
        outcome = await motions.send(packet)
        await asyncio.sleep(20)
        await board.servo_ids()
        if outcome.refusal:
            assert [servo.angle for servo in virtual.servos.values()] == [0, 0, 0]
        return outcome

    return on_board(use, limits, unit)


def moved(angle: int, interval: int = 100) -> ExecuteActionRequest:
    return ExecuteActionRequest((Step(1, angle, interval),))


@pytest.mark.parametrize(
    ("packet", "limits", "reason"),
    [
        (moved(31), LIMITS, "servo 1: 31 degrees is outside its limits -30..30"),
        (moved(20, 10), SafetyLimits(speed_cap=100), "20 degrees in 0.1 s is 200 degrees/s; its cap is 100"),
        (moved(20, 10), SafetyLimits(soft_start=50), "from an unknown pose its soft start allows 50"),
        (
            ExecuteActionExRequest(2),
            LIMITS,
            "action 2 'far' was not run: step 1 asks servo 1 to go to 90 degrees; its limits are -30..30",
        ),
        (ExecuteMacroRequest(2), LIMITS, "asks servo 1 to go to 90 degrees; its limits are -30..30"),
        (ExecuteMacroRequest(3), LIMITS, "never ends"),
        (ExecuteMacroRequest(9), LIMITS, "macro 9"),
    ],
)
def test_what_exceeds_the_limits_is_not_sent(packet: Packet, limits: SafetyLimits, reason: str) -> None:
    outcome = sent(packet, limits)
    assert reason in str(outcome.refusal)
    assert outcome.response == (ExecuteMacroResponse(0) if isinstance(packet, ExecuteMacroRequest) else None)


@pytest.mark.parametrize("packet", [moved(2048), ExecuteActionExRequest(1), ExecuteMacroRequest(1)])
def test_motion_in_adc_is_refused_where_degrees_are_limited(packet: Packet) -> None:
    assert "not set to degrees" in str(sent(packet, LIMITS, ALL_ADC).refusal)
    assert sent(packet, None, ALL_ADC).refusal is None


@pytest.mark.parametrize(
    ("packet", "response"),
    [
        (moved(20), None),
        (ExecuteActionRequest((Step(1, 0, 1), Step(1, 0, 1))), None),
        (ExecuteActionExRequest(1), None),
        (ExecuteActionExRequest(9), None),
        (ExecuteMacroRequest(1), ExecuteMacroResponse(1)),
        (ExecuteMacroRequest(9), ExecuteMacroResponse(0)),
        (SetServoParameterRequest(1, 0, 0), SetServoParameterResponse(1, 0, 0)),
        (AddServoParameterRequest((ServoParameter(1, 3, "hip"),)), AddServoParameterResponse(1)),
    ],
)
def test_without_limits_the_board_decides(packet: Packet, response: Response | None) -> None:
    assert sent(packet) == Outcome(response)


def test_within_the_limits_motion_is_sent() -> None:
    for packet in (moved(30), ExecuteActionExRequest(1), ExecuteMacroRequest(1)):
        assert sent(packet, LIMITS).refusal is None
    assert sent(AddServoParameterRequest((ServoParameter(1, 99, "hip"),)), LIMITS).refusal is None


def test_a_value_that_cannot_be_sent_is_refused() -> None:
    assert "interval: -1 is outside 0..32767" in str(sent(moved(1, -1)).refusal)


async def test_silence_of_the_board_is_not_a_refusal() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_unit=None) as board:
        fake.plan(ExecuteMacroRequest, LOST)
        with pytest.raises(OutcomeUnknown):
            await Motions(board).send(ExecuteMacroRequest(1))
        fake.usual_of[QueryServoRequest] = LOST
        assert await Motions(board).refused(SetServoParameterRequest(1, 1, 1)) is None
    fake = PipedBoard()
    async with opened(fake, angle_unit=None, angle_limits=(-30, 30), speed_cap=90) as board:
        await board.request(ALL_DEGREE)
        fake.usual_of[QueryServoRequest] = LOST
        with pytest.raises(RequestTimeout):
            await Motions(board).send(moved(20))


def test_what_does_not_reach_its_first_pose_is_refused() -> None:
    async def main() -> Outcome:
        fake = PipedBoard(servos=1)
        fake.storage.contents = contents_of(STORED)
        async with opened(fake, angle_unit=None, soft_start=30) as board:
            await board.request(ALL_DEGREE)
            fake.usual_of[QueryServoRequest] = lie(QueryServoResponse((ServoState(1, 5, 0, 0, 0, 1, 1),)))
            return await Motions(board).send(ExecuteMacroRequest(1))

    outcome = run(main())
    assert "was not run, as servos have not reached its first pose: servo 1 is at 5, not at 20" in str(outcome.refusal)
    assert outcome.response == ExecuteMacroResponse(0)


def test_a_refused_start_is_answered_with_the_flags_of_the_servo() -> None:
    async def use(motions: Motions, board: Board, virtual: VirtualBoard) -> list[Packet | None]:
        await board.release(2)
        await board.stop()
        packets = [SetServoParameterRequest(1, 1, 1), SetServoParameterRequest(9, 1, 1), ExecuteMacroRequest(1)]
        return [await motions.refused(packet) for packet in packets]

    assert on_board(use) == [SetServoParameterResponse(1, 0, 1), None, ExecuteMacroResponse(0)]


@pytest.mark.parametrize(
    ("packet", "seconds"),
    [
        (ExecuteActionRequest((Step(1, 0, 100), Step(2, 0, 250))), 2.5),
        (ExecuteActionRequest(()), 0),
        (ExecuteActionExRequest(2), 3.0),
        (ExecuteActionExRequest(9), None),
        (ExecuteMacroRequest(1), 2.0),
        (ExecuteMacroRequest(3), None),
        (SetServoParameterRequest(1, 1, 1), None),
        (AddServoParameterRequest(()), None),
    ],
)
def test_the_duration_of_a_motion_is_computed_where_that_is_possible(packet: Packet, seconds: float | None) -> None:
    async def use(motions: Motions, board: Board, virtual: VirtualBoard) -> float | None:
        end = await motions.end_of(packet)
        return None if end is None else end.seconds

    assert on_board(use) == seconds
    assert on_board(use, interval_unit=0.02) == (None if seconds is None else 2 * seconds)


@pytest.mark.parametrize("seconds", [0.5, 5.0])
def test_servos_rest_when_none_has_turned_for_a_while(seconds: float) -> None:
    async def use(motions: Motions, board: Board, virtual: VirtualBoard) -> float:
        begun = now()
        await board.connection.send(moved(90, round(seconds * 100)))
        await motions.until_rest()
        return now() - begun

    assert seconds + 1.5 <= on_board(use) <= seconds + 2.1


def test_a_change_of_units_is_not_taken_for_a_turn() -> None:
    async def use(motions: Motions, board: Board, virtual: VirtualBoard) -> float:
        begun, changed = now(), asyncio.create_task(change(board))
        await motions.until_rest()
        await changed
        return now() - begun

    async def change(board: Board) -> None:
        await asyncio.sleep(0.7)
        await board.request(ALL_ADC)

    assert 2.5 <= on_board(use) <= 3.1


async def test_a_board_that_is_silent_is_read_until_it_answers_again() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_unit=None) as board:
        fake.usual_of[QueryServoRequest] = LOST
        resting = asyncio.create_task(Motions(board).until_rest())
        await asyncio.sleep(30)
        assert not resting.done()
        fake.forget_plans()
        await resting
