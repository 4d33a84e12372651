"""Stored actions, macros and packets of one's own are kept within the limits of movements.

Modules: servolink.client.stored_runs, servolink.client.raw_packets, servolink.client.stored_runs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.boards import BoardProfile, BoardSettings
from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.client.servo_state import Servo
from servolink.errors import ConnectionLost, EncodeError, MotionRefused, NotFound, RequestError
from servolink.motion import Adc, MotionLimits, MotionPlanner
from servolink.project import Project
from servolink.protocol import (
    ALL_SERVOS,
    Action,
    Command,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Macro,
    MacroCommand,
    QueryActionRequest,
    QueryActionResponse,
    QueryMacroListRequest,
    QueryMacroRequest,
    QueryMacroResponse,
    QueryServoListRequest,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    Step,
)
from servolink.virtual import BoardKind, VirtualBoard, VirtualTransport
from tests.client.piped_board import LOST, PipedBoard, connected, late, lie, now, opened
from tests.project.pulled import contents_of
from tests.virtual_time import run

WAVE = Action(1, "wave", (Step(1, 40, 50), Step(2, -40, 50)))
BACK = Action(2, "back", (Step(1, -40, 50),))
FAR = Action(3, "far", (Step(2, 0, 100), Step(1, 120, 300)))
RAW = Action(4, "raw", (Step(4, 2048, 100),))
DANCE = Macro(1, "dance", (MacroCommand(1), MacroCommand(500, 1), MacroCommand(2, loop=2)))
SLOWLY = Macro(2, "slowly", (MacroCommand(1, 2, 50),))
TWICE = Macro(3, "twice", (MacroCommand(2, 2), MacroCommand(1, 2)))
REACH = Macro(4, "reach", (MacroCommand(2, 2), MacroCommand(3)))
ENDLESS = Macro(5, "endless", (MacroCommand(2), MacroCommand(6, 2)))
OTHER = Macro(6, "other", (MacroCommand(5, 2),))
LACKING = Macro(7, "lacking", (MacroCommand(1), MacroCommand(99)))
STORED = Project(actions=(WAVE, BACK, FAR, RAW), macros=(DANCE, SLOWLY, TWICE, REACH, ENDLESS, OTHER, LACKING))
MOTION = (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest)

Use = Callable[[Board], Awaitable[Any]]


def prepared(virtual: VirtualBoard) -> VirtualBoard:
    """Return a board with everything stored, and all servos at 0."""
    virtual.storage.contents = contents_of(STORED)
    for servo in virtual.servos.values():
        servo.angle = 0.0
    return virtual


def moved(use: Use, seconds: float = 20.0, **options: Any) -> tuple[float, ...]:
    """Return the angles at the end on a virtual board, with `use` done and `seconds` gone."""

    async def main() -> tuple[float, ...]:
        virtual = prepared(VirtualBoard(4))
        async with connect(VirtualTransport(virtual), **options) as board:
            await use(board)
            await asyncio.sleep(seconds)
            await board.servo_ids()
            return tuple(servo.angle for servo in virtual.servos.values())

    return run(main())


def assert_refused(use: Use, words: str, error: type[Exception] = MotionRefused, **options: Any) -> None:
    """Check that `use` raises, and that no servo of a virtual board has moved even long after."""

    async def attempt(board: Board) -> None:
        with pytest.raises(error, match=words):
            await use(board)

    assert moved(attempt, **options) == (0, 0, 0, 0)


# --- stored actions and macros ------------------------------------------------------------------------------------


def test_what_keeps_to_the_limits_runs() -> None:
    limits: dict[str, Any] = {"angle_limits": (-60, 60), "speed_cap": 160}
    assert moved(lambda board: board.run_action(1), **limits) == (40, -40, 0, 0)
    assert moved(lambda board: board.run_macro(1), **limits) == (-40, -40, 0, 0)
    assert moved(lambda board: board.run_macro(3), **limits) == (-40, -40, 0, 0)
    assert moved(lambda board: board.request(ExecuteMacroRequest(1)), **limits) == (-40, -40, 0, 0)
    assert moved(lambda board: board.send(ExecuteActionExRequest(1)), **limits) == (40, -40, 0, 0)


@pytest.mark.parametrize(
    ("use", "words"),
    [
        (lambda board: board.run_action(3), "^action 3 'far' was not run: step 2"),
        (lambda board: board.send(ExecuteActionExRequest(3)), "^action 3 'far' was not run: step 2"),
        (lambda board: board.run_macro(4), "^macro 4 'reach' was not run: action 3 'far', step 2"),
        (lambda board: board.request(ExecuteMacroRequest(4)), "^macro 4 'reach' was not run: action 3 'far', step 2"),
        (lambda board: board.send(ExecuteActionRequest(FAR.steps)), "^servo 1: 120 degrees is outside its limits"),
    ],
)
def test_an_angle_beyond_its_limits_is_refused_however_it_is_asked_for(use: Use, words: str) -> None:
    limits = {1: (-60, 60)}
    assert_refused(use, rf"{words}.*-60\.\.60 \(from an argument\)$", angle_limits=limits)


@pytest.mark.parametrize(
    ("use", "words"),
    [
        (lambda board: board.run_action(1), "action 1 'wave' was not run: step 1 asks servo 1 for 80 "),
        (
            lambda board: board.run_macro(3),
            "macro 3 'twice' was not run: command 2: action 1 'wave', step 1 asks servo 1 for 160 ",
        ),
        (lambda board: board.send(ExecuteActionRequest((Step(1, 40, 50),))), "servo 1: 40 degrees in 0.5 s is 80 "),
    ],
)
@pytest.mark.parametrize("cap", [75, {1: 75}])
def test_a_step_above_its_speed_cap_is_refused(use: Use, words: str, cap: Any) -> None:
    assert_refused(use, rf"{words}degrees/s; its cap is 75 \(from an argument\)$", speed_cap=cap)


def test_a_ratio_slows_down_what_would_be_too_fast() -> None:
    assert moved(lambda board: board.run_macro(2), speed_cap={1: 80}) == (-40, -40, 0, 0)
    assert_refused(
        lambda board: board.run_macro(1), "macro 1 'dance' was not run: command 3: .* 160 degrees/s", speed_cap={1: 80}
    )


async def test_a_step_is_checked_from_where_its_servo_is_now() -> None:
    virtual = prepared(VirtualBoard(4))
    async with connect(VirtualTransport(virtual), speed_cap={1: 100}) as board:
        await board.move({1: -40}, duration=1, wait=True)
        with pytest.raises(MotionRefused, match="servo 1 for 160 degrees/s"):
            await board.run_action(1)
        await board.move({1: 40}, duration=1, wait=True)
        await board.run_action(1)


def test_a_dry_run_checks_and_moves_nothing() -> None:
    async def use(board: Board) -> None:
        assert await board.run_action(1, dry_run=True) == 0.5
        await board.run_macro(1, dry_run=True)
        assert await board.move({1: 50}, speed=25, dry_run=True) == 2.0
        with pytest.raises(MotionRefused):
            await board.run_macro(4, dry_run=True)

    assert moved(use, angle_limits=(-60, 60)) == (0, 0, 0, 0)
    assert moved(lambda board: board.run_macro(4, dry_run=True)) == (0, 0, 0, 0)


@pytest.mark.parametrize(
    ("use", "error", "words"),
    [
        (lambda board: board.run_action(9), NotFound, "^the board has no action 9$"),
        (lambda board: board.run_macro(9), NotFound, "^the board has no macro 9$"),
        (
            lambda board: board.run_macro(7),
            NotFound,
            "'lacking' was not run: .* runs action 99, which could not be read",
        ),
        (lambda board: board.run_macro(5), MotionRefused, "macro 5 'endless' was not run: macro [56] .* never ends"),
    ],
)
def test_what_is_missing_or_never_ends_is_not_run(use: Use, error: type[Exception], words: str) -> None:
    assert_refused(use, words, error, angle_limits=(-60, 60))


def test_angles_that_are_not_in_degrees_cannot_be_checked() -> None:
    words = "action 1 'wave', step 1 moves servo 1, which is not set to degrees"
    for unit in ("adc", None):
        assert_refused(lambda board: board.run_macro(1), words, angle_limits=(-60, 60), angle_unit=unit)
    raw = ExecuteActionRequest((Step(1, 30, 100),))
    for unit in ("adc", None):
        assert_refused(lambda board: board.send(raw), "servo 1: .* not set to degrees", speed_cap=100, angle_unit=unit)


def test_a_unit_that_was_set_by_a_packet_counts() -> None:
    async def use(board: Board) -> None:
        await board.servos()
        await board.request(SetAngleUnitRequest(1, 1))
        assert board.unit_of(1) == "adc"
        with pytest.raises(MotionRefused, match=r"servo 1: .* not set to degrees"):
            await board.send(ExecuteActionRequest((Step(1, 50, 100),)))
        await board.request(SetAngleUnitRequest(1, 0))
        await board.send(ExecuteActionRequest((Step(1, 50, 100),)))

    assert moved(use, angle_limits=(-60, 60)) == (50, 0, 0, 0)


def test_a_unit_that_the_board_did_not_take_does_not_count() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        await board.servos()
        fake.plan(SetAngleUnitRequest, lie(SetAngleUnitResponse(1, 0)), LOST)
        assert (await board.request(SetAngleUnitRequest(1, 1))).unit_type == 0
        assert board.unit_of(1) == "degree"
        with pytest.raises(RequestError):
            await board.request(SetAngleUnitRequest(1, 1), timeout=0.01)
        await board.run_action(1)  # what the board made of it is unknown, so all units are set again
        assert [packet for _, packet in fake.sent if isinstance(packet, SetAngleUnitRequest)][-1].servo_id == ALL_SERVOS

    sent_on_fake(use, speed_cap=100)


def test_servos_without_limits_of_their_own_are_free() -> None:
    async def use(board: Board) -> None:
        await board.set_angle_unit("adc", 4)
        await board.run_action(4)
        await board.run_action(3)
        await board.send(ExecuteActionRequest((Step(4, 3000, 1),)))

    assert moved(use, angle_limits={3: (0, 0)}, speed_cap={3: 1})[:3] == (120, 0, 0)


def test_a_servo_that_the_board_does_not_report_has_no_known_speed() -> None:
    async def use(board: Board) -> None:
        await board.add_action(Action(8, "more", (Step(9, 10, 100),)))
        await board.run_action(8)

    assert_refused(
        use, "action 8 'more' was not run: step 1 moves servo 9, which the board does not report", speed_cap=100
    )
    assert moved(use, angle_limits=(-10, 10)) == (0, 0, 0, 0)


# --- what is sent, and when ---------------------------------------------------------------------------------------


def sent_on_fake(use: Callable[[Board, PipedBoard], Awaitable[Any]], **options: Any) -> PipedBoard:
    """Return a fake board on which `use` was done."""
    fake = PipedBoard()
    prepared(fake)

    async def main() -> None:
        async with opened(fake, **options) as board:
            await use(board, fake)

    run(main())
    return fake


def test_without_limits_only_the_list_of_macros_and_once_the_servos_are_read() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        assert await board.run_action(1) == 0.5
        await board.run_macro(1)
        await board.request(ExecuteMacroRequest(2))
        await board.send(ExecuteActionRequest(WAVE.steps))
        with pytest.raises(NotFound, match="the board has no macro 99; there is macro 1 'dance', macro 2 'slowly'"):
            await board.run_macro(99)

    packets = [packet for _, packet in sent_on_fake(use).sent]
    assert packets == [
        QueryServoRequest(ALL_SERVOS),
        QueryServoListRequest(),
        QueryActionRequest(1),
        ExecuteActionExRequest(1),
        QueryMacroListRequest(),
        ExecuteMacroRequest(1),
        ExecuteMacroRequest(2),
        ExecuteActionRequest(WAVE.steps),
        QueryMacroListRequest(),
    ]


def test_with_limits_everything_that_runs_is_read_once() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        await board.run_macro(3)

    packets = [packet for _, packet in sent_on_fake(use, angle_limits=(-60, 60)).sent]
    assert packets == [
        *(QueryMacroRequest(macro_id) for macro_id in (3, 2, 1)),
        *(QueryActionRequest(action_id) for action_id in (1, 2)),
        SetAngleUnitRequest(ALL_SERVOS, 0),
        QueryServoRequest(ALL_SERVOS),
        QueryServoListRequest(),
        ExecuteMacroRequest(3),
    ]


@pytest.mark.parametrize(
    "packet", [ExecuteActionRequest((Step(1, 40_000, 1),)), ExecuteActionRequest((Step(1, 0, -1),))]
)
def test_a_packet_that_cannot_be_sent_is_refused_first(packet: Command) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        with pytest.raises(EncodeError):
            await board.send(packet)
        with pytest.raises(EncodeError, match="there twice"):
            await board.send(ExecuteActionRequest((Step(1, 0, 1), Step(1, 0, 1))))
        with pytest.raises(ValueError, match="timeout"):
            await board.request(ExecuteMacroRequest(1), timeout=-1)

    assert sent_on_fake(use, speed_cap=10).sent == []


RUNS: dict[str, Use] = {
    "run_action": lambda board: board.run_action(1),
    "run_macro": lambda board: board.run_macro(1),
    "send action": lambda board: board.send(ExecuteActionExRequest(1)),
    "send": lambda board: board.send(ExecuteActionRequest(WAVE.steps)),
    "request": lambda board: board.request(ExecuteMacroRequest(1)),
}


@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize("slow", [QueryServoRequest, QueryActionRequest, SetAngleUnitRequest])
def test_a_stop_while_it_is_checked_wins(name: str, slow: Any) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        fake.plan(slow, late(0.5))
        running = asyncio.ensure_future(RUNS[name](board))
        await asyncio.sleep(0.1)
        await board.stop()
        if slow is QueryActionRequest and name == "send":  # it reads no record, so it was sent at once
            await running
        else:
            with pytest.raises(RequestError, match="a stop came first"):
                await running
            assert [packet for _, packet in fake.sent if isinstance(packet, MOTION)] == []

    sent_on_fake(use, speed_cap=500)


@pytest.mark.parametrize("name", ["run_action", "run_macro"])
def test_what_was_checked_for_another_unit_is_not_run(name: str) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        await board.servos()
        fake.plan(QueryServoRequest, late(0.1))
        running = asyncio.ensure_future(RUNS[name](board))
        blocking = [asyncio.ensure_future(board.servo_ids()) for _ in range(3)]
        await asyncio.sleep(0.05)
        setting = asyncio.ensure_future(board.set_angle_unit("adc"))
        with pytest.raises((RequestError, MotionRefused), match=r"angle unit was set|not set to degrees"):
            await running
        await asyncio.gather(setting, *blocking)
        assert [packet for _, packet in fake.sent if isinstance(packet, MOTION)] == []

    sent_on_fake(use, angle_limits=(-60, 60))


def test_a_lost_connection_ends_a_run() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        fake.plan(QueryServoRequest, late(0.1))
        running = asyncio.ensure_future(board.run_macro(1))
        await asyncio.sleep(0.05)
        fake.vanish()
        with pytest.raises(ConnectionLost):
            await running

    sent_on_fake(use, angle_limits=(-60, 60))


def test_what_was_checked_on_one_connection_is_not_run_on_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        read, other = board._servos.servos, PipedBoard()

        async def replaced() -> tuple[Servo, ...]:
            servos = await read()
            board._session.connection = connection
            return servos

        monkeypatch.setattr(board._servos, "servos", replaced)
        first = board._session.connection
        async with connected(other) as connection:
            with pytest.raises(ConnectionLost, match="macro 1 'dance' was not run: the connection was lost"):
                await board.run_macro(1)
        board._session.connection = first
        assert other.sent == []

    assert sent_on_fake(use, angle_limits=(-60, 60)).executed_of(ExecuteMacroRequest) == []


# --- boards that tell anything ------------------------------------------------------------------------------------


def test_macros_without_end_are_not_read_for_ever() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        for number in range(1, 60):
            endless = MacroCommand(number + 1, 2)
            fake.plan(QueryMacroRequest, lie(QueryMacroResponse(number, "on and on", (endless,))))
        with pytest.raises(
            MotionRefused,
            match=r"macro 1 'on and on' was not run: it runs 33 records, .* 33 deep; at most .* 32 are read",
        ):
            await board.run_macro(1)

    fake = sent_on_fake(use, angle_limits=(-60, 60))
    assert len(fake.sent_of(QueryMacroRequest)) == 33
    assert fake.executed_of(ExecuteMacroRequest) == []


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        ((MacroCommand(1, 9),), "is of type 9"),
        ((MacroCommand(1, 0, 200),), "has the ratio 200"),
        ((MacroCommand(2, 0, 0),), "has the ratio 0"),
    ],
)
def test_a_macro_of_which_the_meaning_is_unknown_is_not_run(commands: tuple[MacroCommand, ...], words: str) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        fake.plan(QueryMacroRequest, lie(QueryMacroResponse(1, "?", commands)))
        with pytest.raises(MotionRefused, match=f"macro 1 .* was not run: .*{words}"):
            await board.run_macro(1)

    assert sent_on_fake(use, speed_cap=100).executed_of(ExecuteMacroRequest) == []


@pytest.mark.parametrize("interval", [0, -5])
def test_a_step_without_time_is_too_fast(interval: int) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        response = QueryActionResponse(1, "\x1b[2Jjump", (Step(1, 40, 50), Step(2, 1, interval)))
        fake.plan(QueryActionRequest, lie(response))
        with pytest.raises(
            MotionRefused, match=r"'\\x1b\[2Jjump' was not run: step 2 asks servo 2 to turn in no time; its cap"
        ):
            await board.run_action(1)

    assert sent_on_fake(use, speed_cap=100).executed_of(ExecuteActionExRequest) == []


async def test_the_interval_unit_counts_for_moves_and_stored_records() -> None:
    fake = PipedBoard()
    prepared(fake)
    async with opened(fake) as connected:
        board = Board(connected._session, "degree", MotionPlanner(MotionLimits(speed_cap=45), 0.02))
        assert await board.run_action(1) == 1.0
        assert await board.move({1: 0}, duration=1) == 1.0
        assert fake.executed_of(ExecuteActionRequest) == [ExecuteActionRequest((Step(1, 0, 50),))]
        await board.send(ExecuteActionRequest((Step(1, 0, 50),)))
        with pytest.raises(EncodeError, match=r"duration 0\.01 is outside 0\.02\.\.655\.34 s"):
            await board.move({1: Adc(0)}, duration=0.01)


@pytest.mark.parametrize("unit", [0.001, 0.01, 0.1])
async def test_a_board_that_counts_otherwise_takes_the_time_that_was_said(unit: float) -> None:
    virtual = prepared(VirtualBoard(4, kind=BoardKind(interval_unit=unit)))
    profile = BoardProfile(settings=BoardSettings(interval_unit=unit))
    async with connect(VirtualTransport(virtual), profile=profile) as board:
        begun = now()
        assert await board.move({1: 60}, speed=30, wait=True) == 2.0
        assert 2 <= now() - begun < 2.1
        seconds = await board.run_action(1)
        assert seconds == pytest.approx(50 * unit)
        await asyncio.sleep(seconds / 2)
        assert (await board.servo(2)).angle == pytest.approx(-20, abs=8)
        await asyncio.sleep(seconds / 2)
        assert (await board.servo(2)).angle == -40


def test_angles_reported_by_the_board_are_where_a_run_starts() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        states = tuple(ServoState(number, 100, 0, 0, 0, 1, 1) for number in (1, 2, 3, 4))
        fake.plan(QueryServoRequest, lie(QueryServoResponse(states)))
        with pytest.raises(MotionRefused, match="step 1 asks servo 1 for 120 degrees/s"):
            await board.run_action(1)

    sent_on_fake(use, speed_cap=100)
