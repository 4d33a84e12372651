"""RequestScheduler: the work for a request, and the rules in any mixture."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest

from servolink.connection.call import Call, Slot
from servolink.connection.scheduler import RequestScheduler, Window
from servolink.connection.slots import Obstacle, Slots
from servolink.protocol import (
    PACKETS,
    AddActionRequest,
    Command,
    Query,
    QueryActionRequest,
    Request,
    SendDummyDataRequest,
)
from tests.client.piped_board import PipedBoard, connected, turns_of_the_loop
from tests.connection.permits import ALONE, UNANSWERED, A, B, C, D, Line, close
from tests.tables import over
from tests.virtual_time import run

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
        board = PipedBoard()
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
    exclusive = looks_per_request(1, depth, monkeypatch)
    among_many = looks_per_request(3_000 if depth == 1 else 1_000, depth, monkeypatch)
    assert among_many <= exclusive + 3


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


@over("seed", range(20))
async def test_in_any_mixture_with_cancels_the_rules_hold_and_nobody_is_forgotten(seed: int) -> None:
    random = Random(seed)
    depth = random.choice((1, 2, 3))
    slots = Slots()
    scheduler = RequestScheduler(Window(depth, depth, learn=False), slots)
    active: list[Request[Any] | Command] = []
    done: list[int] = []

    async def use(number: int, packet: Request[Any] | Command, *, first: bool) -> None:
        await scheduler.acquire(Call(packet, 1.0, 0.0), first=first)
        slot = None
        active.append(packet)
        try:
            if isinstance(packet, Request):
                slot = Slot(packet, slots.lanes[packet.packet_id + 1], None)
                slots.open(slot)
                scheduler.sent(packet)
            assert len(active) <= depth
            assert len(active) == 1 or not any(each.exclusive for each in active)
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


def test_no_packet_goes_alone_by_mistake() -> None:
    """The order of these decides what they do."""
    assert {declared.__name__ for declared in PACKETS.values() if declared.exclusive} == {
        "TransmissionModeSettingRequest",
        "ClearAllDataRequest",
        "SetServoParameterRequest",
        "SetAngleUnitRequest",
        "ExecuteMacroRequest",
    }


async def test_one_that_gets_its_permit_at_once_does_not_overtake_one_that_wakes_up() -> None:
    line, order = Line(depth=2), list[str]()

    async def send(name: str, packet: Request[Any]) -> None:
        await line.scheduler.acquire(Call(packet, 1.0, 0.0))
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
