"""Which responses a request accepts as its own."""

from __future__ import annotations

import pytest

from servolink.protocol.codec import PACKETS
from servolink.protocol.editing import QueryActionRequest, QueryActionResponse
from servolink.protocol.joystick import LONG_PRESS, PRESS, UP, ButtonEventResponse
from servolink.protocol.packet import Request, Response
from servolink.protocol.servos import (
    ALL_SERVOS,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
)
from servolink.protocol.settings import ClearAllDataRequest, ClearAllDataResponse


def states(*servo_ids: int) -> QueryServoResponse:
    return QueryServoResponse(tuple(ServoState(servo_id, 0, 0, 0, 0, 0, 0) for servo_id in servo_ids))


@pytest.mark.parametrize(
    ("request_", "response", "accepted"),
    [
        (QueryActionRequest(5), QueryActionResponse(5), True),
        (QueryActionRequest(5), QueryActionResponse(0), True),
        (QueryActionRequest(5), QueryActionResponse(6), False),
        (SetAngleUnitRequest(3, 1), SetAngleUnitResponse(3, 0), True),
        (SetAngleUnitRequest(3, 1), SetAngleUnitResponse(4, 1), False),
        (ClearAllDataRequest(), ClearAllDataResponse(0), True),
        (QueryServoRequest(3), states(3), True),
        (QueryServoRequest(3), states(), True),
        (QueryServoRequest(3), states(4), False),
        (QueryServoRequest(3), states(3, 4), False),
        (QueryServoRequest(ALL_SERVOS), states(3, 4), True),
        (QueryServoRequest(3), ClearAllDataResponse(1), True),
    ],
)
def test_an_answer_must_repeat_what_was_asked(request_: Request[Response], response: Response, accepted: bool) -> None:
    assert request_.accepts(response) is accepted


def test_every_echoed_field_is_in_request_and_answer() -> None:
    echoing = [kind for kind in PACKETS.values() if issubclass(kind, Request) and kind.echoed]
    assert {kind.packet_id for kind in echoing} == {20030, 20040, 30020, 30060, 40020}
    for kind in echoing:
        assert kind.echoed in kind.__struct_fields__
        assert kind.echoed in PACKETS[kind.packet_id + 1].__struct_fields__


@pytest.mark.parametrize(
    ("event", "kind"), [(PRESS, "press"), (LONG_PRESS, "long_press"), (UP, "up"), (3, "event 3"), (0, "event 0")]
)
def test_a_button_event_has_a_word(event: int, kind: str) -> None:
    assert ButtonEventResponse(7, event).kind == kind
