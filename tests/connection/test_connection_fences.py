"""Which slot a response belongs to: what proves it, and when a fence is sent to prove it.

Module: servolink.connection.fences.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.connection.connection import Connection
from servolink.connection.fences import FENCES
from servolink.errors import OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    AddActionRequest,
    AddActionResponse,
    Packet,
    Query,
    QueryActionRequest,
    QueryActionResponse,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, LOST, PipedBoard, connected, late, lie, now, turns_of_the_loop

FENCE_KINDS = tuple(type(fence) for fence in FENCES)
LIST = QueryServoListRequest()
PROJECT = QueryProjectIDRequest()


def kinds(board: PipedBoard) -> list[type[Packet]]:
    return [type(packet) for _, packet in board.sent]


async def abandon(connection: Connection, board: PipedBoard, query: Query[Any], fate: Fate = LOST) -> None:
    """Ask something that gets no response in time."""
    board.plan(type(query), fate)
    with pytest.raises(RequestTimeout):
        await connection.request(query, timeout=0.03)


# --- a repeat needs no fence, a new call does ---------------------------------------------------------------------


@pytest.mark.parametrize("depth", [1, 4])
async def test_a_repeat_needs_no_fence_and_takes_the_response_to_any_of_its_slots(depth: int) -> None:
    board = PipedBoard()
    board.plan(QueryActionRequest, Fate(delay=0.7, says=QueryActionResponse(7, "late")))
    async with connected(board, depth=depth) as connection:
        begun = now()
        assert (await connection.request(QueryActionRequest(7))).action_caption == "late"
        assert now() == pytest.approx(begun + 0.7)
        assert connection.stats.fences == 0
        assert len(board.sent_of(QueryActionRequest)) == 3


async def test_an_equal_query_of_a_new_caller_waits_for_a_fence() -> None:
    """Or it would get the response to the abandoned one, which is older than its question."""
    board = PipedBoard()
    async with connected(board) as connection:
        await abandon(connection, board, LIST, Fate(delay=1.0, says=QueryServoListResponse((9,))))
        assert len((await connection.request(LIST)).servo_id_list) == 4
        assert [kind in FENCE_KINDS for kind in kinds(board)] == [
            False,
            True,
            *[True] * (len(board.sent) - 3),
            False,
        ]
        assert connection.stats.late_responses == 1


async def test_with_room_for_more_fence_and_query_leave_together() -> None:
    board = PipedBoard()
    async with connected(board, depth=2) as connection:
        await abandon(connection, board, LIST, Fate(delay=0.3, says=QueryServoListResponse((9,))))
        begun = now()
        assert len((await connection.request(LIST)).servo_id_list) == 4
        (_, (fence_at, fence), (query_at, query)) = board.sent
        assert fence in FENCES
        assert query == LIST
        assert fence_at == query_at == begun
        assert now() == pytest.approx(begun + 0.27)  # right behind the late one


async def test_a_query_about_something_else_waits_for_no_fence() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        await abandon(connection, board, QueryActionRequest(7))
        board.plan(QueryActionRequest, lie(QueryActionResponse(8, "eight")))
        assert (await connection.request(QueryActionRequest(8))).action_caption == "eight"
        assert connection.stats.fences == 0


async def test_no_where_two_were_asked_waits_until_it_is_clear_who_is_meant() -> None:
    """0 in place of the id can be the response to either; the response to a fence shows that one was lost."""
    board = PipedBoard()
    async with connected(board) as connection:
        await abandon(connection, board, QueryActionRequest(7), Fate(delay=1.0, says=QueryActionResponse(7, "seven")))
        board.plan(QueryActionRequest, lie(QueryActionResponse(0)))
        assert (await connection.request(QueryActionRequest(8))).action_id == 0
        assert connection.stats.mismatched == 0
    board = PipedBoard()
    async with connected(board) as connection:
        await abandon(connection, board, QueryActionRequest(7))
        board.plan(QueryActionRequest, lie(QueryActionResponse(0)), lie(QueryActionResponse(8, "eight")))
        assert (await connection.request(QueryActionRequest(8))).action_caption == "eight"
        assert connection.stats.fences == 1
        assert kinds(board)[2] in FENCE_KINDS


async def test_a_command_on_a_lane_with_an_abandoned_one_waits_for_a_fence() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, Fate(delay=0.5, says=AddActionResponse(0)))
    async with connected(board) as connection:
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1), timeout=0.1)
        assert (await connection.request(AddActionRequest(2))).result == 1
        assert connection.stats.fences >= 1
        assert connection.stats.late_responses == 1
        fences = connection.stats.fences
        await connection.request(AddActionRequest(3))
        assert connection.stats.fences == fences


async def test_any_later_response_is_as_good_as_a_fence() -> None:
    board = PipedBoard()
    board.plan(AddActionRequest, LOST)
    async with connected(board) as connection:
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1), timeout=0.1)
        await connection.request(LIST)
        await connection.request(AddActionRequest(2))
        assert connection.stats.fences == 0


async def test_the_response_to_what_was_sent_before_proves_nothing() -> None:
    board = PipedBoard()
    async with connected(board, depth=2) as connection:
        board.plan(QueryServoListRequest, late(0.2))
        earlier = asyncio.create_task(connection.request(LIST))
        await turns_of_the_loop(3)
        board.plan(AddActionRequest, Fate(delay=0.4, says=AddActionResponse(0)))
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1), timeout=0.1)
        await earlier
        assert (await connection.request(AddActionRequest(2))).result == 1
        assert connection.stats.late_responses == 1


async def test_a_late_response_that_comes_while_nobody_asks_is_a_proof_itself() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        await abandon(connection, board, LIST, late(1.5))
        await asyncio.sleep(2)
        assert connection.stats.late_responses == 1
        await connection.request(LIST)
        assert connection.stats.fences == 0


async def test_a_response_about_something_else_goes_to_nobody_and_proves_nothing() -> None:
    board = PipedBoard()
    board.plan(QueryActionRequest, Fate(delay=0.2, says=QueryActionResponse(8, "another one")))
    async with connected(board) as connection:
        assert (await connection.request(QueryActionRequest(7))).action_id == 0
        assert connection.stats.mismatched == 1
        assert connection.stats.late_responses == 0
        assert len(board.sent_of(QueryActionRequest)) == 2


# --- fences -------------------------------------------------------------------------------------------------------


async def test_fences_are_taken_in_turn_so_that_one_that_is_not_supported_costs_little() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for _ in FENCES:
            await abandon(connection, board, LIST)
            await connection.request(LIST)
        assert {kind for kind in kinds(board) if kind in FENCE_KINDS} == set(FENCE_KINDS)


@pytest.mark.parametrize("fence", FENCES)
async def test_a_fence_is_never_sent_on_the_lane_that_it_is_for(fence: Query[Any]) -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for _ in range(2 * len(FENCES)):
            sent = len(board.sent)
            await abandon(connection, board, fence)
            await connection.request(fence)
            lost, proof, again = kinds(board)[sent:]
            assert lost is again is type(fence)
            assert proof is not type(fence)


async def test_a_kind_of_fence_may_be_sent_again_while_another_is_not_answered() -> None:
    """They never run out: the first response to any of them proves all that is older than the oldest of them."""
    board = PipedBoard()
    async with connected(board) as connection:
        await abandon(connection, board, LIST)
        for kind in FENCE_KINDS:
            board.plan(kind, LOST, LOST)
        await connection.request(LIST)
        fences = [kind for kind in kinds(board) if kind in FENCE_KINDS]
        assert len(fences) == 3
        assert len(set(fences)) == 1
        await connection.request(LIST)
        assert connection.stats.fences == 3


async def test_a_fence_prefers_an_idle_lane() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for fence in FENCES:
            if not isinstance(fence, QueryRemainPowerRequest):
                board.plan(type(fence), LOST)
        for fence in FENCES:
            if not isinstance(fence, QueryRemainPowerRequest):
                with pytest.raises(RequestTimeout):
                    await connection.request(fence, timeout=0.01)
        await abandon(connection, board, LIST)
        await connection.request(LIST)
        assert kinds(board)[-2] is QueryRemainPowerRequest


async def test_a_fence_may_go_where_no_lane_is_idle() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for fence in FENCES:
            board.plan(type(fence), LOST)
            with pytest.raises(RequestTimeout):
                await connection.request(fence, timeout=0.01)
        await abandon(connection, board, LIST)
        begun = now()
        await connection.request(LIST)
        assert now() < begun + 0.3  # the first response settles the abandoned slot of its lane only


@pytest.mark.parametrize("fence", FENCES)
async def test_not_even_then_does_it_go_where_the_request_itself_will(fence: Query[Any]) -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for query in (*FENCES, LIST):
            board.plan(type(query), LOST)
            with pytest.raises(RequestTimeout):
                await connection.request(query, timeout=0.01)
        board.sent.clear()
        await connection.request(fence)
        assert kinds(board)[-1] is type(fence)
        assert type(fence) not in kinds(board)[:-1]


async def test_a_request_that_waited_for_fences_has_its_whole_patience_yet() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        await abandon(connection, board, LIST)
        board.usual_of[QueryServoListRequest] = LOST
        board.usual = late(2)
        begun = now()
        with pytest.raises(RequestTimeout):
            await connection.request(LIST)
        assert begun + 2 + 3 <= now() < begun + 7


async def test_the_late_response_to_an_abandoned_fence_kind_is_not_taken_for_a_proof_of_what_came_after_it() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        for fence in FENCES:  # so that every fence has an older slot on its lane, answered late
            board.plan(type(fence), late(0.6))
            with pytest.raises(RequestTimeout):
                await connection.request(fence, timeout=0.01)
        board.plan(AddActionRequest, Fate(delay=0.62, says=AddActionResponse(0)))
        with pytest.raises(OutcomeUnknown):
            await connection.request(AddActionRequest(1), timeout=0.1)
        assert (await connection.request(AddActionRequest(2))).result == 1


@pytest.mark.parametrize("missing", FENCE_KINDS)
async def test_a_kind_of_fence_that_the_board_does_not_support_holds_nothing_up_for_long(missing: type[Packet]) -> None:
    board = PipedBoard()
    board.usual_of[missing] = LOST
    async with connected(board) as connection:
        for _ in range(8):
            await abandon(connection, board, LIST)
            assert (await connection.request(LIST)).servo_id_list == (1, 2, 3, 4)


# --- several under way --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lost_every", "least", "most"), [(0, 8, 20), (40, 50, 150)])
async def test_among_equal_queries_a_fence_shows_gaps_and_is_not_sent_more_often_than_needed(
    lost_every: int, least: int, most: int
) -> None:
    """One in 16 sendings, but one in 128 on a line that loses nothing."""
    board = PipedBoard(usual=Fate(delay=0.05))
    if lost_every:
        board.plan(QueryServoRequest, *[LOST, *[board.usual] * (lost_every - 1)] * (1600 // lost_every))
    async with connected(board, depth=16) as connection:

        async def ask(number: int) -> None:
            await asyncio.sleep(number * 0.003)
            for _ in range(100):
                await connection.request(QueryServoRequest(1))

        await asyncio.gather(*map(ask, range(16)))
        assert least <= connection.stats.fences <= most
        assert (connection.stats.retries > 0) is bool(lost_every)


@pytest.mark.parametrize(("depth", "most"), [(4, 0.51), (8, 0.2), (16, 0.12)])
async def test_in_a_run_of_commands_a_fence_for_each_half_window_is_enough(depth: int, most: float) -> None:
    class Paced(PipedBoard):
        def _answer_at(self, when: float, data: bytes) -> None:
            super()._answer_at(max(when, self._free_at + 0.001), data)

    async with connected(Paced(), depth=depth) as connection:
        await asyncio.gather(*(connection.request(AddActionRequest(number)) for number in range(500)))
        assert connection.stats.fences <= 500 * most


async def test_in_a_run_of_commands_each_keeps_its_own_result() -> None:
    board = PipedBoard()
    async with connected(board, depth=8) as connection:
        for number in range(200):
            board.plan(AddActionRequest, lie(AddActionResponse(number % 2)))
        asked = (connection.request(AddActionRequest(number)) for number in range(200))
        results = [response.result for response in await asyncio.gather(*asked)]
        assert results == [number % 2 for number in range(200)]
        assert connection.stats.fences <= 50


async def test_in_a_run_of_commands_a_lost_result_makes_no_other_wrong() -> None:
    board = PipedBoard()
    async with connected(board, depth=8) as connection:
        for number in range(100):
            board.plan(AddActionRequest, LOST if number % 40 == 5 else lie(AddActionResponse(number % 2)))
        asked = (connection.request(AddActionRequest(number)) for number in range(100))
        outcomes = await asyncio.gather(*asked, return_exceptions=True)
        known = [(number, outcome) for number, outcome in enumerate(outcomes) if isinstance(outcome, AddActionResponse)]
        assert all(outcome.result == number % 2 for number, outcome in known)
        assert all(isinstance(outcome, (AddActionResponse, OutcomeUnknown)) for outcome in outcomes)
        assert len(known) >= 40
        executed = [packet.action_id for packet in board.executed_of(AddActionRequest)]  # type: ignore[attr-defined]
        assert len(executed) == len(set(executed)) == 97


async def test_equal_queries_behind_a_lost_one_are_all_answered_by_their_own_or_a_fresh_response() -> None:
    board = PipedBoard()
    async with connected(board, depth=4) as connection:
        for number in range(1, 400):
            board.plan(QueryProjectIDRequest, LOST if number % 7 == 0 else lie(QueryProjectIDResponse(number)))
        asked_at: list[int] = []

        async def ask() -> None:
            asked_at.append(len(board.sent_of(QueryProjectIDRequest)))
            before = asked_at[-1]
            answer = await connection.request(QueryProjectIDRequest())
            assert answer.project_id > before  # produced after its own first sending

        for _ in range(20):
            await asyncio.gather(*(ask() for _ in range(4)))


async def test_a_query_found_lost_gets_the_next_response_before_equal_ones_that_were_asked_for_later() -> None:
    board = PipedBoard()
    async with connected(board, depth=8) as connection:
        board.plan(QueryProjectIDRequest, LOST)  # so the youngest of the first four is left without a response
        order: list[int] = []

        async def ask(number: int) -> None:
            await connection.request(PROJECT)
            order.append(number)

        first = [asyncio.create_task(ask(number)) for number in range(4)]
        await asyncio.sleep(0)
        other = asyncio.create_task(connection.request(LIST))  # whose response proves that
        await asyncio.sleep(LATENCY / 2)
        later = [asyncio.create_task(ask(number)) for number in range(4, 7)]
        await asyncio.gather(*first, *later)
        await other
        assert order == list(range(7))
        assert connection.stats.retries == 1
        assert (connection.stats.timeouts, connection.stats.late_responses) == (0, 0)


async def test_a_repeat_behind_what_others_left_overdue_is_sent_with_a_fence() -> None:
    board = PipedBoard()
    async with connected(board, depth=8) as connection:
        await connection.request(LIST)
        # Each leaves a slot, and the first one of them gets the response to a later call.
        await asyncio.gather(*(abandon(connection, board, LIST) for _ in range(6)))
        for fence in FENCE_KINDS:
            board.plan(fence, LOST)
        before = len(board.sent)
        await connection.request(LIST)
        assert kinds(board)[before:].count(QueryServoListRequest) <= 4  # once for each of the others, without it


async def test_different_kinds_under_way_that_are_lost_are_asked_for_again_as_soon_as_that_is_proved() -> None:
    board = PipedBoard()
    board.plan(QueryServoListRequest, LOST)
    async with connected(board, depth=2) as connection:
        begun = now()
        await asyncio.gather(connection.request(LIST), connection.request(QueryMemorySizeRequest()))
        assert now() == pytest.approx(begun + 2 * LATENCY)
        assert connection.stats.retries == 1
