"""Which responses a request accepts as its own."""

from __future__ import annotations

import pytest

from servolink.protocol.codec import PACKETS
from servolink.protocol.editing import AddServoParameterRequest, QueryActionRequest, QueryActionResponse
from servolink.protocol.joystick import ButtonEventResponse, SetActiveJoystickTableRequest
from servolink.protocol.packet import Effect, Query, Request, Response
from servolink.protocol.servos import (
    ALL_SERVOS,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
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
    ("event", "kind"),
    [
        (ButtonEventResponse.PRESS, "press"),
        (ButtonEventResponse.LONG_PRESS, "long_press"),
        (ButtonEventResponse.UP, "up"),
        (3, "event 3"),
        (0, "event 0"),
    ],
)
def test_a_button_event_has_a_word(event: int, kind: str) -> None:
    assert ButtonEventResponse(7, event).kind == kind


def test_each_packet_that_the_host_sends_declares_its_effect_on_the_servos() -> None:
    sent = [packet for packet in PACKETS.values() if not issubclass(packet, Query | Response)]
    assert len(sent) > 15
    assert [packet.__name__ for packet in sent if "effect" not in vars(packet)] == []


@pytest.mark.parametrize(
    ("is_start", "is_hold", "effect"),
    [
        (0, 1, Effect.STOPS),
        (0, 0, Effect.GOES_LIMP),
        (1, 1, Effect.MOVES),
        (1, 0, Effect.MOVES),
        (0, 2, Effect.GOES_LIMP),
        (2, 1, Effect.MOVES),
    ],
)
def test_start_and_hold_decide_between_stop_release_and_start(is_start: int, is_hold: int, effect: Effect) -> None:
    packet = SetServoParameterRequest(1, is_start, is_hold)
    assert packet.effect is effect
    assert packet.is_motion == (effect is not Effect.STOPS)


def test_what_may_move_is_a_motion_unless_it_only_makes_buttons_move_servos() -> None:
    correction, table = AddServoParameterRequest(()), SetActiveJoystickTableRequest(1)
    assert (correction.effect, table.effect) == (Effect.MAY_MOVE, Effect.MAY_MOVE)
    assert correction.is_motion
    assert not table.is_motion
