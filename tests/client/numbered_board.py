"""A board whose every answer tells which sending it answers, and which answers late or never.

Answers keep their order, as a board's do: behind a late one all later ones wait.
"""

from __future__ import annotations

import asyncio
import contextvars
import random
from collections import deque
from dataclasses import dataclass

from servolink.protocol.codec import Codec
from servolink.protocol.editing import (
    QueryActionRequest,
    QueryActionResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.protocol.joystick import QueryActiveJoystickTableRequest, QueryActiveJoystickTableResponse
from servolink.protocol.packet import Packet, Response
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import QueryServoRequest, QueryServoResponse, ServoState
from servolink.protocol.settings import (
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
)
from servolink.transports.base import Receiver

CALL: contextvars.ContextVar[int] = contextvars.ContextVar("CALL", default=0)
"""The call of the program under test that is sending."""


@dataclass(frozen=True, slots=True)
class Behaviour:
    """How often, and how long, the board misbehaves."""

    late: float = 0.0
    lost: float = 0.0
    latency: float = 0.004
    late_by: tuple[float, float] = (0.1, 1.5)


class NumberedBoard:
    """A transport with such a board behind it."""

    url = "numbered://"

    def __init__(self, behaviour: Behaviour, seed: int) -> None:
        self.behaviour = behaviour
        self.sent_by: list[int] = [0]
        """Call by number of sending; numbers begin at 1."""
        self.executed: list[Packet] = []
        self._random = random.Random(seed)
        self._codec = Codec()
        self._parser = FrameParser()
        self._outbox: deque[tuple[float, bytes]] = deque()
        self._free_at = 0.0
        self._receiver: Receiver | None = None

    async def open(self, receiver: Receiver) -> None:
        self._receiver = receiver

    async def send(self, data: bytes) -> None:
        for packet_id, content in self._parser.feed(data):
            self.sent_by.append(CALL.get())
            packet = self._codec.decode(packet_id, content)
            self.executed.append(packet)
            self._answer(packet, len(self.sent_by) - 1)

    async def close(self) -> None:
        if self._receiver is not None:
            self._receiver.lost(None)

    def _answer(self, packet: Packet, number: int) -> None:
        kind = self._random.random()
        loop = asyncio.get_running_loop()
        delay = self.behaviour.latency
        if kind < self.behaviour.lost:
            return
        if kind < self.behaviour.lost + self.behaviour.late:
            delay = self._random.uniform(*self.behaviour.late_by)
        self._free_at = max(self._free_at, loop.time() + delay)
        self._outbox.append((self._free_at, self._codec.encode(numbered(packet, number))))
        loop.call_at(self._free_at, self._deliver)

    def _deliver(self) -> None:
        _, frame = self._outbox.popleft()
        assert self._receiver is not None
        self._receiver.data(frame)


def numbered(request: Packet, number: int) -> Response:
    """Return the answer to sending `number`, with that number in it."""
    match request:
        case QueryProjectIDRequest():
            return QueryProjectIDResponse(number)
        case QueryMemorySizeRequest():
            return QueryMemorySizeResponse(number, 0)
        case QueryRemainPowerRequest():
            return QueryRemainPowerResponse(number % 32749)
        case QueryActiveJoystickTableRequest():
            return QueryActiveJoystickTableResponse(number)
        case QueryActionRequest():
            return QueryActionResponse(request.action_id, str(number))
        case QueryServoRequest():
            return QueryServoResponse((ServoState(request.servo_id, number % 32749, 0, 0, 0, 1, 1),))
        case WriteProjectIDRequest():
            return WriteProjectIDResponse(1 + number % 199)
    raise AssertionError(f"nobody asks for {request}")
