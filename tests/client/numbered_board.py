"""A board whose every answer tells which sending it answers, and which answers late or never.

Answers keep their order, as a board's do: behind a late one all later ones wait.
"""

from __future__ import annotations

import asyncio
import contextvars
import random
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from servolink.protocol import editing, joystick, records, servos, settings
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Packet, Response, Result
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import ServoState
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


ABSENT = 8
"""One record in so many does not exist, says the board."""


def numbered(request: Packet, number: int) -> Response:
    """Return the answer to sending `number`, with that number, or what fits of it, in it."""
    return _ANSWERS[type(request)](request, number)


def _id(record_id: int, number: int) -> int:
    """Return the id in the answer: 0 if the record is said not to exist."""
    return record_id if number % ABSENT else 0


def _servos(number: int, servo_ids: Iterable[int]) -> tuple[ServoState, ...]:
    return tuple(ServoState(servo_id, number % 32749, servo_id, 0, 0, 0, 1) for servo_id in servo_ids)


def _result(declared: type[Result]) -> Callable[[Any, int], Response]:
    return lambda request, number: declared(1 + number % 199)


_ANSWERS: dict[type[Packet], Callable[[Any, int], Response]] = {
    settings.TransmissionModeSettingRequest: lambda request, n: settings.TransmissionModeSettingResponse(n % 251),
    settings.ClearAllDataRequest: _result(settings.ClearAllDataResponse),
    settings.QueryMemorySizeRequest: lambda request, n: settings.QueryMemorySizeResponse(n, 0),
    settings.QueryRemainPowerRequest: lambda request, n: settings.QueryRemainPowerResponse(n % 32749),
    servos.QueryServoListRequest: lambda request, n: servos.QueryServoListResponse((n % 251, n % 241, n % 239)),
    servos.QueryServoRequest: lambda request, n: servos.QueryServoResponse(
        _servos(n, range(1, 9) if request.servo_id == servos.ALL_SERVOS else [request.servo_id])
    ),
    servos.SetServoParameterRequest: lambda request, n: servos.SetServoParameterResponse(
        request.servo_id, n % 251, n % 241
    ),
    servos.SetAngleUnitRequest: lambda request, n: servos.SetAngleUnitResponse(request.servo_id, n % 251),
    editing.QueryActionListRequest: lambda request, n: editing.QueryActionListResponse(
        tuple(records.ActionEntry(n + at, "action") for at in range(10))
    ),
    editing.QueryActionRequest: lambda request, n: editing.QueryActionResponse(_id(request.action_id, n), str(n)),
    editing.AddActionRequest: _result(editing.AddActionResponse),
    editing.DeleteActionRequest: _result(editing.DeleteActionResponse),
    editing.QueryMacroListRequest: lambda request, n: editing.QueryMacroListResponse((records.MacroEntry(n, ""),)),
    editing.QueryMacroRequest: lambda request, n: editing.QueryMacroResponse(_id(request.macro_id, n), str(n)),
    editing.AddMacroRequest: _result(editing.AddMacroResponse),
    editing.DeleteMacroRequest: _result(editing.DeleteMacroResponse),
    editing.ExecuteMacroRequest: _result(editing.ExecuteMacroResponse),
    editing.QueryServoParameterRequest: lambda request, n: editing.QueryServoParameterResponse(
        (records.ServoParameter(1, n % 32749, str(n)),)
    ),
    editing.AddServoParameterRequest: _result(editing.AddServoParameterResponse),
    editing.WriteProjectIDRequest: _result(editing.WriteProjectIDResponse),
    editing.QueryProjectIDRequest: lambda request, n: editing.QueryProjectIDResponse(n),
    joystick.QueryJoystickTableListRequest: lambda request, n: joystick.QueryJoystickTableListResponse(
        (records.JoystickTableEntry(n, ""),)
    ),
    joystick.QueryJoystickTableRequest: lambda request, n: joystick.QueryJoystickTableResponse(
        _id(request.table_id, n), str(n), (records.Button(n, "fire"),)
    ),
    joystick.AddJoystickTableRequest: _result(joystick.AddJoystickTableResponse),
    joystick.DeleteJoystickTableRequest: _result(joystick.DeleteJoystickTableResponse),
    joystick.SetActiveJoystickTableRequest: _result(joystick.SetActiveJoystickTableResponse),
    joystick.QueryActiveJoystickTableRequest: lambda request, n: joystick.QueryActiveJoystickTableResponse(n),
    joystick.SubscribeButtonEventRequest: _result(joystick.SubscribeButtonEventResponse),
}
