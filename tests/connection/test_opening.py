"""Opening: nothing that an earlier program is owed is taken for a response.

Modules: servolink.connection.core, servolink.connection.times.
"""

from __future__ import annotations

import asyncio
from random import Random

import pytest

from servolink.connection.core import ConnectionCore
from servolink.connection.fences import FENCES
from servolink.connection.opening import Opening
from servolink.connection.options import ConnectionOptions
from servolink.errors import OpenError
from servolink.protocol import (
    ButtonEventResponse,
    Packet,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListResponse,
    SetServoParameterRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, SWALLOWED, PipedBoard, connected, late, lie, now
from tests.connection.openings import FENCE_KINDS, LIST, STOP, kinds, opening, owe
from tests.tables import over
from tests.virtual_time import run

# --- a good board -------------------------------------------------------------------------------------------------


async def test_a_handshake_takes_six_short_queries_and_nothing_else() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        begun = now()
        await connection.shake_hands()
        assert now() == pytest.approx(begun + 6 * LATENCY)
        assert len(board.sent) == 6
        assert set(kinds(board)) <= set(FENCE_KINDS)
        assert kinds(board).count(kinds(board)[-1]) == 1
        await connection.shake_hands()  # once is enough
        assert len(board.sent) == 6


def test_its_queries_are_drawn_anew_each_time() -> None:
    async def main(seed: int) -> tuple[type[Packet], ...]:
        board = PipedBoard()
        async with opening(board, seed=seed) as connection:
            await connection.shake_hands()
        return tuple(kinds(board))

    assert len({run(main(seed)) for seed in range(20)}) > 15


@over("seed", range(30))
async def test_what_is_lost_is_asked_again_and_its_late_response_is_not_taken_for_one_to_a_request(seed: int) -> None:
    board = PipedBoard()
    chance = Random(seed)
    for kind in FENCE_KINDS:
        board.plan(kind, *(chance.choice((Fate(), LOST, SWALLOWED, late(0.4), late(1.1))) for _ in range(3)))
    async with opening(board, seed=seed, patience=10) as connection:
        await connection.shake_hands()
        board.forget_plans()
        for number in range(1, 6):
            board.plan(QueryProjectIDRequest, lie(QueryProjectIDResponse(number)))
            assert (await connection.request(QueryProjectIDRequest())).project_id == number
        assert connection.stats.reopenings == 0


# --- what an earlier program is owed ------------------------------------------------------------------------------


@over("seed", range(40))
async def test_up_to_five_responses_to_an_earlier_program_are_never_taken_for_ours(seed: int) -> None:
    board = PipedBoard()
    chance = Random(1000 + seed)
    owed = [
        (chance.choice([*FENCES, LIST]), Fate(delay=chance.uniform(0, 2), says=None))
        for _ in range(chance.randint(1, 4))
    ]
    wrong = (LIST, Fate(delay=chance.uniform(0, 2), says=QueryServoListResponse((99,))))
    async with opening(board, seed=seed) as connection:
        await owe(board, *owed, wrong)
        assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)
        assert connection.stats.late_responses == connection.stats.unsolicited == 0


async def test_a_response_that_does_not_fit_makes_it_longer() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        await owe(board, (LIST, late(0.006)))
        await connection.shake_hands()
        assert len(board.sent) >= 10


async def test_without_it_the_response_to_an_earlier_program_is_taken_for_ours() -> None:
    """What the handshake is for."""
    board = PipedBoard()
    async with connected(board) as connection:
        await owe(board, (LIST, Fate(delay=0.1, says=QueryServoListResponse((99,)))))
        assert (await connection.request(LIST)).servo_id_list == (99,)


async def test_what_comes_before_the_handshake_opens_nothing_twice() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        board.speak(QueryProjectIDResponse(5))
        await connection.shake_hands()
        assert connection.stats.reopenings == 0
        assert len(board.sent) == 6


# --- button events, stops -----------------------------------------------------------------------------------------


async def test_button_events_arrive_meanwhile_and_disturb_nothing() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        events: list[ButtonEventResponse] = []
        connection.answers.on_event = events.append
        for number in range(20):
            asyncio.get_running_loop().call_later(number / 1000, board.speak, ButtonEventResponse(number, 1))
        asyncio.get_running_loop().call_later(0.003, board.speak, LIST)  # nothing that a board sends
        await connection.shake_hands()
        assert len(events) == 20
        assert len(board.sent) == 6


async def test_a_stop_goes_at_once_and_the_handshake_begins_again() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        opened = asyncio.create_task(connection.shake_hands())
        await asyncio.sleep(2.5 * LATENCY)
        begun = now()
        await connection.send_stop(STOP)
        assert board.sent[-1] == (begun, STOP)
        await opened
        at = kinds(board).index(SetServoParameterRequest)
        assert len(kinds(board)[at + 1 :]) >= 6
        begun = now()
        assert (await connection.request(SetServoParameterRequest(1, 1, 1))).servo_id == 1
        assert connection.stats.fences == 0  # the handshake has settled the stop


async def test_a_stop_before_it_waits_for_nothing() -> None:
    board = PipedBoard()
    async with opening(board) as connection:
        await connection.send_stop(STOP)
        assert kinds(board) == [SetServoParameterRequest]
        await connection.request(LIST)
        assert len(board.sent) == 8


async def test_a_stop_reaches_a_board_that_answers_nothing() -> None:
    board = PipedBoard(usual=SWALLOWED)
    async with opening(board) as connection:
        opened = asyncio.create_task(connection.shake_hands())
        for _ in range(3):
            await asyncio.sleep(0.7)
            begun = now()
            await connection.send_stop(STOP)
            assert now() == begun
        with pytest.raises(OpenError, match="no board answers"):
            await opened
        assert board.executed_of(SetServoParameterRequest) == [STOP] * 3


async def test_a_later_opening_has_one_limit_for_pause_handshake_and_comparison() -> None:
    loop = asyncio.get_running_loop()

    async def send(packet: Packet) -> None:
        """Send to nobody."""

    core = ConnectionCore("fake://", ConnectionOptions())
    later = Opening(core, send, transmission_mode="auto", random=Random(1), is_first=False)
    begun, life = now(), later._life
    assert life.limit(0.0) <= begun + 17
    life.heard_at = begun
    life.count_from(begun + 16)  # the line was quiet late, and the handshake took its time
    assert life.limit(0.0) == begun + 17
    comparing = loop.create_task(later._compare(FENCES))
    while not comparing.done():
        later.heard(QueryServoListResponse.packet_id, b"\x01\x01")  # without a pause
        await asyncio.sleep(0.05)
    assert now() <= begun + 17.5
