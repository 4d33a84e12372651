"""Boards that answer requests twice: with the setting, no second response is taken for the one to another request.

Module: servolink.connection.repeating_slots.
"""

from __future__ import annotations

from random import Random
from typing import Any

import pytest

from servolink.connection.evidence import LineEvidence
from servolink.connection.repeating_slots import RepeatingSlots
from servolink.protocol import (
    AddActionRequest,
    Packet,
    QueryActionRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoRequest,
    Request,
    TransmissionModeSettingRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, PipedBoard, now
from tests.connection.openings import LIST, STOP, opening
from tests.tables import over

TWICE = {"answers_twice": True}


class Echo(PipedBoard):
    """It answers some requests twice, loses some, and shows in each project id how many it has answered."""

    def __init__(self, chance: Random, twice: float, lost: float) -> None:
        super().__init__()
        self.chance, self.twice, self.lost = chance, twice, lost

    def _take(self, packet: Packet, frame: bytes) -> None:
        draw = self.chance.random()
        copies = 2 if self.chance.random() < self.twice else 1
        self.plan(type(packet), Fate(answers=draw >= self.lost, copies=copies))
        super()._take(packet, frame)


REQUESTS: tuple[Request[Any], ...] = (
    LIST,
    QueryProjectIDRequest(),
    QueryMemorySizeRequest(),
    QueryServoRequest(255),
    QueryServoRequest(2),
    QueryActionRequest(1),
    QueryActionRequest(2),
)


@over("twice", [1.0, 0.5, 0.1, 0.0])
@over("lost", [0.0, 0.1])
@over("seed", range(4))
async def test_each_request_gets_a_response_to_itself(twice: float, lost: float, seed: int) -> None:
    chance = Random(seed)
    board = Echo(chance, twice, lost)
    async with opening(board, seed=seed, **TWICE) as connection:
        assert (await connection.request(AddActionRequest(1, "wave"))).result == 1
        for _ in range(60):
            request = chance.choice(REQUESTS)
            response = await connection.request(request)
            assert request.accepts(response)
            if request == QueryActionRequest(2):
                assert response.action_id == 0
            if request == QueryActionRequest(1):
                assert response.action_id == 1
        assert connection.stats.reopenings == 0
        assert connection.stats.unsolicited == 0
        assert (connection.stats.repeated > 0) == (twice > 0)


async def test_a_healthy_board_is_opened_in_six_round_trips_all_the_same() -> None:
    board = PipedBoard()
    async with opening(board, **TWICE) as connection:
        begun = now()
        await connection.shake_hands()
        assert now() == pytest.approx(begun + 6 * LATENCY)
        assert connection.depth_bound == connection.write_depth_bound == 1


async def test_the_same_query_waits_for_a_fence_and_another_one_does_not() -> None:
    board = PipedBoard(usual=Fate(copies=2))
    async with opening(board, **TWICE) as connection:
        await connection.shake_hands()
        await connection.request(LIST)
        board.sent.clear()
        await connection.request(QueryServoRequest(255))
        assert len(board.sent) == 1
        await connection.request(QueryServoRequest(255))
        assert len(board.sent) == 3


async def test_a_stop_is_sent_at_once_and_its_responses_are_nobodys() -> None:
    board = PipedBoard(usual=Fate(copies=2))
    async with opening(board, **TWICE) as connection:
        await connection.shake_hands()
        await connection.request(QueryServoRequest(255))
        for _ in range(3):
            begun = now()
            await connection.send_stop(STOP)
            assert board.sent[-1] == (begun, STOP)
        assert len((await connection.request(QueryServoRequest(255))).servos) == 4


async def test_a_request_that_is_sent_alone_holds_others_back_only_until_it_is_answered() -> None:
    board = PipedBoard(usual=Fate(copies=2))
    async with opening(board, **TWICE) as connection:
        await connection.shake_hands()
        for _ in range(2):
            assert (await connection.request(TransmissionModeSettingRequest(1))).result == 1
            assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)


def test_a_response_to_nothing_settles_nothing() -> None:
    assert RepeatingSlots().settle(30121, QueryProjectIDResponse(1)) is None


def test_a_line_with_longer_contents_only_is_explained_with_the_remedy() -> None:
    assert "use ignore_extra=yes" in LineEvidence("little", longer=40061).explain_silence("6 queries")


async def test_the_mode_is_set_before_the_first_query_on_request() -> None:
    board = PipedBoard()
    async with opening(board, transmission_mode=1) as link:
        await link.shake_hands()
        assert isinstance(board.sent[0][1], TransmissionModeSettingRequest)
        assert link.opener.mode_answered == 1
        assert not link.opener.woke
