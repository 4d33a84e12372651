"""RequestScheduler: who may send next."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest

from servolink.connection.call import Slot
from servolink.connection.scheduler import RequestScheduler
from servolink.connection.slots import Obstacle, Slots
from servolink.connection.window import Window
from servolink.protocol.codec import PACKETS
from servolink.protocol.editing import (
    AddActionRequest,
    QueryActionListRequest,
    QueryActionRequest,
    QueryProjectIDRequest,
)
from servolink.protocol.packet import Command, Query, Request
from servolink.protocol.servos import QueryServoListRequest
from servolink.protocol.settings import ClearAllDataRequest, QueryMemorySizeRequest, SendDummyDataRequest
from tests.client.fake_board import FakeBoard, connected, turns_of_the_loop
from tests.virtual_time import run

A, B, C, D = QueryServoListRequest(), QueryMemorySizeRequest(), QueryProjectIDRequest(), QueryActionListRequest()
ALONE = ClearAllDataRequest()
UNANSWERED = SendDummyDataRequest(b"x")


def close(slots: Slots, slot: Slot) -> None:
    """End a slot, whichever of its lane it is."""
    slot.lane.slots.remove(slot)
    slot.lane.slots.appendleft(slot)
    slots._close(slot)


class Line:
    """Tasks that wait for permits, the order in which they got them, and the slots of those that did."""

    def __init__(self, depth: int = 1) -> None:
        self.slots = Slots()
        self.scheduler = RequestScheduler(Window(depth, depth, learn=False), self.slots)
        self.granted: list[str] = []
        self.tasks: dict[str, asyncio.Task[None]] = {}
        self._open: dict[str, Slot] = {}
        self._packets: dict[str, Request[Any] | Command] = {}

    def ask(self, name: str, packet: Request[Any] | Command, *, first: bool = False) -> None:
        self.tasks[name] = asyncio.create_task(self._send(name, packet, first=first))

    async def got(self) -> list[str]:
        """Return who got a permit since the last call."""
        await turns_of_the_loop(4)
        for task in self.tasks.values():
            if task.done() and not task.cancelled():
                task.result()
        granted, self.granted = self.granted, []
        return granted

    def answer(self, name: str) -> None:
        """End the request of this name."""
        slot = self._open.pop(name, None)
        if slot is not None:
            close(self.slots, slot)
        self.scheduler.release(self._packets.pop(name))

    async def _send(self, name: str, packet: Request[Any] | Command, *, first: bool) -> None:
        await self.scheduler.acquire(packet, first=first)
        self.granted.append(name)
        self._packets[name] = packet
        if isinstance(packet, Request):
            self._open[name] = Slot(packet, self.slots.lanes[packet.packet_id + 1], None)
            self.slots.open(self._open[name])
        self.scheduler.sent(packet)


async def end(line: Line) -> None:
    for task in line.tasks.values():
        task.cancel()
    await asyncio.wait(line.tasks.values())


# --- order --------------------------------------------------------------------------------------------------------


def test_one_after_another_in_the_order_they_came() -> None:
    async def main() -> None:
        line = Line()
        for name, packet in zip("abc", (A, B, C), strict=True):
            line.ask(name, packet)
        line.ask("d", UNANSWERED)
        assert await line.got() == ["a"]
        for name, following in ("ab", "bc", "cd"):
            line.answer(name)
            assert await line.got() == [following]

    run(main())


@pytest.mark.parametrize("depth", [1, 2, 3])
def test_no_more_than_the_depth_at_a_time(depth: int) -> None:
    async def main() -> None:
        line = Line(depth)
        for name, packet in zip("abcd", (A, B, C, D), strict=True):
            line.ask(name, packet)
        assert await line.got() == list("abcd")[:depth]
        line.answer("a")
        assert await line.got() == ["abcd"[depth]]
        await end(line)

    run(main())


@pytest.mark.parametrize("depth", [2, 3])
def test_a_response_that_is_kept_makes_room_for_one_more(depth: int) -> None:
    """The board is done with a request whose response is kept."""

    async def main() -> None:
        line = Line(depth)
        line.slots.kept = 1
        for name, packet in zip("abcd", (A, B, C, D), strict=True):
            line.ask(name, packet)
        assert await line.got() == list("abcd")[: depth + 1]
        await end(line)

    run(main())


def test_nobody_overtakes_one_who_has_to_wait() -> None:
    async def main() -> None:
        line = Line(depth=4)
        for name, packet in (("a", AddActionRequest(1)), ("a again", AddActionRequest(1)), ("b", B)):
            line.ask(name, packet)
        assert await line.got() == ["a"]
        line.answer("a")
        assert await line.got() == ["a again", "b"]

    run(main())


def test_equal_queries_go_together_and_different_ones_of_a_kind_too_if_their_responses_tell_them_apart() -> None:
    async def main() -> None:
        line = Line(depth=4)
        for name, packet in (("a", A), ("equal", A), ("one", QueryActionRequest(1)), ("two", QueryActionRequest(2))):
            line.ask(name, packet)
        assert await line.got() == ["a", "equal", "one", "two"]

    run(main())


def test_what_goes_alone_overlaps_nothing_and_is_not_starved_by_those_behind_it() -> None:
    async def main() -> None:
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

    run(main())


def test_what_has_a_permit_and_is_not_sent_yet_counts_too() -> None:
    async def main() -> None:
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

    run(main())


def test_a_permit_is_taken_at_once_only_if_nothing_at_all_stands_in_the_way() -> None:
    async def main() -> None:
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

    run(main())


def test_first_goes_before_all_who_wait_even_before_what_goes_alone() -> None:
    async def main() -> None:
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

    run(main())


def test_during_an_opening_nobody_gets_a_permit() -> None:
    async def main() -> None:
        line = Line()
        line.scheduler.pause()
        for name, packet in zip("ab", (A, B), strict=True):
            line.ask(name, packet)
        assert await line.got() == []
        line.scheduler.resume()
        assert await line.got() == ["a"]
        await end(line)

    run(main())


# --- cancels ------------------------------------------------------------------------------------------------------


def test_who_is_cancelled_while_waiting_is_passed_over() -> None:
    async def main() -> None:
        line = Line()
        for name, packet in zip("abc", (A, B, C), strict=True):
            line.ask(name, packet)
        await turns_of_the_loop(2)
        line.tasks["b"].cancel()
        await turns_of_the_loop(2)
        line.answer("a")
        assert await line.got() == ["a", "c"]
        assert line.tasks["b"].cancelled()

    run(main())


def test_those_behind_what_goes_alone_go_on_at_once_when_it_is_cancelled() -> None:
    async def main() -> None:
        line = Line(depth=2)
        line.ask("a", A)
        line.ask("alone", ALONE)
        line.ask("c", C)
        assert await line.got() == ["a"]
        line.tasks["alone"].cancel()
        assert await line.got() == ["c"]

    run(main())


def test_who_is_cancelled_while_granted_passes_the_permit_on() -> None:
    async def main() -> None:
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

    run(main())


def test_who_is_cancelled_before_the_grant_gets_no_permit() -> None:
    async def main() -> None:
        line = Line()
        for name, packet in zip("abc", (A, B, C), strict=True):
            line.ask(name, packet)
        assert await line.got() == ["a"]
        line.tasks["b"].cancel()
        line.answer("a")  # b stands first in the queue, about to leave
        assert await line.got() == ["c"]
        assert line.tasks["b"].cancelled()

    run(main())


def test_all_who_wait_are_refused_each_with_an_error_of_its_own() -> None:
    async def main() -> None:
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

    run(main())


@pytest.mark.parametrize("cancelled_first", [True, False])
def test_cancellation_reaches_its_task_also_when_all_are_refused_in_the_same_moment(cancelled_first: bool) -> None:
    async def main() -> None:
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

    run(main())


def test_who_is_cancelled_wants_no_more_depth() -> None:
    async def main() -> None:
        line = Line()
        for name, packet in zip("ab", (A, B), strict=True):
            line.ask(name, packet)
        assert await line.got() == ["a"]
        assert line.scheduler.load().wants_more
        line.tasks["b"].cancel()
        assert line.scheduler.waiting  # b is about to leave
        assert not line.scheduler.load().wants_more

    run(main())


# --- extra permits ------------------------------------------------------------------------------------------------


def test_an_extra_permit_waits_for_nobody_and_keeps_others_waiting() -> None:
    async def main() -> None:
        line = Line()
        line.ask("a", A)
        assert await line.got() == ["a"]
        line.scheduler.take_extra()
        line.ask("b", B)
        line.answer("a")
        assert await line.got() == []
        line.scheduler.give_back_extra()
        assert await line.got() == ["b"]

    run(main())


# --- work ---------------------------------------------------------------------------------------------------------


Granted = Sequence[Request[Any] | Command]


def looks_per_request(waiters: int, depth: int, monkeypatch: pytest.MonkeyPatch) -> float:
    """Return how often a request is compared with others, with so many waiting at once."""
    looks = 0
    judge = Slots.obstacle

    def counting(self: Slots, packet: Request[Any] | Command, granted: Granted = ()) -> Obstacle:
        nonlocal looks
        looks += 1
        return judge(self, packet, granted)

    async def main() -> None:
        board = FakeBoard()
        async with connected(board, depth=depth) as connection:
            await asyncio.gather(*(connection.request((A, B, C, D)[number % 4]) for number in range(waiters)))

    with monkeypatch.context() as patch:
        patch.setattr(Slots, "obstacle", counting)
        run(main())
    return looks / waiters


@pytest.mark.parametrize("depth", [1, 8])
def test_the_work_for_one_request_does_not_grow_with_the_number_of_those_who_wait(
    depth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = looks_per_request(1, depth, monkeypatch)
    among_many = looks_per_request(10_000 if depth == 1 else 1_000, depth, monkeypatch)
    assert among_many <= alone + 3


def test_a_thousand_who_are_cancelled_together_cost_a_look_each(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = 0
    judge = Slots.obstacle

    def counting(self: Slots, packet: Request[Any] | Command, granted: Granted = ()) -> Obstacle:
        nonlocal looks
        looks += 1
        return judge(self, packet, granted)

    monkeypatch.setattr(Slots, "obstacle", counting)

    async def main() -> None:
        line = Line()
        for number in range(1000):
            line.ask(str(number), A)
        assert await line.got() == ["0"]
        for number in range(1, 1000):
            line.tasks[str(number)].cancel()
        await turns_of_the_loop(3)
        assert not line.scheduler.waiting

    run(main())
    assert looks <= 3000


# --- any mixture --------------------------------------------------------------------------------------------------


REQUESTS: list[Request[Any] | Command] = [
    A,
    B,
    AddActionRequest(1),
    AddActionRequest(2),
    ALONE,
    UNANSWERED,
    SendDummyDataRequest(b"y"),
]


@pytest.mark.parametrize("seed", range(20))
def test_in_any_mixture_with_cancels_the_rules_hold_and_nobody_is_forgotten(seed: int) -> None:
    random = Random(seed)
    depth = random.choice((1, 2, 3))
    slots = Slots()
    scheduler = RequestScheduler(Window(depth, depth, learn=False), slots)
    active: list[Request[Any] | Command] = []
    done: list[int] = []

    async def use(number: int, packet: Request[Any] | Command, *, first: bool) -> None:
        await scheduler.acquire(packet, first=first)
        slot = None
        active.append(packet)
        try:
            if isinstance(packet, Request):
                slot = Slot(packet, slots.lanes[packet.packet_id + 1], None)
                slots.open(slot)
                scheduler.sent(packet)
            assert len(active) <= depth
            assert len(active) == 1 or not any(each.alone for each in active)
            changes = [each for each in active if not isinstance(each, (Query, Command))]
            assert len(set(changes)) == len(changes)
            await asyncio.sleep(random.choice((0, 0, 0.5, 1)))
        finally:
            active.remove(packet)
            if slot is None:
                scheduler.sent(packet)
            else:
                close(slots, slot)
            scheduler.release(packet)
        done.append(number)

    async def main() -> None:
        tasks = []
        for number in range(200):
            packet = random.choice(REQUESTS)
            tasks.append(asyncio.create_task(use(number, packet, first=random.random() < 0.1)))
            await asyncio.sleep(random.choice((0, 0, 0.25)))
            if random.random() < 0.2:
                random.choice(tasks).cancel()
        outcomes = await asyncio.gather(*tasks, return_exceptions=True)
        cancelled = sum(isinstance(outcome, asyncio.CancelledError) for outcome in outcomes)
        assert not [outcome for outcome in outcomes if isinstance(outcome, AssertionError)]
        assert len(done) + cancelled == 200
        assert cancelled
        assert scheduler.acquire_at_once(ALONE)

    run(main())


def test_no_packet_goes_alone_by_mistake() -> None:
    """The order of these decides what they do."""
    assert {declared.__name__ for declared in PACKETS.values() if declared.alone} == {
        "TransmissionModeSettingRequest",
        "ClearAllDataRequest",
        "SetServoParameterRequest",
        "SetAngleUnitRequest",
        "ExecuteMacroRequest",
    }


def test_one_that_gets_its_permit_at_once_does_not_overtake_one_that_wakes_up() -> None:
    async def main() -> None:
        line, order = Line(depth=2), list[str]()

        async def send(name: str, packet: Request[Any]) -> None:
            await line.scheduler.acquire(packet)
            order.append(name)
            line.scheduler.sent(packet)

        line.ask("first", QueryActionRequest(1))
        line.ask("change", ALONE)  # waits alone until `first` is over
        await line.got()
        waking = asyncio.create_task(send("waking", A))
        await turns_of_the_loop(2)
        line.answer("first")
        await line.got()
        line.answer("change")  # grants `waking` its permit, with which it wakes up a turn later
        await send("at once", B)
        await waking
        assert order == ["waking", "at once"]

    run(main())
