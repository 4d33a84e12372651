"""Stop: before everything else, confirmed, and nothing that was asked for before it moves afterwards."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from servolink.client.board import Board
from servolink.client.connecting import connect
from servolink.connection import FENCES
from servolink.errors import ConnectionLost, OutcomeUnknown, Reason, RequestError, RequestRefused, RequestTimeout
from servolink.protocol import (
    ALL_SERVOS,
    Action,
    AddMacroRequest,
    ClearAllDataRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Macro,
    MacroCommand,
    QueryActionListRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    WriteProjectIDRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, SWALLOWED, PipedBoard, late, lie, now, opened, turns_of_the_loop
from tests.virtual_time import run

STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
MOTION = (ExecuteActionRequest, ExecuteActionExRequest, ExecuteMacroRequest)


def reported(is_start: int, is_hold: int) -> QueryServoResponse:
    flags = {1: (0, 1), 2: (is_start, is_hold), 3: (0, 1), 4: (0, 1)}
    return QueryServoResponse(tuple(ServoState(servo_id, 0, 0, 0, 0, *flags[servo_id]) for servo_id in flags))


async def test_stop_stops_and_holds_all_and_reads_that_back() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.move({1: 170}, duration=10)
        await asyncio.sleep(5)
        await board.stop()
        assert fake.executed_of(SetServoParameterRequest) == [STOP]
        assert {(servo.is_start, servo.is_hold) for servo in await board.servos()} == {(False, True)}
        stopped_at = (await board.servo(1)).angle
        await asyncio.sleep(5)
        assert (await board.servo(1)).angle == stopped_at
        assert 60 < stopped_at < 110


@pytest.mark.parametrize(
    ("asked", "is_silent"), [(1.0, False), (2.5, False), (2.5, True)], ids=["turning", "blocked", "silent"]
)
async def test_a_movement_that_is_waited_for_says_that_a_stop_has_ended_it(asked: float, is_silent: bool) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        fake.servos[2].is_start = False  # so that it is still waited for half a second after its time
        moving = asyncio.create_task(board.move({1: 100, 2: 100}, duration=2, wait=True))
        await asyncio.sleep(asked)
        if is_silent:
            fake.usual_of[QueryServoRequest] = SWALLOWED
        stopping = asyncio.create_task(board.stop())
        begun = now()
        with pytest.raises(RequestRefused, match=r"^the motion was started, and then ended by a stop") as failed:
            await moving
        assert failed.value.reason is Reason.STOP
        assert now() - begun <= (board.connection.patience + 0.5 if is_silent else 0.2)
        await asyncio.wait([stopping])


@pytest.mark.parametrize("depth", [1, 2])
async def test_stop_goes_before_all_who_wait_and_before_who_has_the_turn(depth: int) -> None:
    fake = PipedBoard()
    fake.plan(QueryServoListRequest, late(0.12))
    async with opened(fake, depth=depth) as board:
        ahead = asyncio.create_task(board.servo_ids())
        waiting = [asyncio.create_task(board.project_id()) for _ in range(20)]
        await asyncio.sleep(0.1)
        begun = now()
        stopping = asyncio.create_task(board.stop())
        await turns_of_the_loop(2)
        assert fake.sent_of(SetServoParameterRequest) == [begun]
        await stopping
        sent = [type(packet) for _, packet in fake.sent]
        before = sent[: sent.index(QueryServoRequest)]
        assert before.count(QueryProjectIDRequest) == depth - 1  # the read-back, too, went before the others
        await asyncio.gather(ahead, *waiting)


async def test_stop_goes_while_all_data_is_being_cleared() -> None:
    fake = PipedBoard()
    fake.plan(ClearAllDataRequest, late(0.5))
    async with opened(fake) as board:
        clearing = asyncio.create_task(board.clear_all_data())
        await asyncio.sleep(0.1)
        begun = now()
        await board.stop()
        assert fake.sent_of(SetServoParameterRequest) == [begun]
        await clearing


async def test_stop_overtakes_a_set_servo_that_waits_for_its_answer() -> None:
    fake = PipedBoard()
    fake.plan(SetServoParameterRequest, late(0.5))
    async with opened(fake) as board:
        setting = asyncio.create_task(board.set_servo(2, start=True, hold=True))
        await asyncio.sleep(0.1)
        begun = now()
        stopping = asyncio.create_task(board.stop())
        with pytest.raises(OutcomeUnknown, match="overtaken by a stop"):
            await setting
        assert now() == begun
        await stopping
        assert {servo.is_start for servo in await board.servos()} == {False}


async def test_a_cancelled_set_servo_that_waits_for_its_answer_is_overtaken_too() -> None:
    fake = PipedBoard()
    fake.plan(SetServoParameterRequest, SWALLOWED)
    async with opened(fake) as board:
        setting = asyncio.create_task(board.set_servo(2, start=True, hold=True))
        await turns_of_the_loop(3)
        setting.cancel()
        await turns_of_the_loop(3)
        begun = now()
        await board.stop()
        # The read-back waits for a fence, and is compared with the list of servos.
        assert now() - begun == pytest.approx(3 * LATENCY)
        await board.release()


MOVES: dict[str, Callable[[Board], Awaitable[object]]] = {
    "move": lambda board: board.move({1: 90}, duration=1),
    "by speed": lambda board: board.move({1: 90}, speed=90),
    "action": lambda board: board.run_action(1),
    "macro": lambda board: board.run_macro(1),
    "start": lambda board: board.set_servo(1, start=True, hold=True),
}


async def attempt(call: Awaitable[object]) -> object:
    return await call


@pytest.mark.parametrize("name", MOVES)
async def test_what_was_asked_for_before_a_stop_and_waits_for_its_turn_does_not_move_after_it(name: str) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.add_action(Action(1, "wave", (Step(1, 90, 100),)))
        await board.add_macro(Macro(1, "dance", (MacroCommand(1),)))
        await board.servos()
        fake.plan(QueryActionListRequest, late(0.5))
        blocking = asyncio.create_task(board.actions())
        await turns_of_the_loop(3)
        moving = asyncio.create_task(attempt(MOVES[name](board)))
        await turns_of_the_loop(3)
        await board.stop()
        with pytest.raises(RequestError, match=r"was not (sent|run): a stop came first"):
            await moving
        await blocking
        assert [packet for _, packet in fake.sent if isinstance(packet, MOTION)] == []
        assert fake.executed_of(SetServoParameterRequest) == [STOP]


def test_a_movement_that_is_reading_the_angles_or_setting_the_unit_does_not_move_after_a_stop() -> None:
    async def main(kind: type[QueryServoRequest | SetAngleUnitRequest]) -> None:
        fake = PipedBoard()
        fake.plan(kind, late(0.5))
        async with opened(fake) as board:
            moving = asyncio.create_task(board.move({1: 90}, speed=90))
            await asyncio.sleep(0.1)
            stopping = asyncio.create_task(board.stop())
            with pytest.raises(RequestError, match="ExecuteActionRequest was not sent: a stop came first"):
                await moving
            await stopping
            assert fake.sent_of(ExecuteActionRequest) == []

    run(main(QueryServoRequest))
    run(main(SetAngleUnitRequest))


@pytest.mark.parametrize("name", ["macro", "start", "move"])
async def test_what_is_waiting_for_a_fence_does_not_move_after_a_stop(name: str) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.add_action(Action(1, "wave", (Step(1, 90, 100),)))
        await board.add_macro(Macro(1, "dance", (MacroCommand(1),)))
        await board.servos()
        fake.plan(ClearAllDataRequest, LOST)
        clearing = asyncio.create_task(board.clear_all_data())
        await turns_of_the_loop(3)
        clearing.cancel()
        await asyncio.sleep(2)
        for fence in FENCES:
            fake.plan(type(fence), late(0.5))
        moving = asyncio.create_task(attempt(MOVES[name](board)))
        await asyncio.sleep(0.1)
        stopping = asyncio.create_task(board.stop())
        with pytest.raises(RequestError, match="a stop came first"):
            await moving
        await stopping
        assert [packet for _, packet in fake.sent if isinstance(packet, MOTION)] == []


async def test_what_is_asked_for_after_a_stop_moves() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.stop()
        await board.set_servo(1, start=True, hold=True)
        await board.move({1: 90}, duration=1)
        await board.add_macro(Macro(1, "m"))
        await board.run_macro(1)
        assert len(fake.executed_of(ExecuteActionRequest)) == 1
        assert len(fake.executed_of(AddMacroRequest)) == len(fake.executed_of(ExecuteMacroRequest)) == 1


async def test_stopping_and_releasing_wait_for_no_stop() -> None:
    fake = PipedBoard()
    fake.plan(QueryActionListRequest, late(0.5))
    async with opened(fake) as board:
        blocking = asyncio.create_task(board.actions())
        await turns_of_the_loop(3)
        releasing = asyncio.create_task(board.release())
        await turns_of_the_loop(3)
        await board.stop()
        await releasing
        await blocking
        assert fake.executed_of(SetServoParameterRequest) == [STOP, SetServoParameterRequest(ALL_SERVOS, 0, 0)]


@pytest.mark.parametrize(
    ("doubt", "sendings"),
    [(reported(1, 1), 3), (reported(0, 0), 3), (QueryServoResponse(), 2)],  # the last is asked of each servo
)
async def test_a_stop_that_is_not_confirmed_is_sent_again(doubt: QueryServoResponse, sendings: int) -> None:
    fake = PipedBoard()
    fake.plan(QueryServoRequest, lie(doubt), lie(doubt))
    async with opened(fake) as board:
        await board.stop()
        assert fake.executed_of(SetServoParameterRequest).count(STOP) == sendings


@pytest.mark.parametrize(
    ("doubt", "words"),
    [
        (lie(reported(1, 1)), r"servos \[2\] report that they may still move"),
        (lie(reported(0, 0)), r"servos \[2\] report .* or are not held"),
        (lie(QueryServoResponse()), "no servo reports"),
        (LOST, "QueryServoRequest.* was not answered"),
    ],
)
async def test_a_stop_that_cannot_be_confirmed_three_times_is_unknown(doubt: Fate, words: str) -> None:
    fake = PipedBoard()
    fake.plan(QueryServoRequest, *[doubt] * 100)
    async with opened(fake) as board:
        with pytest.raises(OutcomeUnknown, match=r"sent 3 times and could not be confirmed: .*" + words) as caught:
            await board.stop()
        assert caught.value.request == STOP
        assert fake.executed_of(SetServoParameterRequest).count(STOP) == 3


async def test_a_stop_that_was_lost_is_sent_again() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        fake.plan(SetServoParameterRequest, LOST, LOST)
        await board.stop()
        assert {servo.is_start for servo in await board.servos()} == {False}


async def test_a_damaged_read_back_is_none() -> None:
    fake = PipedBoard()

    def one_more(frame: bytes) -> bytes:
        body = frame[:8] + bytes((frame[8] + 1,)) + frame[9:-1]
        return body + bytes((sum(body) & 0xFF,))

    fake.plan(QueryServoRequest, *[Fate(damage=one_more)] * 100)
    async with opened(fake) as board:
        with pytest.raises(OutcomeUnknown, match="QueryServoResponse: 5 servos take"):
            await board.stop()


@pytest.mark.parametrize("silence", [0.5, 2.0])
async def test_stop_is_sent_though_every_lane_owes_an_answer(silence: float) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        await board.servos()
        fake.usual = Fate(delay=2.5)
        asked = (*FENCES, QueryServoRequest(1), SetServoParameterRequest(1, 1, 1), WriteProjectIDRequest(1))
        for request in asked:
            with pytest.raises((RequestTimeout, OutcomeUnknown)):
                await board.request(request, timeout=0.01)
        fake.usual = Fate()
        await asyncio.sleep(silence)
        begun = now()
        stopping = asyncio.create_task(board.stop())
        await turns_of_the_loop(2)
        assert fake.sent_of(SetServoParameterRequest)[-1] == begun
        await stopping
        assert {servo.is_start for servo in await board.servos()} == {False}


async def test_stop_says_when_the_connection_is_gone() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        fake.vanish()
        with pytest.raises(ConnectionLost, match="device disconnected"):
            await board.stop()


async def test_a_stop_goes_before_the_handshake_of_a_slow_board_and_is_confirmed_after_it() -> None:
    fake = PipedBoard(usual=late(0.5))
    async with connect(fake, handshake=False) as board:
        await board.stop()
        first = fake.sent[0][1]
        assert first == STOP
        assert fake.sent_of(SetServoParameterRequest) == [1000]
        assert fake.executed_of(SetServoParameterRequest) == [STOP]
        assert {servo.is_start for servo in await board.servos()} == {False}


async def test_a_stop_that_a_silent_board_may_have_got_is_not_confirmed() -> None:
    fake = PipedBoard(usual=SWALLOWED)
    async with connect(fake, handshake=False) as board:
        with pytest.raises(ConnectionLost, match=r"a stop was sent and could not be confirmed; stop again: .*fake"):
            await board.stop()
        assert fake.sent_of(SetServoParameterRequest) == [1000]
