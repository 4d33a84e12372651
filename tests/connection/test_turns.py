"""Turns: who may send next."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from random import Random
from typing import Any

import pytest

from servolink.connection.lanes import Lane
from servolink.connection.scheduler import RequestScheduler
from tests.client.fake_board import turns_of_the_loop
from tests.virtual_time import run

A, B, C, D = (Lane(number) for number in range(4))


class Waiting:
    """Tasks that wait for turns, and the order in which they got them."""

    def __init__(self, window: int = 1) -> None:
        self.turns = RequestScheduler(window)
        self.granted: list[str] = []
        self.tasks: dict[str, asyncio.Task[None]] = {}

    def ask(self, name: str, lane: Lane | None, *, alone: bool = False, first: bool = False) -> None:
        self.tasks[name] = asyncio.create_task(self._take(name, lane, alone=alone, first=first))

    async def got(self) -> list[str]:
        """Return who got a turn since the last call."""
        await turns_of_the_loop(4)
        granted, self.granted = self.granted, []
        return granted

    async def _take(self, name: str, lane: Lane | None, *, alone: bool, first: bool) -> None:
        await self.turns.take(lane, alone=alone, first=first)
        self.granted.append(name)


def test_one_after_another_in_the_order_they_came() -> None:
    async def main() -> None:
        waiting = Waiting()
        for name, lane in zip("abcd", (A, B, C, None), strict=True):
            waiting.ask(name, lane)
        assert await waiting.got() == ["a"]
        for lane, following in ((A, "b"), (B, "c"), (C, "d")):
            waiting.turns.give_back(lane)
            assert await waiting.got() == [following]

    run(main())


@pytest.mark.parametrize("window", [1, 2, 3])
def test_no_more_than_the_window_at_a_time(window: int) -> None:
    async def main() -> None:
        waiting = Waiting(window)
        for name, lane in zip("abcd", (A, B, C, D), strict=True):
            waiting.ask(name, lane)
        assert await waiting.got() == list("abcd")[:window]
        waiting.turns.give_back(A)
        assert await waiting.got() == ["abcd"[window]]
        await _cancel(waiting)

    run(main())


def test_one_on_each_lane_and_those_on_other_lanes_need_not_wait_for_it() -> None:
    async def main() -> None:
        waiting = Waiting(window=4)
        for name, lane in (("a1", A), ("a2", A), ("b", B), ("nothing awaited", None)):
            waiting.ask(name, lane)
        assert await waiting.got() == ["a1", "b", "nothing awaited"]
        waiting.turns.give_back(B)
        assert await waiting.got() == []
        waiting.turns.give_back(A)
        assert await waiting.got() == ["a2"]

    run(main())


def test_what_goes_alone_overlaps_nothing_and_is_not_starved_by_those_behind_it() -> None:
    async def main() -> None:
        waiting = Waiting(window=3)
        for name, lane in (("a", A), ("b", B)):
            waiting.ask(name, lane)
        waiting.ask("alone", C, alone=True)
        waiting.ask("behind", D)
        assert await waiting.got() == ["a", "b"]
        waiting.turns.give_back(A)
        assert await waiting.got() == []
        waiting.turns.give_back(B)
        assert await waiting.got() == ["alone"]
        waiting.ask("later", A)
        assert await waiting.got() == []
        waiting.turns.give_back(C)
        assert await waiting.got() == ["behind", "later"]

    run(main())


def test_what_goes_alone_starts_at_once_when_nothing_else_does() -> None:
    async def main() -> None:
        waiting = Waiting(window=2)
        waiting.ask("alone", A, alone=True)
        waiting.ask("b", B)
        assert await waiting.got() == ["alone"]
        waiting.turns.give_back(A)
        assert await waiting.got() == ["b"]

    run(main())


def test_first_goes_before_all_who_wait_even_before_what_goes_alone() -> None:
    async def main() -> None:
        waiting = Waiting()
        waiting.ask("a", A)
        waiting.ask("alone", B, alone=True)
        waiting.ask("c", C)
        await turns_of_the_loop(2)
        waiting.ask("first", D, first=True)
        assert await waiting.got() == ["a"]
        waiting.turns.give_back(A)
        assert await waiting.got() == ["first"]
        waiting.turns.give_back(D)
        assert await waiting.got() == ["alone"]
        await _cancel(waiting)

    run(main())


def test_who_is_cancelled_while_waiting_is_passed_over() -> None:
    async def main() -> None:
        waiting = Waiting()
        for name, lane in zip("abc", (A, B, C), strict=True):
            waiting.ask(name, lane)
        await turns_of_the_loop(2)
        waiting.tasks["b"].cancel()
        await turns_of_the_loop(2)
        waiting.turns.give_back(A)
        assert await waiting.got() == ["a", "c"]
        assert waiting.tasks["b"].cancelled()

    run(main())


def test_those_behind_what_goes_alone_go_on_at_once_when_it_is_cancelled() -> None:
    async def main() -> None:
        waiting = Waiting(window=2)
        waiting.ask("a", A)
        waiting.ask("alone", B, alone=True)
        waiting.ask("c", C)
        assert await waiting.got() == ["a"]
        waiting.tasks["alone"].cancel()
        assert await waiting.got() == ["c"]

    run(main())


def test_who_is_cancelled_while_granted_passes_the_turn_on() -> None:
    async def main() -> None:
        waiting = Waiting()
        for name, lane in zip("abc", (A, B, C), strict=True):
            waiting.ask(name, lane)
        assert await waiting.got() == ["a"]
        waiting.turns.give_back(A)  # b has the turn and does not know it yet
        waiting.tasks["b"].cancel()
        assert await waiting.got() == ["c"]
        assert waiting.tasks["b"].cancelled()
        waiting.ask("b again", B)
        waiting.turns.give_back(C)
        assert await waiting.got() == ["b again"]

    run(main())


def test_who_is_cancelled_before_the_grant_gets_no_turn() -> None:
    async def main() -> None:
        waiting = Waiting()
        for name, lane in zip("abc", (A, B, C), strict=True):
            waiting.ask(name, lane)
        assert await waiting.got() == ["a"]
        waiting.tasks["b"].cancel()
        waiting.turns.give_back(A)  # b stands first in the queue, about to leave
        assert await waiting.got() == ["c"]
        assert waiting.tasks["b"].cancelled()

    run(main())


def test_all_who_wait_are_refused_each_with_an_error_of_its_own() -> None:
    async def main() -> None:
        waiting = Waiting()
        for name, lane in zip("abc", (A, B, C), strict=True):
            waiting.ask(name, lane)
        assert await waiting.got() == ["a"]
        waiting.turns.refuse_all(lambda: ConnectionError("gone"))
        errors = await asyncio.gather(waiting.tasks["b"], waiting.tasks["c"], return_exceptions=True)
        assert [str(error) for error in errors] == ["gone", "gone"]
        assert errors[0] is not errors[1]

    run(main())


@pytest.mark.parametrize("cancelled_first", [True, False])
def test_cancellation_reaches_its_task_also_when_all_are_refused_in_the_same_moment(cancelled_first: bool) -> None:
    async def main() -> None:
        waiting = Waiting()
        for name, lane in zip("ab", (A, B), strict=True):
            waiting.ask(name, lane)
        assert await waiting.got() == ["a"]
        if cancelled_first:
            waiting.tasks["b"].cancel()
        waiting.turns.refuse_all(lambda: ConnectionError("gone"))
        waiting.tasks["b"].cancel()
        await asyncio.wait([waiting.tasks["b"]])
        assert waiting.tasks["b"].cancelled()

    run(main())


def test_the_first_lane_that_is_idle_is_borrowed_and_nobody_else_has_it_until_it_is_given_back() -> None:
    async def main() -> None:
        waiting = Waiting(window=3)
        waiting.ask("a", A)
        assert await waiting.got() == ["a"]
        assert waiting.turns.borrow([A, B, C]) is B
        assert waiting.turns.borrow([A, B]) is None
        waiting.ask("b", B)
        assert await waiting.got() == []
        waiting.turns.give_back_borrowed(B)
        assert await waiting.got() == ["b"]
        assert waiting.turns.borrow([A, B]) is None

    run(main())


@pytest.mark.parametrize("seed", range(20))
def test_in_any_mixture_with_cancels_the_rules_hold_and_nobody_is_forgotten(seed: int) -> None:
    random = Random(seed)
    window = random.choice((1, 2, 3))
    turns = RequestScheduler(window)
    active: list[tuple[Lane | None, bool]] = []
    done: list[int] = []

    async def use(number: int, lane: Lane | None, *, alone: bool, first: bool) -> None:
        await turns.take(lane, alone=alone, first=first)
        active.append((lane, alone))
        try:
            lanes = [lane for lane, _ in active if lane is not None]
            assert len(active) <= window
            assert len(set(lanes)) == len(lanes)
            assert len(active) == 1 or not any(alone for _, alone in active)
            await asyncio.sleep(random.choice((0, 0, 0.5, 1)))
        finally:
            active.remove((lane, alone))
            turns.give_back(lane)
        done.append(number)

    async def main() -> None:
        tasks = []
        for number in range(200):
            lane = random.choice((A, B, C, None))
            alone = random.random() < 0.05
            tasks.append(asyncio.create_task(use(number, lane, alone=alone, first=random.random() < 0.1)))
            await asyncio.sleep(random.choice((0, 0, 0.25)))
            if random.random() < 0.2:
                random.choice(tasks).cancel()
        outcomes = await asyncio.gather(*tasks, return_exceptions=True)
        cancelled = sum(isinstance(outcome, asyncio.CancelledError) for outcome in outcomes)
        assert len(done) + cancelled == 200
        assert not [outcome for outcome in outcomes if isinstance(outcome, AssertionError)]
        assert cancelled
        await _soon(turns.take(A, alone=True))

    run(main())


async def _soon(waiting: Coroutine[Any, Any, None]) -> None:
    task = asyncio.create_task(waiting)
    await turns_of_the_loop(3)
    assert task.done()


async def _cancel(waiting: Waiting) -> None:
    for task in waiting.tasks.values():
        task.cancel()
    await asyncio.wait(waiting.tasks.values())


def test_an_extra_turn_waits_for_nobody_and_keeps_others_waiting() -> None:
    async def main() -> None:
        waiting = Waiting()
        waiting.ask("a", A)
        assert await waiting.got() == ["a"]
        waiting.turns.take_extra()
        waiting.ask("b", B)
        waiting.turns.give_back(A)
        assert await waiting.got() == []
        waiting.turns.give_back(None)
        assert await waiting.got() == ["b"]

    run(main())


def test_an_extra_turn_that_ends_first_does_not_end_that_of_one_who_is_alone() -> None:
    async def main() -> None:
        waiting = Waiting(3)
        waiting.ask("alone", A, alone=True)
        assert await waiting.got() == ["alone"]
        waiting.turns.take_extra()
        waiting.turns.give_back(None)
        waiting.ask("b", B)
        assert await waiting.got() == []
        waiting.turns.give_back(A)
        assert await waiting.got() == ["b"]

    run(main())
