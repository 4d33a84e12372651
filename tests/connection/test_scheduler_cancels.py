"""RequestScheduler: callers that are cancelled, and permits beside the queue."""

from __future__ import annotations

import asyncio

import pytest

from tests.client.piped_board import turns_of_the_loop
from tests.connection.permits import ALONE, A, B, C, D, Line

# --- cancels ------------------------------------------------------------------------------------------------------


async def test_who_is_cancelled_while_waiting_is_passed_over() -> None:
    line = Line()
    for name, packet in zip("abc", (A, B, C), strict=True):
        line.ask(name, packet)
    await turns_of_the_loop(2)
    line.tasks["b"].cancel()
    await turns_of_the_loop(2)
    line.answer("a")
    assert await line.got() == ["a", "c"]
    assert line.tasks["b"].cancelled()


async def test_those_behind_what_goes_alone_go_on_at_once_when_it_is_cancelled() -> None:
    line = Line(depth=2)
    line.ask("a", A)
    line.ask("alone", ALONE)
    line.ask("c", C)
    assert await line.got() == ["a"]
    line.tasks["alone"].cancel()
    assert await line.got() == ["c"]


async def test_who_is_cancelled_while_granted_passes_the_permit_on() -> None:
    line = Line()
    for name, packet in zip("abc", (A, B, C), strict=True):
        line.ask(name, packet)
    assert await line.got() == ["a"]
    line.answer("a")  # b has the permit and does not know it yet
    line.tasks["b"].cancel()
    assert await line.got() == ["c"]
    assert line.tasks["b"].cancelled()
    line.ask("b again", B)
    line.answer("c")
    assert await line.got() == ["b again"]


async def test_who_is_cancelled_before_the_grant_gets_no_permit() -> None:
    line = Line()
    for name, packet in zip("abc", (A, B, C), strict=True):
        line.ask(name, packet)
    assert await line.got() == ["a"]
    line.tasks["b"].cancel()
    line.answer("a")  # b stands first in the queue, about to leave
    assert await line.got() == ["c"]
    assert line.tasks["b"].cancelled()


async def test_all_who_wait_are_refused_each_with_an_error_of_its_own() -> None:
    line = Line()
    for name, packet in zip("abcd", (A, B, C, D), strict=True):
        line.ask(name, packet)
    assert await line.got() == ["a"]
    line.tasks["d"].cancel()
    line.scheduler.refuse_all(lambda: ConnectionError("gone"))
    errors = await asyncio.gather(line.tasks["b"], line.tasks["c"], return_exceptions=True)
    assert [str(error) for error in errors] == ["gone", "gone"]
    assert errors[0] is not errors[1]
    assert line.tasks["d"].cancelled()


@pytest.mark.parametrize("cancelled_first", [True, False])
async def test_cancellation_reaches_its_task_when_all_are_refused_at_once(
    cancelled_first: bool,
) -> None:
    line = Line()
    for name, packet in zip("ab", (A, B), strict=True):
        line.ask(name, packet)
    assert await line.got() == ["a"]
    if cancelled_first:
        line.tasks["b"].cancel()
    line.scheduler.refuse_all(lambda: ConnectionError("gone"))
    line.tasks["b"].cancel()
    await asyncio.wait([line.tasks["b"]])
    assert line.tasks["b"].cancelled()


async def test_who_is_cancelled_wants_no_more_depth() -> None:
    line = Line()
    for name, packet in zip("ab", (A, B), strict=True):
        line.ask(name, packet)
    assert await line.got() == ["a"]
    assert line.scheduler.load().has_backlog
    line.tasks["b"].cancel()
    assert line.scheduler.waiting  # b is about to leave
    assert not line.scheduler.load().has_backlog


# --- extra permits ------------------------------------------------------------------------------------------------


async def test_an_extra_permit_waits_for_nobody_and_keeps_others_waiting() -> None:
    line = Line()
    line.ask("a", A)
    assert await line.got() == ["a"]
    line.scheduler.take_extra()
    line.ask("b", B)
    line.answer("a")
    assert await line.got() == []
    line.scheduler.give_back_extra()
    assert await line.got() == ["b"]
