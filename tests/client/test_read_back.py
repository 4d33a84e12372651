"""Read-back: whether a command whose answer was lost took effect."""

from __future__ import annotations

from typing import Any

import pytest

from servolink.errors import DecodeError, OutcomeUnknown
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    AddJoystickTableRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    Button,
    ClearAllDataRequest,
    DeleteActionRequest,
    DeleteJoystickTableRequest,
    DeleteMacroRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    MacroCommand,
    Packet,
    QueryServoRequest,
    QueryServoResponse,
    Request,
    ServoParameter,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
)
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, lie, opened

ACTION = AddActionRequest(1, "a", (Step(1, 10, 20),))
MACRO = AddMacroRequest(2, "m", (MacroCommand(1),))
TABLE = AddJoystickTableRequest(3, "t", (Button(1, "A", 2),))
PARAMETERS = AddServoParameterRequest((ServoParameter(1, 5, "hip"),))

CASES: list[tuple[tuple[Request[Any], ...], Request[Any]]] = [
    ((), ACTION),
    ((), MACRO),
    ((), TABLE),
    ((ACTION,), DeleteActionRequest(1)),
    ((MACRO,), DeleteMacroRequest(2)),
    ((TABLE,), DeleteJoystickTableRequest(3)),
    ((AddServoParameterRequest((ServoParameter(2),)),), PARAMETERS),
    ((), WriteProjectIDRequest(7)),
    ((TABLE, AddJoystickTableRequest(4), SetActiveJoystickTableRequest(4)), SetActiveJoystickTableRequest(3)),
    ((), SetServoParameterRequest(2, 0, 1)),
    ((), SetServoParameterRequest(ALL_SERVOS, 0, 0)),
    ((ACTION,), ClearAllDataRequest()),
    ((MACRO,), ClearAllDataRequest()),
    ((TABLE,), ClearAllDataRequest()),
]


@pytest.mark.parametrize(("before", "request_"), CASES, ids=[type(request).__name__ for _, request in CASES])
@pytest.mark.parametrize(("fate", "done"), [(SWALLOWED, True), (LOST, False)])
async def test_what_was_done_is_told_from_what_was_lost(
    before: tuple[Request[Any], ...], request_: Request[Any], fate: Any, done: bool
) -> None:
    fake = PipedBoard()
    async with opened(fake, patience=1 / 32) as board:  # what may be repeated is sent once in that
        for request in before:
            await board.request(request)
        fake.plan(type(request_), fate)
        with pytest.raises(OutcomeUnknown) as caught:
            await board.request(request_)
        assert await board.took_effect(caught.value.request) is done


@pytest.mark.parametrize(
    ("there", "wanted"),
    [
        (ACTION, AddActionRequest(1, "another", ACTION.steps)),
        (ACTION, AddActionRequest(1, "a")),
        (MACRO, AddMacroRequest(2, "m")),
        (TABLE, AddJoystickTableRequest(3, "t", (Button(1, "B", 2),))),
        (PARAMETERS, AddServoParameterRequest((ServoParameter(1, 6, "hip"),))),
        (WriteProjectIDRequest(1), WriteProjectIDRequest(2)),
        (SetServoParameterRequest(1, 0, 1), SetServoParameterRequest(ALL_SERVOS, 0, 1)),
    ],
)
async def test_something_else_in_its_place_is_no_effect(there: Request[Any], wanted: Request[Any]) -> None:
    async with opened(PipedBoard()) as board:
        await board.request(there)
        assert await board.took_effect(wanted) is False
        assert await board.took_effect(there) is True


async def test_a_servo_that_is_not_there_was_not_set() -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        assert await board.took_effect(SetServoParameterRequest(99, 1, 1)) is False
        fake.plan(QueryServoRequest, *[lie(QueryServoResponse())] * 5)
        with pytest.raises(DecodeError, match=r"^no servo reports, where \[1, 2, .*\] are known$"):
            await board.took_effect(SetServoParameterRequest(ALL_SERVOS, 1, 1))


@pytest.mark.parametrize(
    "request_",
    [
        ExecuteActionRequest((Step(1, 0, 1),)),
        ExecuteMacroRequest(1),
        SetAngleUnitRequest(ALL_SERVOS, 0),
        TransmissionModeSettingRequest(1),
        SubscribeButtonEventRequest(1),
        QueryServoRequest(1),
    ],
)
async def test_what_leaves_no_trace_cannot_be_told(request_: Packet) -> None:
    fake = PipedBoard()
    async with opened(fake) as board:
        assert await board.took_effect(request_) is None
        assert fake.sent == []
