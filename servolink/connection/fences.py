"""Fences: queries with short responses, the choice of the next one, and which of them a response answers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from servolink.connection.call import Lane
from servolink.connection.stats import Stats
from servolink.protocol.editing import QueryProjectIDRequest
from servolink.protocol.joystick import QueryActiveJoystickTableRequest
from servolink.protocol.packet import Packet, Query, Request, Response
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
_SAME_FENCE = 3  # sendings in a silence: perhaps the board does not support the query


class FenceChoice:
    """Choice of the next fence to be sent."""

    def __init__(self, lanes: Mapping[int, Lane], stats: Stats) -> None:
        """Choose by the open slots of `lanes`, by response id."""
        self.queries = FENCES
        """Queries known to be answered, used in turn."""
        self._lanes = lanes
        self._stats = stats
        self._latest = FENCES[0]
        self._tries = 0  # sendings of the latest in a row
        self._sent_at = -1  # frames received when the latest was sent

    def use(self, queries: tuple[Query[Any], ...]) -> None:
        """Use `queries`, of which there is at least one, from now on."""
        self.queries = queries
        if self._latest not in queries:
            self._latest = queries[0]

    def next(self, packet: Packet) -> Query[Any]:
        """Return the next fence, on another lane than `packet`, and count it as sent."""
        self._stats.fences += 1
        received, self._sent_at = self._sent_at, self._stats.frames_received
        same = received == self._sent_at and self._latest.packet_id != packet.packet_id
        if not same or self._tries == _SAME_FENCE:
            self._latest = self._another(packet)
            self._tries = 0
        self._tries += 1
        # In a silence the same fence is sent again: the first response proves everything older than the first sending.
        return self._latest

    def _another(self, packet: Packet) -> Query[Any]:
        """Return the fence whose response will settle the most; not the latest, if there are others.

        On an idle lane it is exact and settles everything. Elsewhere it belongs to the oldest slot of the lane, and
        settles what is older than that; where this slot is the youngest, other lanes become idle.
        """
        self.queries = (*self.queries[1:], self.queries[0])
        others = {packet.packet_id, self._latest.packet_id}
        fences = [fence for fence in (*self.queries, SERVO_LIST) if fence.packet_id not in others]
        return max(fences or [self._latest], key=self._settled_until)

    def _settled_until(self, fence: Query[Any]) -> float:
        """Return the time up to which a response to `fence` will settle all sendings."""
        slots = self._lanes[fence.packet_id + 1].slots
        return slots[0].sent_at if slots else float("inf")


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
