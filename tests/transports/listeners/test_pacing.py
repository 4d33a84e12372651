"""Messages of many connections with one token: how much is handled, and what passes at once.

Module: servolink.transports.listeners.pacing.
"""

from __future__ import annotations

import asyncio

import pytest

from servolink.transports.listeners.pacing import Pace

_PAGES = 64


async def _flood(pace: Pace, size: int, handled: list[int]) -> None:
    while True:
        await pace.keep(size)
        handled.append(size)


@pytest.mark.parametrize(("size", "most"), [(0, 3000), (1 << 20, 5)])
async def test_a_flood_on_many_connections_is_handled_slowly(size: int, most: int) -> None:
    turn, handled = asyncio.Lock(), list[int]()
    floods = [asyncio.ensure_future(_flood(Pace(turn), size, handled)) for _ in range(_PAGES)]
    await asyncio.sleep(1)
    handled.clear()
    await asyncio.sleep(1)
    for flood in floods:
        flood.cancel()
    await asyncio.wait(floods)
    assert 0 < len(handled) <= most


@pytest.mark.parametrize("size", [0, 1 << 20])
async def test_a_quiet_connection_and_a_stop_wait_for_no_flood(size: int) -> None:
    turn, now = asyncio.Lock(), asyncio.get_running_loop().time
    quiet, busy = Pace(turn), Pace(turn)
    floods = [asyncio.ensure_future(_flood(Pace(turn), size, [])) for _ in range(_PAGES)]
    await asyncio.sleep(1)
    for _ in range(10):  # as a page that moves the robot
        at = now()
        await quiet.keep(100)
        assert now() == at
        await asyncio.sleep(0.1)
    while busy._credit > 0.002:
        await busy.keep(100)
    at = now()
    await busy.keep(40, is_stop=True)
    assert now() == at
    for flood in floods:
        flood.cancel()
    await asyncio.wait(floods)


async def test_a_flood_of_stops_waits_as_well() -> None:
    pace, now = Pace(asyncio.Lock()), asyncio.get_running_loop().time
    at = now()
    for _ in range(1000):
        await pace.keep(40, is_stop=True)
    assert now() - at > 0.5


async def test_one_large_message_alone_is_handled_soon() -> None:
    at = asyncio.get_running_loop().time()
    await Pace(asyncio.Lock()).keep(1 << 20)
    assert asyncio.get_running_loop().time() - at < 0.3
