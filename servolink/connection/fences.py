"""Fences: queries with short responses, and how to tell which of them a response answers."""

from __future__ import annotations

from typing import Any

from servolink.protocol.editing import QueryProjectIDRequest
from servolink.protocol.joystick import QueryActiveJoystickTableRequest
from servolink.protocol.packet import Query, Request, Response
from servolink.protocol.record_types import RECORD_TYPES
from servolink.protocol.servos import (
    ALL_SERVOS,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    QueryServoResponse,
)
from servolink.protocol.settings import QueryMemorySizeRequest, QueryRemainPowerRequest

FENCES: tuple[Query[Any], ...] = (
    QueryProjectIDRequest(),
    QueryMemorySizeRequest(),
    QueryRemainPowerRequest(),
    QueryActiveJoystickTableRequest(),
)
"""Queries with short responses, which settle what was sent before them."""

SERVO_LIST = QueryServoListRequest()
LISTS: tuple[Query[Any], ...] = (SERVO_LIST, *(each.list_request for each in RECORD_TYPES))
"""Queries whose responses name servos or records, each of which can be asked for."""
RESERVES: tuple[Query[Any], ...] = (SERVO_LIST, QueryServoRequest(ALL_SERVOS))
"""Fences for boards that answer fewer than two of FENCES."""

_MOST_OF_A_KIND = 4  # servos or records asked for


def name_of(query: Request[Any]) -> str:
    """Return the name of a query in a profile, such as `QueryMemorySize`."""
    return type(query).__name__.removesuffix("Request")


def queries_about(response: Response) -> list[Query[Any]]:
    """Return queries of the first servos or records that are named in the response to one of LISTS."""
    if isinstance(response, QueryServoListResponse):
        ids = [each for each in dict.fromkeys(response.servo_id_list) if each != ALL_SERVOS]
        return [QueryServoRequest(each) for each in ids[:_MOST_OF_A_KIND]]
    record_type = next(each for each in RECORD_TYPES if each.list_request.packet_id + 1 == response.packet_id)
    ids = [each for each in dict.fromkeys(record_type.ids_in(response)) if each]
    return [record_type.query(each) for each in ids[:_MOST_OF_A_KIND]]


def names(response: Response, query: Query[Any]) -> bool:
    """Return whether `response`, with the right id, names the servo or record of `query`, if there is any."""
    if isinstance(query, QueryServoRequest) and isinstance(response, QueryServoResponse):
        return [servo.servo_id for servo in response.servos] == [query.servo_id]
    return not query.echoed or getattr(response, query.echoed) == getattr(query, query.echoed)
