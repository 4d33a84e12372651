"""All servos of a board, on lines that are interrupted and on boards that ignore requests for all servos."""

from __future__ import annotations

from functools import partial

import pytest

from servolink.client.connect import connect
from servolink.errors import RequestTimeout
from servolink.protocol.servos import QueryServoRequest
from servolink.virtual.odd.board import OddBoard
from servolink.virtual.odd.kinds import KINDS
from servolink.virtual.transport import BoardTransport
from tests.client.fake_board import LOST, FakeBoard, opened


async def test_a_board_is_separate_after_two_missing_responses() -> None:
    async with connect(BoardTransport(KINDS["no-all"](), "virtual://"), angle_unit=None) as board:
        for is_separate in (False, True):
            assert len(await board.servos()) == 4
            assert board._servos.all.is_separate is is_separate
            assert board._servos.all.separate_ids == (1, 2, 3, 4)


async def test_a_board_that_answers_after_one_missing_response_is_not_separate() -> None:
    odd = KINDS["no-all"]()
    async with connect(BoardTransport(odd, "virtual://"), angle_unit=None) as board:
        await board.servos()
        vars(odd)["answer"] = partial(OddBoard.answer, odd)
        assert len(await board.servos()) == 4
        vars(odd).pop("answer")
        for _ in range(2):
            with pytest.raises(RequestTimeout):
                await board.servos()
        assert board._servos.all.separate_ids == ()


async def test_an_interrupted_line_makes_no_board_separate() -> None:
    fake = FakeBoard()
    async with opened(fake, angle_unit=None) as board:
        await board.servos()
        fake.plan(QueryServoRequest, *[LOST] * 100)
        for _ in range(2):
            with pytest.raises(RequestTimeout):
                await board._servos.all.states(timeout=0.5)
        assert not board._servos.all.is_separate
