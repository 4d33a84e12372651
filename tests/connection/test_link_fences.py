"""Link: a lane that owes an answer is used again only when a fence has proved that it cannot come any more."""

from __future__ import annotations

import asyncio

import pytest

from servolink.connection.connection import FENCES, Connection
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout
from servolink.protocol.editing import (
    QueryActionRequest,
    QueryActionResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.protocol.packet import Packet
from servolink.protocol.servos import QueryServoListRequest, QueryServoListResponse
from servolink.protocol.settings import ClearAllDataRequest, QueryMemorySizeRequest, QueryRemainPowerRequest
from tests.client.fake_board import LOST, FakeBoard, Fate, late, lie, linked, now, turns_of_the_loop
from tests.virtual_time import run

FENCE_KINDS = tuple(type(fence) for fence in FENCES)


async def leave_owed(link: Connection, board: FakeBoard, fate: Fate = LOST) -> None:
    """Let a write of the project id go unanswered."""
    board.plan(WriteProjectIDRequest, fate)
    with pytest.raises(OutcomeUnknown):
        await link.request(WriteProjectIDRequest(1))


async def leave_all_fences_owed(link: Connection, board: FakeBoard) -> None:
    for fence in FENCES:
        board.plan(type(fence), LOST)
        with pytest.raises(RequestTimeout):
            await link.request(fence, timeout=0.01, retries=0)


def kinds(board: FakeBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]


def test_before_a_lane_that_owes_an_answer_is_used_again_a_fence_is_sent() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await leave_owed(link, board)
            await link.request(WriteProjectIDRequest(2))
            await link.request(WriteProjectIDRequest(3))
            assert kinds(board)[0] is kinds(board)[2] is kinds(board)[3] is WriteProjectIDRequest
            assert kinds(board)[1] in FENCE_KINDS
            assert len(board.sent) == 4
            assert link.stats.fences == 1

    run(main())


def test_other_lanes_need_no_fence_and_their_answers_prove_as_much() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await leave_owed(link, board)
            await link.request(QueryServoListRequest())
            await link.request(WriteProjectIDRequest(2))
            assert link.stats.fences == 0

    run(main())


def test_an_answer_to_what_was_sent_before_proves_nothing() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board, window=2) as link:
            board.plan(QueryServoListRequest, late(1.5))
            earlier = asyncio.create_task(link.request(QueryServoListRequest(), timeout=3))
            await turns_of_the_loop(3)
            await leave_owed(link, board, Fate(after=2.0, says=WriteProjectIDResponse(0)))
            await earlier
            following = await link.request(WriteProjectIDRequest(2))
            assert following.result == 1
            assert link.stats.fences == 1
            assert link.stats.late_responses == 1

    run(main())


def test_a_late_answer_that_comes_before_the_fence_is_dropped() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await leave_owed(link, board, Fate(after=1.5, says=WriteProjectIDResponse(0)))
            begun = now()
            assert (await link.request(WriteProjectIDRequest(2))).result == 1
            assert now() > begun + 0.5
            assert link.stats.late_responses == 1

    run(main())


def test_a_late_answer_that_comes_while_nobody_asks_is_dropped_and_is_proof_itself() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await leave_owed(link, board, Fate(after=1.5, says=WriteProjectIDResponse(0)))
            await asyncio.sleep(1)
            assert link.stats.late_responses == 1
            assert (await link.request(WriteProjectIDRequest(2))).result == 1
            assert link.stats.fences == 0

    run(main())


def test_a_late_answer_rescues_the_retry_of_the_same_query() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryActionRequest, Fate(after=1.2, says=QueryActionResponse(7, "late")))
        async with linked(board) as link:
            begun = now()
            assert (await link.request(QueryActionRequest(7))).action_caption == "late"
            assert now() == pytest.approx(begun + 1.2)
            assert len(board.sent_of(QueryActionRequest)) == 1
            assert (link.stats.rescued, link.stats.late_responses, link.stats.retries) == (1, 1, 0)

    run(main())


