"""`servolink.testing`: programs in virtual time, and a board that misbehaves on request."""

from __future__ import annotations

import asyncio
import time

import pytest

import servolink
from servolink import Action, ConnectionLost, OutcomeUnknown, Rejected, RequestTimeout, Step
from servolink.protocol import (
    AddActionRequest,
    ExecuteActionRequest,
    Packet,
    QueryActionListRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    SetServoParameterRequest,
)
from servolink.testing import FakeBoard, Fate, run
from servolink.virtual import BoardKind

WAVE = Action(7, "wave", (Step(1, 40, 100),))


def test_a_movement_of_a_virtual_board_takes_no_real_time() -> None:
    async def main() -> tuple[float, float]:
        begun_at = asyncio.get_running_loop().time()
        async with servolink.connect("virtual://?servos=4") as board:
            await board.move({1: 120}, duration=300, wait=True)
            return asyncio.get_running_loop().time() - begun_at, float((await board.servo(1)).angle)

    begun_at = time.monotonic()
    virtual_seconds, angle = run(main())
    assert time.monotonic() - begun_at < 60
    assert 300 <= virtual_seconds < 310
    assert angle == 120


def test_a_task_that_is_left_behind_is_an_error() -> None:
    async def main() -> None:
        task = asyncio.create_task(asyncio.sleep(1), name="forgotten")
        asyncio.get_running_loop().call_later(2, task.cancel)

    with pytest.raises(AssertionError, match=r"tasks left behind: .*forgotten"):
        run(main())


def test_a_program_that_waits_for_nothing_fails_at_once() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="deadlock: nothing is ready"):
        run(main())


async def test_a_fake_board_lists_the_requests_it_has_received() -> None:
    fake = FakeBoard(servos=4)
    async with fake.connect() as board:
        await board.move({1: 60}, duration=0.5, wait=True)
        await board.release(2)
    assert [request.steps for request in fake.received(ExecuteActionRequest)] == [(Step(1, 60, 50),)]
    assert fake.received(SetServoParameterRequest) == [SetServoParameterRequest(2, 0, 0)]
    assert len(fake.requests) > 2, "those of connecting as well"


async def test_a_dropped_query_is_repeated_and_no_other_request_is_lost() -> None:
    fake = FakeBoard(servos=2)
    async with fake.connect() as board:
        fake.requests.clear()
        fake.drop(QueryServoListRequest, times=2)
        assert await board.project_id() == 0
        assert await board.servo_ids() == (1, 2)
    assert len(fake.received(QueryServoListRequest)) >= 3


async def test_a_command_without_response_is_sent_once_and_its_outcome_unknown() -> None:
    fake = FakeBoard()
    async with fake.connect() as board:
        fake.drop(AddActionRequest)
        with pytest.raises(OutcomeUnknown):
            await board.add_action(WAVE)
        assert await board.actions() == ()
        fake.drop_response(AddActionRequest)
        with pytest.raises(OutcomeUnknown):
            await board.add_action(WAVE)
        assert [entry.action_id for entry in await board.actions()] == [7]
    assert len(fake.received(AddActionRequest)) == 2


async def test_a_refused_request_is_rejected_without_effect() -> None:
    fake = FakeBoard()
    async with fake.connect() as board:
        fake.refuse(AddActionRequest)
        with pytest.raises(Rejected):
            await board.add_action(WAVE)
        assert await board.actions() == ()
        assert await board.add_action(WAVE) == WAVE


def test_only_a_request_with_a_result_can_be_refused() -> None:
    with pytest.raises(TypeError, match="QueryActionListRequest cannot be refused"):
        FakeBoard().refuse(QueryActionListRequest)  # type: ignore[arg-type]


def test_a_fault_happens_at_least_once() -> None:
    with pytest.raises(ValueError, match="times must be at least 1, not 0"):
        FakeBoard().drop(times=0)


