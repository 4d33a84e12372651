"""`board.play`: an action or a macro of a project moves the servos, without being stored."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.boards import BoardProfile, BoardSettings
from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.client.playing import Playback
from servolink.errors import (
    ConnectionLost,
    EncodeError,
    MotionRefused,
    NotFound,
    ProjectError,
    RequestError,
    TargetNotReached,
)
from servolink.project import Project
from servolink.protocol import (
    Action,
    AddActionRequest,
    AddMacroRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Macro,
    MacroCommand,
    MacroCommandType,
    Step,
)
from servolink.virtual import BoardKind, VirtualBoard, VirtualTransport
from tests.client.piped_board import PipedBoard, now, opened
from tests.project.pulled import contents_of
from tests.virtual_time import run

WAVE = Action(1, "wave", (Step(1, 40, 50), Step(2, -40, 100)))
BACK = Action(2, "back", (Step(1, -40, 50),))
TWICE = Action(3, "twice", (Step(1, 0, 50), Step(1, 5, 50)))
STRANGER = Action(4, "stranger", (Step(9, 0, 10),))
SLOW = Action(5, "slow", (Step(1, 0, 0x7FFF),))
AT_ONCE = Action(6, "at once", (Step(1, 0, 0),))
FAR = Action(7, "far", (Step(1, 0, 100), Step(2, 120, 300)))
DANCE = Macro(1, "Dance", (MacroCommand(1, ratio=50), MacroCommand(500, 1), MacroCommand(2, loop=2)))
INNER = Macro(2, "inner", (MacroCommand(1, 2, 50), MacroCommand(1, total_interval=3000)))
ENDLESS = Macro(3, "endless", (MacroCommand(3, 2),))
LACKING = Macro(4, "lacking", (MacroCommand(1), MacroCommand(99)))
SLOWEST = Macro(5, "slowest", (MacroCommand(1), MacroCommand(5, ratio=99)))
BACKWARDS = Macro(6, "backwards", (MacroCommand(1), MacroCommand(-500, MacroCommandType.DELAY)))
FLOOD = Macro(7, "flood", (MacroCommand(6, loop=100),))
LAST_FAR = Macro(8, "last far", (MacroCommand(1), MacroCommand(7)))
PAUSES = Macro(9, "pauses", (MacroCommand(0, 1, loop=1000), MacroCommand(700, 1)))
PROJECT = Project(
    actions=(WAVE, BACK, TWICE, STRANGER, SLOW, AT_ONCE, FAR),
    macros=(DANCE, INNER, ENDLESS, LACKING, SLOWEST, BACKWARDS, FLOOD, LAST_FAR, PAUSES),
)

Use = Callable[[Board, PipedBoard], Awaitable[Any]]


def used(use: Use, **options: Any) -> PipedBoard:
    """Return a fake board with servos at 0, on which `use` was done."""
    fake = PipedBoard()
    for servo in fake.servos.values():
        servo.angle = 0.0

    async def main() -> None:
        async with opened(fake, **options) as board:
            await use(board, fake)

    run(main())
    return fake


def movements(fake: PipedBoard) -> list[tuple[tuple[int, int, int], ...]]:
    """Return servo, angle and interval of each step that was sent."""
    sent: list[Any] = fake.executed_of(ExecuteActionRequest)
    return [tuple((step.servo_id, step.degree, step.interval) for step in request.steps) for request in sent]


# --- what is played -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "seconds", "sent"),
    [
        ("wave", 1.0, [((1, 40, 50), (2, -40, 100))]),
        ("Dance", 3.5, [((1, 40, 100), (2, -40, 200)), ((1, -40, 50),), ((1, -40, 50),)]),
        ("macro:2", 10.0, [((1, 40, 200), (2, -40, 400)), *[((1, -40, 100),)] * 2, ((1, 40, 50), (2, -40, 100))]),
        ("pauses", 0.7, []),
    ],
)
def test_each_step_is_sent_when_its_time_comes_and_nothing_is_stored(name: str, seconds: float, sent: Any) -> None:
    playback = Playback()

    async def use(board: Board, fake: PipedBoard) -> None:
        start = now()
        assert await board.play(PROJECT, name, playback=playback) == seconds
        assert seconds <= now() - start < seconds + 0.3

    fake = used(use)
    assert movements(fake) == sent
    assert not any(fake.executed_of(kind) for kind in (AddActionRequest, AddMacroRequest))
    assert not any(fake.executed_of(kind) for kind in (ExecuteActionExRequest, ExecuteMacroRequest))
    assert playback.seconds == pytest.approx(playback.total_seconds) == pytest.approx(seconds)


@pytest.mark.parametrize("unit", [0.005, 0.01, 0.1])
@pytest.mark.parametrize("name", ["Dance", "inner", "wave"])
async def test_servos_move_as_if_it_were_stored_and_run(name: str, unit: float) -> None:
    async def angles(start: Callable[[Board], Awaitable[Any]]) -> list[tuple[float, ...]]:
        virtual = VirtualBoard(4, kind=BoardKind(interval_unit=unit))
        virtual.storage.contents = contents_of(PROJECT)
        for servo in virtual.servos.values():
            servo.angle = 0.0
        profile = BoardProfile(settings=BoardSettings(interval_unit=unit))
        seen: list[tuple[float, ...]] = []
        async with connect(VirtualTransport(virtual), profile=profile) as board:
            playing = asyncio.ensure_future(start(board))
            for _ in range(100):
                await asyncio.sleep(0.1)
                seen.append(tuple(servo.angle for servo in await board.servos()))
            playing.cancel()
        return seen

    stored = await angles(lambda board: board.run_action(1) if name == "wave" else board.run_macro(name))
    played = await angles(lambda board: board.play(PROJECT, name))
    for one, other in zip(stored, played, strict=True):
        assert one == pytest.approx(other, abs=5)
    assert len(set(stored)) >= 4


def test_actions_that_take_no_time_do_not_fill_the_line() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        start = now()
        await board.play(PROJECT, "flood")
        assert now() - start >= 1.0

    assert movements(used(use)) == [((1, 0, 1),)] * 100


def test_a_dry_run_moves_nothing() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        assert await board.play(PROJECT, "Dance", dry_run=True) == 3.5

    assert not movements(used(use, soft_start=20))


def test_soft_start_moves_servos_to_the_first_angles() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        await board.play(PROJECT, "wave")

    first, *rest = movements(used(use, soft_start=20))
    assert first == ((1, 40, 200), (2, -40, 200))
    assert rest == [((1, 40, 50), (2, -40, 100))]


# --- what is refused before anything moves ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "error", "words", "options"),
    [
        ("nobody", ProjectError, "there is none|there is no action", {}),
        ("macro:4", NotFound, "runs action 99", {}),
        ("twice", RequestError, "moves servo 1 twice", {}),
        ("endless", RequestError, "never ends", {}),
        ("stranger", NotFound, "the board has no servo 9; nothing was moved", {}),
        ("slowest", EncodeError, "action 5 'slow' at 0.99 times its speed", {}),
        ("backwards", EncodeError, "macro 6 'backwards', command 2 is a delay of -500 ms", {}),
        ("last far", MotionRefused, "step 2 asks servo 2 to go to 120 degrees", {"angle_limits": (-90, 90)}),
        ("Dance", MotionRefused, "its cap is 100", {"speed_cap": 100}),
        ("at once", RequestError, "servo 1 is set to raw ADC", {"angle_unit": "adc"}),
    ],
)
def test_everything_is_checked_before_the_first_step(
    name: str, error: type[Exception], words: str, options: dict[str, Any]
) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        with pytest.raises(error, match=words):
            await board.play(PROJECT, name)

    assert not movements(used(use, **options))


def test_ids_that_are_there_twice_are_not_played() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        with pytest.raises(ProjectError, match="action 1 exists twice"):
            await board.play(Project(actions=(WAVE, WAVE)), "wave")

    assert not movements(used(use))


@pytest.mark.parametrize(("start", "hold"), [(False, True), (False, False)])
def test_servos_that_would_not_move_are_named(start: bool, hold: bool) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        await board.set_servo(2, start=start, hold=hold)
        with pytest.raises(RequestError, match="servo 2 is stopped or released and would ignore the movement"):
            await board.play(PROJECT, "wave")

    assert not movements(used(use))


# --- what ends it, and pauses -------------------------------------------------------------------------------------


async def begun(board: Board, seconds: float, **more: Any) -> asyncio.Task[float]:
    """Return a task in which the dance has been played for so long."""
    playing = asyncio.create_task(board.play(PROJECT, "Dance", **more))
    await asyncio.sleep(seconds)
    return playing


def test_a_stop_ends_it() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        playing = await begun(board, 1.0)
        await board.stop()
        with pytest.raises(RequestError, match="macro 1 'Dance' was started, and then ended by a stop"):
            await playing
        await board.set_servo(255, start=True, hold=True)
        await asyncio.sleep(5)

    assert len(movements(used(use))) == 1


def test_a_stop_while_it_is_checked_ends_it() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        playing = asyncio.create_task(board.play(PROJECT, "Dance"))
        await asyncio.sleep(0)
        await board.stop()
        with pytest.raises(RequestError):
            await playing

    assert not movements(used(use))


def test_a_change_of_a_unit_ends_it() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        playing = await begun(board, 1.0)
        await board.set_angle_unit("adc", 1)
        with pytest.raises(RequestError, match="an angle unit was set while it was played"):
            await playing

    assert len(movements(used(use))) == 1


def test_a_lost_connection_ends_it() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        playing = await begun(board, 1.0)
        fake.vanish()
        start = now()
        with pytest.raises(ConnectionLost, match="macro 1 'Dance' was started, and the connection was lost"):
            await playing
        assert now() - start < 0.1

    assert len(movements(used(use))) == 1


def test_after_a_cancellation_no_further_step_is_sent() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        playing = await begun(board, 1.0)
        playing.cancel()
        await asyncio.sleep(5)
        assert playing.cancelled()
        assert (await board.servo(2)).angle == -40

    assert len(movements(used(use))) == 1


def test_a_pause_lets_servos_finish_and_the_rest_is_played_after_it() -> None:
    playback = Playback()

    async def use(board: Board, fake: PipedBoard) -> None:
        start = now()
        playing = await begun(board, 1.0, playback=playback)
        playback.pause()
        await asyncio.sleep(10)
        assert len(movements(fake)) == 1
        assert (await board.servo(2)).angle == -40
        assert playback.seconds == pytest.approx(2.0)
        playback.resume()
        assert await playing == 3.5
        assert 11 + 1.5 <= now() - start < 11 + 2.0

    assert len(movements(used(use))) == 3


def test_a_stop_ends_a_pause_too() -> None:
    playback = Playback()
    playback.pause()

    async def use(board: Board, fake: PipedBoard) -> None:
        playing = await begun(board, 1.0, playback=playback)
        await board.stop()
        with pytest.raises(RequestError, match="ended by a stop"):
            await playing

    assert not movements(used(use))


def test_a_step_that_is_late_is_not_cut_short() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        loop: Any = asyncio.get_running_loop()
        start = now()
        playing = await begun(board, 1.0)
        loop.stall(3.0)  # not long enough for a hub to refuse what was asked for before
        await playing
        assert now() - start >= 4.0 + 1.0  # two steps of half a second each, after the host had slept

    assert len(movements(used(use))) == 3


def test_a_servo_that_does_not_arrive_is_named() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        playing = await begun(board, 2.7)
        await board.set_servo(1, start=False, hold=True)
        with pytest.raises(TargetNotReached, match="servo 1 is at"):
            await playing

    used(use)
