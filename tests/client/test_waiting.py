"""`wait=True`: a run returns when its motion is over, or says why it never was."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.client.board import Board
from servolink.errors import ConnectionLost, NotFound, RequestError, TargetNotReached
from servolink.project import Project, RecordRun
from servolink.protocol import (
    Action,
    ExecuteActionExRequest,
    ExecuteMacroRequest,
    Macro,
    MacroCommand,
    MacroCommandType,
    Step,
)
from tests.client.piped_board import PipedBoard, now, opened
from tests.project.pulled import contents_of
from tests.virtual_time import VirtualTimeLoop, run

WAVE = Action(1, "wave", (Step(1, 40, 50), Step(2, -40, 100)))
BACK = Action(2, "back", (Step(1, -40, 50),))
ALL_FAR = Action(3, "far", tuple(Step(servo_id, 90, 100) for servo_id in (1, 2, 3)))
LACKING = Action(4, "lacking", (Step(9, 0, 10),))
DANCE = Macro(1, "dance", (MacroCommand(1, ratio=50), MacroCommand(500, 1), MacroCommand(2, loop=2)))
LONG = Macro(2, "long", (MacroCommand(1, 2), MacroCommand(2, total_interval=3000)))
ENDLESS = Macro(3, "endless", (MacroCommand(3, 2),))
PAUSE = Macro(4, "pause", (MacroCommand(700, 1),))
STORED = Project(actions=(WAVE, BACK, ALL_FAR, LACKING), macros=(DANCE, LONG, ENDLESS, PAUSE))

Use = Callable[[Board, PipedBoard], Awaitable[Any]]


def used(use: Use, **options: Any) -> PipedBoard:
    """Return a fake board with all that stored, and servos at 0, on which `use` was done."""
    fake = PipedBoard()
    fake.storage.contents = contents_of(STORED)
    for servo in fake.servos.values():
        servo.angle = 0.0

    async def main() -> None:
        async with opened(fake, **options) as board:
            await use(board, fake)

    run(main())
    return fake


def not_run(use: Use) -> None:
    """Check that `use` runs nothing."""
    fake = used(use)
    assert not fake.executed_of(ExecuteActionExRequest)
    assert not fake.executed_of(ExecuteMacroRequest)


@pytest.mark.parametrize("options", [{}, {"speed_cap": 1000}])
@pytest.mark.parametrize(
    ("start", "seconds", "pose"),
    [
        (lambda board: board.run_action("wave", wait=True), 1.0, (40, -40)),
        (lambda board: board.run_macro("dance", wait=True), 2 + 0.5 + 1, (-40, -40)),
        (lambda board: board.run_macro(2, wait=True), 3.5 + 3, (-40, -40)),
        (lambda board: board.run_macro("pause", wait=True), 0.7, (0, 0)),
    ],
)
def test_it_returns_when_the_servos_rest(
    start: Callable[[Board], Awaitable[Any]], seconds: float, pose: tuple[int, int], options: dict[str, Any]
) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        began = now()
        await start(board)
        assert now() - began == pytest.approx(seconds, abs=0.3)
        assert (fake.servos[1].angle, fake.servos[2].angle) == pose

    used(use, **options)


def test_the_line_is_free_while_it_waits() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        await board.run_macro(2, wait=True)
        assert len(fake.sent) < 20

    used(use)


def test_all_servos_that_do_not_arrive_are_named() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        await board.set_servo(1, start=False, hold=True)
        await board.set_servo(3, start=False, hold=True)
        with pytest.raises(
            TargetNotReached, match=r"^servo 1 is at 0, not at 90; servo 3 is at 0, not at 90, 1 s after they"
        ):
            await board.run_action(3, wait=True)

    used(use)


def test_a_stalled_loop_does_not_take_servos_on_their_way_for_stuck_ones() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        loop, began, deliver = asyncio.get_running_loop(), now(), fake.deliver
        assert isinstance(loop, VirtualTimeLoop)
        stalls = iter([5.0])

        def stalling(data: bytes) -> None:
            deliver(data)
            if now() > began + 0.5:
                loop.stall(next(stalls, 0.0))

        fake.deliver = stalling  # type: ignore[method-assign]
        await board.move({1: 90}, duration=1.0)
        readings = [servos[0].angle async for servos in board.follow({1: 90}, 1.0)]
        assert (30 < readings[-2] < 90, readings[-1]) == (True, 90)
        assert fake.servos[1].angle == 90

    used(use)


def test_a_stop_ends_following() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        seconds = await board.move({1: 90}, duration=5.0)
        began, angles = now(), []

        async def followed() -> None:
            async for servos in board.follow({1: 90}, seconds):
                angles.append(servos[0].angle)
                if now() >= began + 1.0:
                    await board.stop()

        with pytest.raises(RequestError, match=r"^the motion was started, and then ended by a stop$"):
            await followed()
        assert (0 < angles[-1] < 45, now() - began < 1.5) == (True, True)

    used(use)


def test_a_stop_ends_it() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        waiting = asyncio.ensure_future(board.run_macro("long", wait=True))
        await asyncio.sleep(1.0)
        await board.stop()
        began = now()
        with pytest.raises(RequestError, match=r"^macro 2 'long' was started, and then ended by a stop$"):
            await waiting
        assert now() - began < 0.3

    used(use)


def test_the_loss_of_the_board_ends_it() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        waiting = asyncio.ensure_future(board.run_macro("long", wait=True))
        await asyncio.sleep(1.0)
        fake.vanish()
        began = now()
        with pytest.raises(ConnectionLost, match=r"^macro 2 'long' was started, and the connection was lost before"):
            await waiting
        assert now() - began < 0.3

    used(use)


@pytest.mark.parametrize(
    ("start", "error", "text"),
    [
        (
            lambda board: board.run_action(4, wait=True),
            NotFound,
            "action 4 'lacking' was not run: it moves servo 9",
        ),
        (
            lambda board: board.run_macro(3, wait=True),
            RequestError,
            "macro 3 'endless' was not run, because its end could not be known: macro 3 'endless' never ends",
        ),
        (lambda board: board.run_macro(9, wait=True), NotFound, "the board has no macro 9"),
        (lambda board: board.run_action("x", wait=True), NotFound, "the board has no action 'x'"),
    ],
)
def test_what_cannot_be_waited_for_is_not_run(
    start: Callable[[Board], Awaitable[Any]], error: type[Exception], text: str
) -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        with pytest.raises(error, match=f"^{text}"):
            await start(board)

    not_run(use)


def test_a_dry_run_waits_for_nothing() -> None:
    async def use(board: Board, fake: PipedBoard) -> None:
        began = now()
        assert await board.run_action("wave", wait=True, dry_run=True) == 1.0
        await board.run_macro("dance", wait=True, dry_run=True)
        with pytest.raises(NotFound):
            await board.run_macro("nothing", dry_run=True)
        assert now() - began < 0.3

    not_run(use)


@pytest.mark.parametrize(
    ("record", "unit", "seconds"),
    [
        (WAVE, 0.01, 1.0),
        (WAVE, 0.02, 2.0),
        (Action(5), 0.01, 0.0),
        (DANCE, 0.01, 3.5),
        (DANCE, 0.02, 6.5),
        (LONG, 0.01, 6.5),
        (Macro(6), 0.01, 0.0),
        (Macro(6, "", (MacroCommand(1, loop=0), MacroCommand(-5, MacroCommandType.DELAY))), 0.01, 0.0),
    ],
)
def test_how_long_a_run_takes(record: Action | Macro, unit: float, seconds: float) -> None:
    macros = {DANCE, LONG, PAUSE} | ({record} if isinstance(record, Macro) else set())
    assert RecordRun(Project(actions=(WAVE, BACK, Action(5)), macros=tuple(macros)), record, unit).seconds() == seconds
