"""Strangers: who makes room, who is kept, and for how long.

Module: servolink.transports.listeners.strangers.
"""

from __future__ import annotations

import asyncio
from typing import Self

import pytest

from servolink.transports.listeners import strangers
from servolink.transports.listeners.strangers import Stranger, Strangers

_LIMIT = 10.0


class Doors:
    """Doors to which connections come."""

    def __init__(self, files: int, patch: pytest.MonkeyPatch) -> None:
        patch.setattr(strangers, "most_open_files", lambda: files)
        self.group = Strangers()
        self.came: list[Stranger] = []

    def _begin(self, stranger: Stranger) -> asyncio.Task[None]:
        self.came.append(stranger)
        return asyncio.ensure_future(asyncio.sleep(3600))

    async def comes(self, seconds: float | None = None) -> Stranger:
        await self.group.make_room()
        self.group.add(self._begin, seconds)
        return self.came[-1]

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        for each in self.came:
            each.task.cancel()
        await asyncio.wait([each.task for each in self.came])

    @property
    def open(self) -> list[int]:
        """Numbers of the connections that are open, in the order in which they came."""
        return [number for number, each in enumerate(self.came) if not each.task.done()]


@pytest.fixture
def doors(monkeypatch: pytest.MonkeyPatch) -> Doors:
    return Doors(64, monkeypatch)


async def test_the_oldest_strangers_make_room_and_their_tasks_have_ended_before(doors: Doors) -> None:
    async with doors:
        for number in range(40):
            await doors.comes()
            assert doors.open == list(range(max(0, number - 15), number + 1))


async def test_an_admitted_connection_is_kept_and_has_no_limit(doors: Doors) -> None:
    async with doors:
        first = await doors.comes(_LIMIT)
        assert first.admit("token", 8)
        for _ in range(20):
            await doors.comes()
        await asyncio.sleep(2 * _LIMIT)
        assert not first.task.done()


async def test_a_limit_ends_a_stranger_and_begins_anew_with_a_request(doors: Doors) -> None:
    async with doors:
        silent, busy, raw = await doors.comes(_LIMIT), await doors.comes(_LIMIT), await doors.comes()
        await asyncio.sleep(_LIMIT - 1)
        busy.allow(_LIMIT)
        await asyncio.sleep(2)
        assert (silent.task.done(), busy.task.done()) == (True, False)
        await asyncio.sleep(_LIMIT)
        assert (busy.task.done(), raw.task.done()) == (True, False)


async def test_those_who_show_the_same_are_few_and_leave_room_for_others(doors: Doors) -> None:
    async with doors:
        link = [await doors.comes() for _ in range(4)]
        assert [each.admit("link", 9, files=3) for each in link] == [True, True, True, False]
        assert link[0].admit("link", 9, files=3)  # again
        assert (await doors.comes()).admit("other", 9)
        link[0].task.cancel()
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert link[3].admit("link", 9, files=3)


async def test_all_who_are_admitted_leave_files_for_the_hub(doors: Doors) -> None:
    async with doors:
        admitted = [(await doors.comes()).admit(number, 24) for number in range(40)]
        assert sum(admitted) == 64 * 5 // 8 - 16
        assert (await doors.comes()).admit("a local program")


async def test_a_connection_that_was_dropped_is_not_admitted(doors: Doors) -> None:
    async with doors:
        stranger = await doors.comes()
        stranger.drop()
        assert not stranger.admit("token")


async def test_doors_of_one_event_loop_share_their_strangers() -> None:
    assert strangers.strangers_of_network() is strangers.strangers_of_network()
