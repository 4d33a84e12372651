"""What the shell refuses is refused by `move`, `stream` and `play` too, before anything moves."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from contextlib import suppress
from copy import copy
from typing import Any

import pytest

from servolink import sync
from servolink.client.board import Board
from servolink.errors import ConnectionLost, MotionRefused, NotFound, RequestRefused, ServolinkError, TargetNotReached
from servolink.motion import Adc
from servolink.project import Project
from servolink.protocol import Action, ExecuteActionRequest, QueryServoListRequest, QueryServoRequest, Step
from tests.client.piped_board import PipedBoard, opened
from tests.client.reconnections import connected, until

Targets = dict[int, float]


async def by_move(board: Board, targets: Targets, **options: Any) -> object:
    return await board.move(targets, duration=0.1, **options)


async def by_stream(board: Board, targets: Targets, **options: Any) -> object:
    return await board.stream(**options).send(targets)


async def by_play(board: Board, targets: Targets, **options: Any) -> object:
    steps = tuple(Step(servo_id, int(angle), 10) for servo_id, angle in targets.items())
    return await board.play(Project(actions=(Action(1, "Bow", steps),)), "Bow", **options)


DOORS = (by_move, by_stream, by_play)
Door = Callable[..., Awaitable[object]]
Act = Callable[[Board, PipedBoard], Awaitable[object]]

IGNORES = r"servo 2 is stopped or released and would ignore the movement; nothing was sent\. Add --start"


async def nothing(board: Board, fake: PipedBoard) -> None: ...


async def stopped_elsewhere(board: Board, fake: PipedBoard) -> None:
    fake.servos[2].is_start = False
    await board.servos()


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(
    ("before", "targets", "error", "words"),
    [
        (nothing, {1: 10, 99: 10}, NotFound, "the board has no servo 99; nothing was moved"),
        (nothing, {1: 1000}, MotionRefused, "servo 1: 1000 degrees is beyond ±360, and no limits say"),
        (nothing, {1: -361}, MotionRefused, "servo 1: -361 degrees is beyond ±360, and no limits say"),
        (lambda board, fake: board.release(2), {2: 10}, RequestRefused, IGNORES),
        (lambda board, fake: board.release(), {2: 10}, RequestRefused, IGNORES),
        (lambda board, fake: board.stop(), {2: 10}, RequestRefused, IGNORES),
        (lambda board, fake: board.set_servo(2, start=False, hold=True), {2: 10}, RequestRefused, IGNORES),
        (stopped_elsewhere, {1: 10, 2: 10}, RequestRefused, IGNORES),
    ],
)
async def test_each_door_refuses_with_the_same_words(
    before: Act, targets: Targets, error: type[ServolinkError], words: str, door: Door
) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await before(board, fake)
        with pytest.raises(error, match=words):
            await door(board, targets)
        assert fake.sent_of(ExecuteActionRequest) == []


async def test_the_sync_board_refuses_and_allows_the_same() -> None:
    def use() -> None:
        with sync.connect("virtual://") as board:
            for targets, words in (({99: 10}, "no servo 99"), ({1: 1000}, "beyond ±360")):
                with pytest.raises(ServolinkError, match=words):
                    board.move(targets, duration=0.1)
                with pytest.raises(ServolinkError, match=words):
                    board.stream().send(targets)
            board.stream(any_angle=True).send({1: 400})

    use()


@pytest.mark.parametrize("door", DOORS)
async def test_any_angle_lets_any_angle_pass(door: Door) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        with suppress(TargetNotReached):  # of what is played, as the servo turns to 180 degrees only
            await door(board, {1: 1000}, any_angle=True)
        assert len(fake.sent_of(ExecuteActionRequest)) == 1


@pytest.mark.parametrize("door", [by_move, by_play])
async def test_start_starts_only_the_servos_that_would_ignore_an_allowed_movement(door: Door) -> None:
    fake = PipedBoard()
    async with opened(fake, angle_limits={1: (-90, 90)}) as board:
        await board.release()
        with pytest.raises(MotionRefused, match="beyond ±360"):
            await door(board, {1: 10, 2: 361}, start=True)
        with pytest.raises(MotionRefused, match=r"-90\.\.90|120 degrees"):
            await door(board, {1: 120}, start=True)
        await door(board, {1: 10}, start=True, dry_run=True)
        assert {servo.state for servo in await board.servos()} == {"released"}
        await door(board, {1: 10, 2: 10}, start=True)
        assert [servo.state for servo in await board.servos()] == ["ready", "ready", "released", "released"]
        assert len(fake.sent_of(ExecuteActionRequest)) == 1


async def test_limits_decide_about_angles_and_raw_angles_are_no_turns() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_limits={1: (-800, 800)}) as board:
        await board.move({1: 700}, duration=0.1)
        await board.set_angle_unit("adc", 2)
        await board.move({2: Adc(700)}, duration=0.1)
        assert len(fake.sent_of(ExecuteActionRequest)) == 2


async def test_accepted_movements_ask_for_the_list_and_the_states_once() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream(hz=100)
        for angle in range(20):
            await board.move({1: angle}, duration=0.01)
            await stream.send({2: angle, 3: -angle})
        assert len(fake.sent_of(QueryServoListRequest)) == 1
        assert len(fake.sent_of(QueryServoRequest)) == 1
        assert len(fake.sent_of(ExecuteActionRequest)) == 40


@pytest.mark.virtual_only("servos are plugged into the virtual board")
async def test_a_servo_that_was_plugged_in_or_started_elsewhere_moves() -> None:
    fake = PipedBoard(servos=2)
    async with opened(fake) as board:
        await board.move({1: 10}, duration=0.1)
        fake.servos[3] = copy(fake.servos[1])
        fake.servos[3].servo_id = 3
        await board.move({3: 10}, duration=0.1)
        await board.release(1)
        fake.servos[1].is_start = fake.servos[1].is_hold = True
        await board.move({1: 20}, duration=0.1)
        await board.move({1: 30}, duration=0.1)
        assert len(fake.sent_of(QueryServoRequest)) == 3, "before each first movement, and after a release"
        assert len(fake.sent_of(ExecuteActionRequest)) == 4


async def test_a_release_within_a_stream_ends_it_for_that_servo_only() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        stream = board.stream()
        await stream.send({1: 5, 2: 5})
        await board.release(2)
        with pytest.raises(RequestRefused, match=IGNORES):
            await stream.send({1: 6, 2: 6})
        assert await stream.send({1: 6}) == {1: 6}
        assert await board.stream().send({1: 7}) == {1: 7}


async def test_after_a_loss_the_list_is_read_again_and_no_servo_is_known_to_be_idle() -> None:
    async with connected() as board:
        await board.release(1)
        known = board._servos.known
        assert known.listed is None or known.listed
        assert known.idle((1, 2)) == [1]
        await board.connection.close()
        board._session._connection_ended(ConnectionLost("unplugged"))
        await until(board, "connected")
        assert known.listed is None
        assert known.idle((1, 2)) == []
        await board.move({1: 10}, duration=0.1)
        assert known.listed
