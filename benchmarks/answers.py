"""A board that never changes: the frames of all responses that opening and polling need."""

from __future__ import annotations

from functools import cache
from typing import Any

from servolink.protocol.codec import Codec
from servolink.protocol.editing import QueryProjectIDResponse
from servolink.protocol.joystick import QueryActiveJoystickTableResponse, SubscribeButtonEventResponse
from servolink.protocol.packet import Query, Response
from servolink.protocol.servos import (
    ALL_SERVOS,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetAngleUnitResponse,
)
from servolink.protocol.settings import (
    QueryMemorySizeResponse,
    QueryRemainPowerResponse,
    TransmissionModeSettingResponse,
)

SERVO_IDS = tuple(range(16))
SERVOS = tuple(ServoState(at, 90 - at, 120, 400 + at, 1, 1, 1) for at in SERVO_IDS)

_RESPONSES: tuple[Response, ...] = (
    TransmissionModeSettingResponse(1),
    QueryMemorySizeResponse(900_000, 1_000_000),
    QueryRemainPowerResponse(800),
    QueryServoListResponse(SERVO_IDS),
    QueryServoResponse(SERVOS),
    SetAngleUnitResponse(ALL_SERVOS, 0),
    QueryProjectIDResponse(7),
    QueryActiveJoystickTableResponse(1),
    SubscribeButtonEventResponse(1),
)


@cache
def answers() -> dict[int, bytes]:
    """Return the frame of each response by the packet id of its request."""
    return {response.packet_id - 1: Codec().encode(response) for response in _RESPONSES}


def exchange(size: int) -> tuple[Query[Any], bytes]:
    """Return a query and the frame of its response, which has `size` bytes, 14 or 186."""
    if size == 14:
        return QueryServoListRequest(), Codec().encode(QueryServoListResponse(SERVO_IDS[:4]))
    query = QueryServoRequest(ALL_SERVOS)
    return query, answers()[query.packet_id]
