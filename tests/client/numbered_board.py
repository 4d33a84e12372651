"""A board whose every answer tells which sending it answers, and which answers late or never.

Answers keep their order, as a board's do: behind a late one all later ones wait.
"""

from __future__ import annotations

import contextvars
import random
from collections.abc import Callable, Iterable
from typing import Any

from servolink.protocol import (
    ALL_SERVOS,
    ActionEntry,
    AddActionRequest,
    AddActionResponse,
    AddJoystickTableRequest,
    AddJoystickTableResponse,
    AddMacroRequest,
    AddMacroResponse,
    AddServoParameterRequest,
    AddServoParameterResponse,
    Button,
    ClearAllDataRequest,
    ClearAllDataResponse,
    DeleteActionRequest,
    DeleteActionResponse,
    DeleteJoystickTableRequest,
    DeleteJoystickTableResponse,
    DeleteMacroRequest,
    DeleteMacroResponse,
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    JoystickTableEntry,
    MacroEntry,
    Packet,
    QueryActionListRequest,
    QueryActionListResponse,
    QueryActionRequest,
    QueryActionResponse,
    QueryActiveJoystickTableRequest,
    QueryActiveJoystickTableResponse,
    QueryJoystickTableListRequest,
    QueryJoystickTableListResponse,
    QueryJoystickTableRequest,
    QueryJoystickTableResponse,
    QueryMacroListRequest,
    QueryMacroListResponse,
    QueryMacroRequest,
    QueryMacroResponse,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoParameterRequest,
    QueryServoParameterResponse,
    QueryServoRequest,
    QueryServoResponse,
    Response,
    Result,
    ServoParameter,
    ServoState,
    SetActiveJoystickTableRequest,
    SetActiveJoystickTableResponse,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
    SetServoParameterResponse,
    SubscribeButtonEventRequest,
    SubscribeButtonEventResponse,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from servolink.testing import Fate
from tests.client.piped_board import LOST, PipedBoard

CALL: contextvars.ContextVar[int] = contextvars.ContextVar("CALL", default=0)
"""The call of the program under test that is sending."""


class NumberedBoard(PipedBoard):
    """Such a board, with the shares of responses that are late, by 0.1 to 1.5 s, and lost."""

    takes_at_once = False
    """All is sent in the task of the call, which says what CALL is."""

    def __init__(self, *, late: float, lost: float, seed: int) -> None:
        super().__init__()
        self.late, self.lost = late, lost
        self.sent_by: list[int] = [0]
        """Call by number of sending; numbers begin at 1."""
        self._chance = random.Random(seed)

    def fate_of(self, request: Packet) -> Fate:
        self.sent_by.append(CALL.get())
        drawn = self._chance.random()
        if drawn < self.lost:
            return LOST
        delay = self._chance.uniform(0.1, 1.5) if drawn < self.lost + self.late else 0.0
        return Fate(executes=False, says=numbered(request, len(self.sent_by) - 1), delay=delay)


ABSENT = 8
"""One record in so many does not exist, says the board."""

SERVO_IDS = range(1, 9)
"""Servos of the board; the list holds them in any order."""


def numbered(request: Packet, number: int) -> Response:
    """Return the answer to sending `number`, with that number, or what fits of it, in it."""
    return _ANSWERS[type(request)](request, number)


def _id(record_id: int, number: int) -> int:
    """Return the id in the answer: 0 if the record is said not to exist."""
    return record_id if number % ABSENT else 0


def _servos(number: int, servo_ids: Iterable[int]) -> tuple[ServoState, ...]:
    return tuple(ServoState(servo_id, number % 32749, servo_id, 0, 0, 0, 1) for servo_id in servo_ids)


def _order(number: int) -> tuple[int, ...]:
    """Return the ids of the servos in an order that says the number, up to 40,320."""
    left, found = list(SERVO_IDS), list[int]()
    while left:
        number, at = divmod(number, len(left))
        found.append(left.pop(at))
    return tuple(found)


def _result(declared: type[Result]) -> Callable[[Any, int], Response]:
    return lambda request, number: declared(1 + number % 199)


_ANSWERS: dict[type[Packet], Callable[[Any, int], Response]] = {
    TransmissionModeSettingRequest: lambda request, n: TransmissionModeSettingResponse(n % 251),
    ClearAllDataRequest: _result(ClearAllDataResponse),
    QueryMemorySizeRequest: lambda request, n: QueryMemorySizeResponse(n, 0),
    QueryRemainPowerRequest: lambda request, n: QueryRemainPowerResponse(n % 32749),
    QueryServoListRequest: lambda request, n: QueryServoListResponse(_order(n)),
    QueryServoRequest: lambda request, n: QueryServoResponse(
        _servos(n, SERVO_IDS if request.servo_id == ALL_SERVOS else [request.servo_id])
    ),
    SetServoParameterRequest: lambda request, n: SetServoParameterResponse(request.servo_id, n % 251, n % 241),
    SetAngleUnitRequest: lambda request, n: SetAngleUnitResponse(request.servo_id, n % 251),
    QueryActionListRequest: lambda request, n: QueryActionListResponse(
        tuple(ActionEntry(n + at, "action") for at in range(10))
    ),
    QueryActionRequest: lambda request, n: QueryActionResponse(_id(request.action_id, n), str(n)),
    AddActionRequest: _result(AddActionResponse),
    DeleteActionRequest: _result(DeleteActionResponse),
    QueryMacroListRequest: lambda request, n: QueryMacroListResponse((MacroEntry(n, ""),)),
    QueryMacroRequest: lambda request, n: QueryMacroResponse(_id(request.macro_id, n), str(n)),
    AddMacroRequest: _result(AddMacroResponse),
    DeleteMacroRequest: _result(DeleteMacroResponse),
    ExecuteMacroRequest: _result(ExecuteMacroResponse),
    QueryServoParameterRequest: lambda request, n: QueryServoParameterResponse((ServoParameter(1, n % 32749, str(n)),)),
    AddServoParameterRequest: _result(AddServoParameterResponse),
    WriteProjectIDRequest: _result(WriteProjectIDResponse),
    QueryProjectIDRequest: lambda request, n: QueryProjectIDResponse(n),
    QueryJoystickTableListRequest: lambda request, n: QueryJoystickTableListResponse((JoystickTableEntry(n, ""),)),
    QueryJoystickTableRequest: lambda request, n: QueryJoystickTableResponse(
        _id(request.table_id, n), str(n), (Button(n, "fire"),)
    ),
    AddJoystickTableRequest: _result(AddJoystickTableResponse),
    DeleteJoystickTableRequest: _result(DeleteJoystickTableResponse),
    SetActiveJoystickTableRequest: _result(SetActiveJoystickTableResponse),
    QueryActiveJoystickTableRequest: lambda request, n: QueryActiveJoystickTableResponse(n),
    SubscribeButtonEventRequest: _result(SubscribeButtonEventResponse),
}
