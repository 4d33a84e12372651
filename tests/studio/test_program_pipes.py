"""A program in another worker is one more program of the hub, and what it moves stops when it is killed.

Module: servolink.studio.program_pipes.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from contextvars import ContextVar, copy_context
from functools import partial
from typing import Any

import pytest

import servolink
from servolink.control import ShareTransport
from servolink.studio.program_pipes import PortPipes
from servolink.support import listening_in_memory
from tests.studio.test_worker_door import Page, opened
from tests.support.page_pipes import CONNECT, HAS_SOCKETS, IS_SAME_USER, MakeProtocol, connect_in_memory

is_program = ContextVar("is_program", default=False)


@pytest.fixture(autouse=True)
def workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pipes in memory as in a page: what a program connects to is the end of its port."""

    async def connect(name: str, make_protocol: MakeProtocol) -> tuple[asyncio.Transport, str]:
        return connect_in_memory("program" if is_program.get() else name, make_protocol), ""

    monkeypatch.setattr(HAS_SOCKETS, False)
    monkeypatch.setattr(IS_SAME_USER, lambda _: True)
    monkeypatch.setattr(CONNECT, connect)
    monkeypatch.setattr("servolink.studio.worker_door.connect_locally", connect)
    monkeypatch.setattr(ShareTransport, "dead_man", 2.0)


@asynccontextmanager
async def joined(page: Page) -> AsyncIterator[PortPipes]:
    """Let this task be a program, whose messages take a turn of the loop; line 1 of the page is open."""
    page.open(1)
    await page.told[1].get()
    loop, outside = asyncio.get_running_loop(), copy_context()
    pipes = PortPipes(lambda *message: loop.call_soon(partial(page.door.hear, 1, *message), context=outside))
    page.door.join(1, lambda *message: loop.call_soon(pipes.hear, *message))
    token = is_program.set(True)
    try:
        with listening_in_memory("program", pipes.open):
            yield pipes
    finally:
        is_program.reset(token)


async def servo(page: Page, servo_id: int = 1) -> Any:
    """Return the state of a servo as the page reads it."""
    await asyncio.sleep(0.05)
    listed = await page.call(1, "servos.list")
    return next(row for row in listed["servos"] if row["servo_id"] == servo_id)


async def test_a_program_moves_the_robot_and_watches_it() -> None:
    async with (
        opened() as page,
        joined(page),
        servolink.connect("share://virtual") as board,
        board.watch(hz=50) as readings,
    ):
        await board.move({1: 40}, duration=0.3, wait=True)
        async for reading in readings:
            if reading.servos[0].angle == 40:
                break


async def test_a_killed_program_stops_what_it_moves() -> None:
    async with opened() as page, joined(page):
        board = await servolink.connect("share://virtual")
        await board.move({1: 90}, duration=5)
        page.door.take("program.end", 1, "")
        while (await servo(page))["is_start"]:
            pass
        assert (await servo(page))["angle"] < 80
        await board.close()


async def test_a_program_that_computes_for_ever_is_stopped_by_the_dead_man(monkeypatch: pytest.MonkeyPatch) -> None:
    async with opened() as page, joined(page) as pipes:
        board = await servolink.connect("share://virtual")
        await board.move({1: 90}, duration=20)
        monkeypatch.setattr(pipes, "post", lambda *message: None)  # its loop turns no more
        while (await servo(page))["is_start"]:
            pass
        assert (await servo(page))["angle"] < 80
        page.door.take("program.end", 1, "")
        await board.close()


async def test_a_movement_outlasts_a_program_that_ends() -> None:
    async with opened() as page, joined(page):
        async with servolink.connect("share://virtual") as board:
            await board.move({1: 90}, duration=1)
        while (now := await servo(page))["angle"] < 90:
            assert now["is_start"]


async def test_a_hostile_program_breaks_its_own_pipes_only() -> None:
    async with opened() as page:
        told: list[tuple[str, int, str]] = []
        page.door.join(1, lambda *message: told.append(message))
        for number in range(40):
            page.door.hear(1, "open", number, "")
        for text in ("\u4e00", "x" * 2_000_000, '{"servolink": 1}\n'):
            page.door.hear(1, "data", 3, text)
        page.door.hear(1, "read", 4, "many")
        page.door.hear(1, "data", 99, "to no pipe")
        page.door.hear(2, "data", 1, "of no program")
        while ("close", 3, "") not in told:
            await asyncio.sleep(0.01)
        page.open(1)
        assert (await page.told[1].get())[0] == "message"
        await page.call(1, "move", targets={"1": 10}, duration=0.1, wait=True)


async def test_bytes_wait_for_a_side_that_does_not_read() -> None:
    posted: list[tuple[str, int, str]] = []
    pipes = PortPipes(lambda *message: posted.append(message))
    with listening_in_memory("program", pipes.open):
        pipe = connect_in_memory("program", asyncio.Protocol)
        for _ in range(20):
            pipe.write(bytes(50_000))
            for _ in range(5):
                await asyncio.sleep(0)
        passed = sum(len(text) for kind, _, text in posted if kind == "data")
        assert passed < 300_000
        pipes.hear("read", 1, str(passed))
        for _ in range(5):
            await asyncio.sleep(0)
        assert sum(len(text) for kind, _, text in posted if kind == "data") == 1_000_000
        pipe.abort()
        await asyncio.sleep(0.01)
    assert posted[-1] == ("close", 1, "")
