"""Tasks that wait for permits, and the order in which they get them."""

from __future__ import annotations

import asyncio
from typing import Any

from servolink.connection.call import Call, Slot
from servolink.connection.scheduler import RequestScheduler, Window
from servolink.connection.slots import Slots
from servolink.protocol import (
    ClearAllDataRequest,
    Command,
    QueryActionListRequest,
    QueryMemorySizeRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    Request,
    SendDummyDataRequest,
)
from tests.client.piped_board import turns_of_the_loop

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
        await self.scheduler.acquire(Call(packet, 1.0, 0.0), first=first)
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
