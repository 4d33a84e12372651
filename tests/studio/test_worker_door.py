"""The studio behind a port of a worker: a page moves the virtual robot, leaves, and comes back.

Module: servolink.studio.worker_door.
"""

from __future__ import annotations

import asyncio
import json
from collections import defaultdict
from collections.abc import AsyncIterator, Coroutine
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
from servolink.virtual import VirtualBoard, VirtualTransport


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

    def open(self, number: int, kind: str = "open") -> None:
        self.door.take(kind, number, json.dumps({"token": "", "who": "Tablet"}))

    async def call(self, number: int, method: str, **params: Any) -> Any:
        """Return the result of a call, or its error."""
        request = {"jsonrpc": "2.0", "id": method, "method": method, "params": params}
        self.door.take("message", number, json.dumps(request))
        while True:
            _, message = await self.told[number].get()
            if message.get("id") == method:
                return message["result"] if "result" in message else message["error"]

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


async def test_another_tab_watches_and_stops_but_does_not_move() -> None:
    async with opened() as page:
        page.open(1)
        page.open(2, "watch")
        assert (await page.told[2].get())[1]["role"] == "watch"
        await page.call(1, "move", targets={"1": 30}, duration=30)
        for method in ("move", "studio.use", "lease.take"):
            assert "watch" in (await page.call(2, method))["message"], method
        await page.call(2, "servos.watch", hz=10)
        await page.angle(2, servo_id=1)
        await page.call(2, "stop")
        assert not any(servo["is_start"] for servo in (await page.call(1, "servos.list"))["servos"])


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


class RobotAtPort(Page):
    """A page with a robot at its port, which writes stop frames by itself."""

    DELAY = 0.05  # seconds until a response is here

    def __init__(self) -> None:
        super().__init__()
        self.line = VirtualTransport(VirtualBoard(4), "virtual://")
        self.number = self.epoch = self.sent = 0
        self.stop_frame = b""
        self.tasks = set[asyncio.Future[None]]()

    def post(self, kind: str, number: int, text: str) -> None:
        data = text.encode("latin-1", "ignore")
        match kind:
            case "port.open":
                self.number = number
                self._begin(self._open())
            case "port.stop":
                self.stop_frame = data
            case "port.frame":
                head, _, frame = data.partition(b" ")
                self.sent += len(frame)
                self.door.take("port.sent", number, str(self.sent))
                if not head.endswith(b"!") or int(head[:-1]) >= self.epoch:
                    self._begin(self.line.send(frame))
            case "port.close":
                self.door.take("port.closed", number, "")
            case _:
                super().post(kind, number, text)

    async def press_stop(self) -> None:
        """Write the stop frame, and tell the worker, which is busy meanwhile."""
        self.epoch += 1
        await self.line.send(self.stop_frame)
        self.door.take("port.stopped", self.number, str(self.epoch))

    def data(self, chunk: bytes, /) -> None:
        text = chunk.decode("latin-1")
        asyncio.get_running_loop().call_later(RobotAtPort.DELAY, self.door.take, "port.data", self.number, text)

    def lost(self, error: Exception | None, /) -> None:
        pass

    async def _open(self) -> None:
        await self.line.open(self)
        self.door.take("port.opened", self.number, "0")

    def _begin(self, doing: Coroutine[Any, Any, None]) -> None:
        self.tasks.add(task := asyncio.ensure_future(doing))
        task.add_done_callback(self.tasks.discard)


@pytest.mark.parametrize("pause", [0.0, 0.02, 0.06, 0.11])
@pytest.mark.parametrize("count", [1, 2, 5])
async def test_each_of_several_stops_of_the_page_is_followed_at_once(count: int, pause: float) -> None:
    page = RobotAtPort()
    page.door = WorkerDoor(page.post)
    now = asyncio.get_running_loop().time
    try:
        await page.door.begin("webserial://1a86:7523")
        page.open(1)
        await page.told[1].get()
        await page.call(1, "move", targets={"1": 90}, duration=5)
        for _ in range(count):
            await page.press_stop()
            await asyncio.sleep(pause)
        pressed = now()
        await page.call(1, "stop")
        assert now() - pressed < 10 * page.DELAY  # bytes wait a second for a stop that does not come
        assert page.door._ports.stops_behind == 0
        assert not any(servo["is_start"] for servo in (await page.call(1, "servos.list"))["servos"])
        await page.call(1, "servo.set", servo="all", start=True, hold=True)
        await page.call(1, "move", targets={"1": 30}, duration=0.2, wait=True)  # frames carry the new epoch
    finally:
        await page.door.close()
        await page.line.close()


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