def test_a_late_answer_rescues_at_once_though_the_fence_is_never_answered() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryActionRequest, Fate(after=1.2, says=QueryActionResponse(7, "late")))
        for kind in FENCE_KINDS:
            board.plan(kind, LOST)
        async with linked(board) as link:
            begun = now()
            assert (await link.request(QueryActionRequest(7))).action_caption == "late"
            assert now() == pytest.approx(begun + 1.2)

    run(main())


def test_a_late_answer_rescues_nobody_who_asked_after_it() -> None:
    """The board was asked when things were different; only who asked then wants that answer."""

    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryActionRequest, Fate(after=1.2, says=QueryActionResponse(7, "old")))
        async with linked(board) as link:
            with pytest.raises(RequestTimeout):
                await link.request(QueryActionRequest(7), retries=0)
            board.plan(QueryActionRequest, lie(QueryActionResponse(7, "new")))
            assert (await link.request(QueryActionRequest(7))).action_caption == "new"
            assert link.stats.rescued == 0

    run(main())


def test_a_late_answer_about_something_else_rescues_nobody_and_proves_nothing() -> None:
    async def main() -> None:
        board = FakeBoard()
        board.plan(QueryActionRequest, Fate(after=1.2, says=QueryActionResponse(8, "another one")))
        async with linked(board) as link:
            assert (await link.request(QueryActionRequest(7))).action_id == 0
            assert link.stats.mismatched == 1
            assert link.stats.rescued == link.stats.late_responses == 0
            assert len(board.sent_of(QueryActionRequest)) == 2

    run(main())


def test_a_damaged_late_answer_is_counted_and_proves_nothing() -> None:
    async def main() -> None:
        board = FakeBoard()
        wrong = board.codec.encode(QueryServoListResponse((1, 2)))
        body = wrong[:8] + b"\x09" + wrong[9:-1]
        board.plan(QueryServoListRequest, Fate(after=1.2, mangle=lambda frame: body + bytes((sum(body) & 0xFF,))))
        async with linked(board) as link:
            assert len((await link.request(QueryServoListRequest())).servo_id_list) == 4
            assert link.stats.undecodable == 1
            assert link.stats.rescued == link.stats.late_responses == 0

    run(main())


def test_fences_are_taken_in_turn() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            for _ in FENCES:
                await leave_owed(link, board)
                await link.request(WriteProjectIDRequest(2))
            assert {kind for kind in kinds(board) if kind in FENCE_KINDS} == set(FENCE_KINDS)

    run(main())


@pytest.mark.parametrize("fence", FENCES)
def test_a_fence_is_never_sent_on_the_lane_that_it_is_for(fence: QueryProjectIDRequest) -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            for _ in range(2 * len(FENCES)):
                board.plan(type(fence), LOST)
                sent = len(board.sent)
                await link.request(fence)
                lost, proof, retry = kinds(board)[sent:]
                assert lost is retry is type(fence)
                assert proof is not type(fence)

    run(main())


def test_a_fence_that_is_not_answered_is_followed_by_another_on_another_lane() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await leave_owed(link, board)
            for kind in FENCE_KINDS:
                board.plan(kind, LOST)
            begun = now()
            with pytest.raises(RequestTimeout, match=r"not sent in 3\.0 s"):
                await link.request(WriteProjectIDRequest(2))
            assert now() == pytest.approx(begun + 3)
            fences = kinds(board)[1:]
            assert len(fences) == len(set(fences)) == 3

    run(main())


def test_when_a_later_fence_is_answered_all_is_settled() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await leave_owed(link, board)
            for kind in FENCE_KINDS:
                board.plan(kind, LOST)
            with pytest.raises(RequestTimeout):
                await link.request(WriteProjectIDRequest(2))
            board.forget_plans()
            assert (await link.request(WriteProjectIDRequest(3))).result == 1
            fences = link.stats.fences
            for query in FENCES:
                await link.request(query)
            assert link.stats.fences == fences

    run(main())


