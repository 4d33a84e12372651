"""The studio behind a port of a worker: a page moves the virtual robot, leaves, and comes back.

Module: servolink.studio.worker_door.
"""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, get_args

import pytest

from servolink.protocol import (
    ALL_SERVOS,
    ByteOrder,
    Codec,
    ExecuteActionRequest,
    QueryServoListRequest,
    SetServoParameterRequest,
    Step,
)
from servolink.studio.worker_door import BoardFrames, WorkerDoor


class Page:
    """A page: what it was told on each of its lines."""

    def __init__(self) -> None:
        self.told: dict[int, asyncio.Queue[tuple[str, Any]]] = defaultdict(asyncio.Queue)
        self.refused: list[str] = []
        self.door: WorkerDoor

    def post(self, kind: str, number: int, text: str) -> None:
        if kind == "refused":
            self.refused.append(text)
        elif kind == "port.open":
            self.door.take("port.failed", number, "absent")
        elif not kind.startswith("port."):
            self.told[number].put_nowait((kind, json.loads(text)))

    def open(self, number: int) -> None:
        self.door.take("open", number, json.dumps({"token": "", "who": "Tablet"}))

    async def call(self, number: int, method: str, **params: Any) -> Any:
        request = {"jsonrpc": "2.0", "id": method, "method": method, "params": params}
        self.door.take("message", number, json.dumps(request))
        while True:
            _, message = await self.told[number].get()
            if message.get("id") == method:
                return message["result"]

    async def angle(self, number: int, servo_id: int) -> float:
        """Return the next angle of a servo on a line that watches."""
        while (message := (await self.told[number].get())[1]).get("method") != "servos":
            pass
        return next(float(row["angle"]) for row in message["params"]["servos"] if row["servo_id"] == servo_id)


@asynccontextmanager
async def opened(address: str = "") -> AsyncIterator[Page]:
    page = Page()
    page.door = WorkerDoor(page.post)
    try:
        await page.door.begin(address)
        yield page
    finally:
        await page.door.close()


async def test_a_page_moves_the_virtual_robot() -> None:
    async with opened() as page:
        page.open(1)
        kind, welcome = await page.told[1].get()
        assert (kind, welcome["is_virtual"], welcome["role"], welcome["has_fleet"]) == ("message", True, "edit", False)
        await page.call(1, "move", targets={"1": 30}, duration=0.2, wait=True)
        await page.call(1, "servos.watch", hz=10)
        assert await page.angle(1, servo_id=1) == pytest.approx(30, abs=1)


async def test_a_page_that_leaves_is_told_so_and_may_come_back() -> None:
    async with opened() as page:
        page.open(1)
        await page.told[1].get()
        page.door.take("close", 1, "")
        while (said := await page.told[1].get())[0] != "close":
            pass
        assert said[1] == {"code": 1000, "reason": ""}
        page.door.take("message", 1, "{}")  # too late, and no error
        page.open(2)
        assert (await page.told[2].get())[0] == "message"


async def test_a_page_goes_on_to_another_board_in_a_new_line() -> None:
    async with opened() as page:
        page.open(1)
        await page.told[1].get()
        request = {"jsonrpc": "2.0", "method": "studio.use", "params": {"url": "virtual://?servos=4"}}
        page.door.take("message", 1, json.dumps(request))
        while (said := await page.told[1].get())[0] != "close":
            pass
        assert said[1]["code"] == 4410
        page.open(2)
        assert (await page.told[2].get())[1]["url"] == "virtual://?servos=4"


async def test_a_greeting_that_is_none_is_refused() -> None:
    async with opened() as page:
        page.door.take("open", 1, '{"token": 7}')
        kind, said = await page.told[1].get()
        assert (kind, said["code"]) == ("close", 4400)


async def test_a_board_that_cannot_be_opened_is_told_and_replaced_by_a_virtual_robot() -> None:
    async with opened("webserial://1a86:7523") as page:
        page.door.take("open", 1, json.dumps({"token": ""}))
        assert (await page.told[1].get())[1]["is_virtual"]
        assert page.refused[0].startswith("webserial://1a86:7523: the browser has no such port for this page")


def test_frames_that_may_move_are_known_in_both_byte_orders() -> None:
    frames = BoardFrames()
    for order in get_args(ByteOrder):
        codec = Codec(order)
        stop = codec.encode(SetServoParameterRequest(ALL_SERVOS, 0, 1))
        assert frames.stop_for(codec.encode(QueryServoListRequest())) == stop
        assert frames.may_move(codec.encode(ExecuteActionRequest((Step(1, 60, 100),))))
        assert frames.may_move(codec.encode(SetServoParameterRequest(1, 1, 1)))
        assert not frames.may_move(codec.encode(QueryServoListRequest()))
        assert not frames.may_move(stop)
    assert frames.may_move(b"half a frame")
