"""A list of slots under names, and what becomes of them."""

from __future__ import annotations

from typing import Any

from servolink.connection.call import Content, Slot
from servolink.connection.slots import Slots
from servolink.errors import DecodeError
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    AddActionResponse,
    QueryActionRequest,
    QueryActionResponse,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoRequest,
    QueryServoResponse,
    Request,
    Response,
    ServoState,
    SetServoParameterRequest,
)

TELEMETRY = QueryServoRequest(ALL_SERVOS)
PROJECT, POWER = QueryProjectIDRequest(), QueryRemainPowerRequest()
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
DONE, FAILED = AddActionResponse(1), AddActionResponse(0)
NONE = QueryActionResponse(0)
UNREADABLE = DecodeError("the count does not fit the length")


def ask(key: int) -> QueryActionRequest:
    return QueryActionRequest(key)


def said(key: int, caption: str = "") -> QueryActionResponse:
    return QueryActionResponse(key, caption)


def add(key: int) -> AddActionRequest:
    return AddActionRequest(key)


def angles(number: int) -> QueryServoResponse:
    return QueryServoResponse(tuple(ServoState(servo_id, number, 0, 0, 0, 0, 1) for servo_id in (1, 2)))


class Trace:
    """Slots under names, and what becomes of them."""

    def __init__(self) -> None:
        self.slots = Slots()
        self._names: dict[Slot, str] = {}

    def send(self, name: str, request: Request[Any], *, overdue: bool = False) -> Slot:
        slot = Slot(request, self.slots.lanes[request.packet_id + 1], None)
        self._names[slot] = name
        self.slots.open(slot)
        if overdue:
            self.slots.expire(slot)
        return slot

    def stop(self, name: str) -> None:
        slot = Slot(STOP, self.slots.lanes[STOP.packet_id + 1], None)
        self._names[slot] = name
        self.slots.open_stop(slot)

    def hear(self, content: Response, response_id: int | None = None) -> list[tuple[str, Content | None]] | None:
        return self._named(self.slots.settle(response_id or content.packet_id, content))

    def hear_unreadable(self, request: Request[Any]) -> list[tuple[str, Content | None]] | None:
        return self._named(self.slots.settle(request.packet_id + 1, UNREADABLE))

    def _named(self, settled: list[tuple[Slot, Content | None]] | None) -> list[tuple[str, Content | None]] | None:
        assert settled is None or all(not slot.open for slot, _ in settled)
        return None if settled is None else [(self._names[slot], content) for slot, content in settled]

    @property
    def open(self) -> str:
        lanes = self.slots.lanes.values()
        open_slots = {slot for lane in lanes for slot in lane.slots}
        assert all(slot.open == (slot in open_slots) for slot in self._names)
        return " ".join(name for slot, name in self._names.items() if slot.open)