def test_the_link_ends_when_no_fence_is_left_and_the_board_stays_silent() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with linked(board) as link:
            errors: list[BaseException] = []
            begun = now()
            while link.answers.ended is None:
                assert now() < begun + 60
                requests = (link.request(WriteProjectIDRequest(2)), link.request(QueryServoListRequest()))
                errors += [
                    error
                    for error in await asyncio.gather(*requests, return_exceptions=True)
                    if isinstance(error, Exception)
                ]
            assert now() - begun < 11  # eight timeouts without any answer, and the request during which they end
            assert isinstance(errors[-1], ConnectionLost)
            assert isinstance(errors[-1].__cause__, TimeoutError)
            with pytest.raises(ConnectionLost, match="answered none of the queries"):
                await link.request(QueryProjectIDRequest())

    run(main())


def test_everyone_who_waits_is_told_when_the_link_ends_for_silence() -> None:
    async def main() -> None:
        board = FakeBoard(usual=LOST)
        async with linked(board, timeout=0.1) as link:
            requests = [link.request(QueryServoListRequest()) for _ in range(30)]
            errors = await asyncio.gather(*requests, return_exceptions=True)
            assert isinstance(errors[0], RequestTimeout)
            assert isinstance(errors[-1], ConnectionLost)
            assert len({id(error) for error in errors}) == 30

    run(main())


def test_a_board_that_only_answers_late_is_waited_for_and_not_given_up() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board) as link:
            await link.request(QueryServoListRequest())
            await asyncio.sleep(60)  # idle is not silent
            await leave_all_fences_owed(link, board)
            board.plan(QueryServoListRequest, late(2.0))
            with pytest.raises(RequestTimeout):
                await link.request(QueryServoListRequest(), retries=0)
            assert (await link.request(QueryServoListRequest())).servo_id_list == (1, 2, 3, 4)
            assert link.answers.ended is None

    run(main())


# --- more than one on the line ------------------------------------------------------------------------------------


def test_a_fence_waits_for_a_lane_that_is_in_use() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board, window=2) as link:
            await leave_owed(link, board)
            for query in (QueryMemorySizeRequest, QueryRemainPowerRequest):
                board.plan(query, LOST)
                with pytest.raises(RequestTimeout):
                    await link.request(query(), timeout=0.01, retries=0)
            board.plan(FENCE_KINDS[3], LOST)
            with pytest.raises(RequestTimeout):
                await link.request(FENCES[3], timeout=0.01, retries=0)
            board.plan(QueryProjectIDRequest, Fate(after=0.5, says=QueryProjectIDResponse(9)))
            using, writing = await asyncio.gather(
                link.request(QueryProjectIDRequest()), link.request(WriteProjectIDRequest(2))
            )
            assert (using.project_id, writing.result) == (9, 1)

    run(main())


def test_two_requests_that_need_each_others_lane_for_a_fence_do_not_wait_for_ever() -> None:
    async def main() -> None:
        board = FakeBoard()
        async with linked(board, window=2) as link:
            board.plan(ClearAllDataRequest, LOST)
            for query in FENCES[2:]:
                board.plan(type(query), LOST)
            for query in FENCES[2:]:
                with pytest.raises(RequestTimeout):
                    await link.request(query, timeout=0.01, retries=0)
            clearing = asyncio.create_task(link.request(ClearAllDataRequest()))
            await turns_of_the_loop(2)
            queries = [asyncio.create_task(link.request(query)) for query in FENCES[:2]]
            await asyncio.wait((clearing, *queries), timeout=10)
            assert [task.done() for task in (clearing, *queries)] == [True] * 3
            assert isinstance(clearing.exception(), OutcomeUnknown)
            for task in queries:
                assert task.exception() is None or isinstance(task.exception(), RequestTimeout)
            assert (await link.request(WriteProjectIDRequest(2))).result == 1

    run(main())
