"""All servos of a board, on lines that are interrupted and on boards that ignore requests for all servos."""

from __future__ import annotations

from functools import partial

import pytest

from servolink.client.connecting import connect
from servolink.errors import DecodeError, RequestTimeout
from servolink.protocol import QueryServoListRequest, QueryServoRequest, QueryServoResponse
from servolink.virtual import BoardTransport
from tests.client.piped_board import LOST, PipedBoard, lie, opened
from tests.lab.odd.board import OddBoard
from tests.lab.odd.kinds import KINDS
from tests.lab.odd.wire import Values


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
    fake = PipedBoard()
    async with opened(fake, angle_unit=None) as board:
        await board.servos()
        fake.plan(QueryServoRequest, *[LOST] * 100)
        for _ in range(2):
            with pytest.raises(RequestTimeout):
                await board._servos.all.states(timeout=0.5)
        assert not board._servos.all.is_separate


async def test_a_list_that_is_not_read_makes_no_servo_vanish() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_unit=None) as board:
        await board.servos()
        fake.plan(QueryServoListRequest, *[LOST] * 100)
        assert await board._servos.all.listed(again=True) == {1, 2, 3, 4}


async def test_no_state_at_all_is_an_error_where_servos_are_known() -> None:
    fake = PipedBoard()
    async with opened(fake, angle_unit=None) as board:
        await board.servos()
        fake.plan(QueryServoRequest, *[lie(QueryServoResponse())] * 100)
        with pytest.raises(DecodeError, match="no servo reports"):
            await board.servos()


async def test_what_is_missing_on_a_damaging_line_makes_no_board_separate() -> None:
    odd = KINDS["no-all"]()
    async with connect(BoardTransport(odd, "virtual://"), angle_unit=None) as board:
        answer = odd.answer

        def damaged(packet_id: int, values: Values) -> Values | None:
            board.stats.skipped["checksum"] = board.stats.skipped.get("checksum", 0) + 1
            return answer(packet_id, values)

        vars(odd)["answer"] = damaged
        for _ in range(3):
            assert len(await board.servos()) == 4
            assert not board._servos.all.is_separate
