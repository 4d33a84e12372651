"""All packets by id and by name."""

from __future__ import annotations

from servolink.protocol.codec import PACKETS
from servolink.protocol.packet import Request
from servolink.protocol.servos import QueryServoListRequest, QueryServoListResponse


def test_ids_and_names_lead_to_the_same_packets() -> None:
    assert len(PACKETS) == len(PACKETS.by_name) == 60
    assert all(PACKETS.by_name[kind.__name__] is kind and kind.packet_id == id_ for id_, kind in PACKETS.items())


def test_the_answer_to_a_request_is_the_next_id() -> None:
    assert PACKETS.response_of(QueryServoListRequest()) is QueryServoListResponse
    answered = [kind for kind in PACKETS.values() if issubclass(kind, Request)]
    assert len(answered) == 28
    for kind in answered:
        assert PACKETS[kind.packet_id + 1].__name__ == kind.__name__.replace("Request", "Response")
