"""RequestScheduler: who may send next."""

from __future__ import annotations

import pytest

from servolink.connection.call import Slot
from servolink.protocol import (
    AddActionRequest,
    QueryActionRequest,
)
from tests.client.piped_board import turns_of_the_loop
from tests.connection.permits import ALONE, UNANSWERED, A, B, C, D, Line, close, end

# --- order --------------------------------------------------------------------------------------------------------


async def test_one_after_another_in_the_order_they_came() -> None:
    line = Line()
    for name, packet in zip("abc", (A, B, C), strict=True):
        line.ask(name, packet)
    line.ask("d", UNANSWERED)
    assert await line.got() == ["a"]
    for name, following in ("ab", "bc", "cd"):
        line.answer(name)
        assert await line.got() == [following]


@pytest.mark.parametrize("depth", [1, 2, 3])
async def test_no_more_than_the_depth_at_a_time(depth: int) -> None:
    line = Line(depth)
    for name, packet in zip("abcd", (A, B, C, D), strict=True):
        line.ask(name, packet)
    assert await line.got() == list("abcd")[:depth]
    line.answer("a")
    assert await line.got() == ["abcd"[depth]]
    await end(line)


@pytest.mark.parametrize("depth", [2, 3])
async def test_a_response_that_is_kept_makes_room_for_one_more(depth: int) -> None:
    """The board is done with a request whose response is kept."""
    line = Line(depth)
    line.slots.unmatched = 1
    for name, packet in zip("abcd", (A, B, C, D), strict=True):
        line.ask(name, packet)
    assert await line.got() == list("abcd")[: depth + 1]
    await end(line)


async def test_nobody_overtakes_one_who_has_to_wait() -> None:
    line = Line(depth=4)
    for name, packet in (("a", AddActionRequest(1)), ("a again", AddActionRequest(1)), ("b", B)):
        line.ask(name, packet)
    assert await line.got() == ["a"]
    line.answer("a")
    assert await line.got() == ["a again", "b"]


async def test_equal_queries_go_together_and_different_ones_of_a_kind_too_if_their_responses_tell_them_apart() -> None:
    line = Line(depth=4)
    for name, packet in (("a", A), ("equal", A), ("one", QueryActionRequest(1)), ("two", QueryActionRequest(2))):
        line.ask(name, packet)
    assert await line.got() == ["a", "equal", "one", "two"]


async def test_what_goes_alone_overlaps_nothing_and_is_not_starved_by_those_behind_it() -> None:
    line = Line(depth=3)
    for name, packet in (("a", A), ("b", B), ("alone", ALONE), ("behind", D)):
        line.ask(name, packet)
    assert await line.got() == ["a", "b"]
    line.answer("a")
    assert await line.got() == []
    line.answer("b")
    assert await line.got() == ["alone"]
    line.ask("later", A)
    assert await line.got() == []
    line.answer("alone")
    assert await line.got() == ["behind", "later"]


async def test_what_has_a_permit_and_is_not_sent_yet_counts_too() -> None:
    line = Line(3)
    line.scheduler.pause()
    for name, packet in (("a", A), ("alone", ALONE)):
        line.ask(name, packet)
    await turns_of_the_loop(3)
    line.scheduler.resume()  # "a" has the permit and does not know it yet
    assert await line.got() == ["a"]
    line.answer("a")
    assert await line.got() == ["alone"]
    line.answer("alone")
    line.scheduler.pause()
    line.ask("b", B)
    await turns_of_the_loop(3)
    line.scheduler.resume()
    assert not line.scheduler.acquire_at_once(ALONE)
    assert await line.got() == ["b"]


async def test_a_permit_is_taken_at_once_only_if_nothing_at_all_stands_in_the_way() -> None:
    line = Line(2)
    scheduler = line.scheduler
    scheduler.pause()
    assert not scheduler.acquire_at_once(A)
    scheduler.resume()
    slot = Slot(ALONE, line.slots.lanes[ALONE.packet_id + 1], None)
    line.slots.open(slot)
    assert not scheduler.acquire_at_once(A)
    line.ask("waits", B)
    assert await line.got() == []
    close(line.slots, slot)
    assert not scheduler.acquire_at_once(A)  # nobody is overtaken
    scheduler.grant()
    assert await line.got() == ["waits"]
    assert scheduler.acquire_at_once(A)
    assert not scheduler.acquire_at_once(C)
    scheduler.release(A)
    assert scheduler.acquire_at_once(C)


async def test_first_goes_before_all_who_wait_even_before_what_goes_alone() -> None:
    line = Line()
    line.ask("a", A)
    line.ask("alone", ALONE)
    line.ask("c", C)
    await turns_of_the_loop(2)
    line.ask("first", D, first=True)
    assert await line.got() == ["a"]
    line.answer("a")
    assert await line.got() == ["first"]
    line.answer("first")
    assert await line.got() == ["alone"]
    await end(line)


async def test_during_an_opening_nobody_gets_a_permit() -> None:
    line = Line()
    line.scheduler.pause()
    for name, packet in zip("ab", (A, B), strict=True):
        line.ask(name, packet)
    assert await line.got() == []
    line.scheduler.resume()
    assert await line.got() == ["a"]
    await end(line)