async def test_fates_come_in_the_order_of_their_plan_and_then_the_usual_ones() -> None:
    fake = FakeBoard(servos=2)
    async with fake.connect() as board:
        fake.plan(QueryProjectIDRequest, Fate(says=QueryProjectIDResponse(6)), Fate())
        fake.plan(Packet, Fate(says=QueryProjectIDResponse(8)))
        assert [await board.project_id() for _ in range(4)] == [6, 0, 8, 0]
        fake.usual_of[QueryProjectIDRequest] = Fate(says=QueryProjectIDResponse(9))
        assert [await board.project_id() for _ in range(2)] == [9, 9]
        assert await board.servo_ids() == (1, 2)
        fake.plan(QueryProjectIDRequest, Fate(says=QueryProjectIDResponse(7)))
        fake.forget_plans()
        assert await board.project_id() == 0
    assert fake.usual == Fate()


async def test_the_usual_fate_is_that_of_all_requests() -> None:
    fake, loop = FakeBoard(usual=Fate(delay=0.05)), asyncio.get_running_loop()
    async with fake.connect() as board:
        begun_at = loop.time()
        await board.project_id()
        assert loop.time() - begun_at == pytest.approx(0.05)
        fake.usual = Fate()
        begun_at = loop.time()
        await board.project_id()
        assert loop.time() - begun_at < 0.04


async def test_a_damaged_response_and_a_second_one_are_seen_by_the_connection() -> None:
    fake = FakeBoard(byte_order="big")
    async with fake.connect(byte_order="big") as board:
        strays, retries = board.stats.unsolicited, board.stats.retries
        fake.plan(QueryRemainPowerRequest, Fate(copies=2))
        assert await board.battery() == 100
        await asyncio.sleep(1)
        assert board.stats.unsolicited == strays + 1
        fake.plan(QueryRemainPowerRequest, Fate(damage=lambda frame: frame[:-1]))
        assert await board.battery() == 100
        assert board.stats.retries == retries + 1


async def test_a_delayed_response_comes_that_much_later() -> None:
    fake, loop = FakeBoard(kind=BoardKind(turnaround=0.02)), asyncio.get_running_loop()
    async with fake.connect(patience=10) as board:
        fake.delay(0.1, QueryRemainPowerRequest)
        begun_at = loop.time()
        assert await board.battery() == 100
        assert loop.time() - begun_at == pytest.approx(0.12)
        begun_at = loop.time()
        await board.battery()
        assert loop.time() - begun_at < 0.1


async def test_a_board_that_never_answers_is_a_timeout() -> None:
    fake = FakeBoard()
    async with fake.connect(patience=1) as board:
        fake.drop(times=1000)
        with pytest.raises(RequestTimeout):
            await board.battery()


@pytest.mark.parametrize("is_planned", [True, False])
async def test_a_lost_connection_is_opened_again_to_the_same_board(is_planned: bool) -> None:
    fake = FakeBoard()
    fake.script("0.1 push 1 20")
    async with fake.connect(reconnect=True) as board:
        await board.add_action(WAVE)
        fake.lose_connection(*(QueryRemainPowerRequest,) * is_planned)
        with pytest.raises(ConnectionLost):
            await board.battery()
        async for state in board.states():
            if state == "connected":
                break
        assert await board.action(7) == WAVE


async def test_a_line_to_a_fake_board_may_be_bad_as_well() -> None:
    fake = FakeBoard(servos=3)
    async with servolink.connect(f"{fake.url}?drop=0.01&seed=4") as board:
        for _ in range(50):
            assert await board.servo_ids() == (1, 2, 3)
        assert board.stats.retries > 0


async def test_a_script_presses_buttons_at_its_seconds() -> None:
    fake = FakeBoard()
    async with fake.connect() as board, board.button_events() as events:
        await board.set_transmission_mode(1)
        begun_at = asyncio.get_running_loop().time()
        fake.script("1.5 press 3")
        event = await anext(events)
        assert (event.button_id, event.kind) == (3, "press")
        assert asyncio.get_running_loop().time() - begun_at == pytest.approx(1.5)
