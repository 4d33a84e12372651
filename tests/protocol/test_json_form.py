"""Packets as JSON objects, in both directions."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from servolink.errors import EncodeError
from servolink.protocol.codec import Codec
from servolink.protocol.json_form import packet_from_json, packet_to_json
from servolink.protocol.packet import Packet
from servolink.protocol.records import Step
from servolink.protocol.servos import ExecuteActionRequest
from servolink.protocol.settings import SendDummyDataRequest
from tests.protocol.declared import VECTORS_BY_NAME, any_packet, packet_of
from tests.tables import over


@over("name", VECTORS_BY_NAME)
def test_an_object_has_the_documents_names_and_values(name: str) -> None:
    for vector in VECTORS_BY_NAME[name]:
        written = {"packet": vector.name, "id": vector.packet_id, "fields": vector.fields}
        assert json.loads(json.dumps(packet_to_json(packet_of(vector)))) == written
        assert packet_from_json(written) == packet_of(vector)


@given(any_packet)
def test_every_packet_comes_back_through_json(packet: Packet) -> None:
    assert packet_from_json(json.loads(json.dumps(packet_to_json(packet)))) == packet


def test_packet_or_id_or_empty_fields_may_be_left_out() -> None:
    steps = {"steps": [{"servo_id": 1, "degree": -90, "interval": 100}]}
    expected = ExecuteActionRequest((Step(1, -90, 100),))
    assert packet_from_json({"packet": "ExecuteActionRequest", "fields": steps}) == expected
    assert packet_from_json({"id": 20050, "fields": steps}) == expected
    assert packet_from_json({"id": 20050}) == ExecuteActionRequest()
    assert packet_from_json({"id": 10050, "fields": {"data": "13 4c"}}) == SendDummyDataRequest(b"\x13\x4c")


STEP = {"servo_id": 1, "degree": 2, "interval": 3}


@pytest.mark.parametrize(
    ("described", "fault"),
    [
        (None, "must be an object with packet and fields, not None"),
        ([1], "must be an object with packet and fields, not [1]"),
        ({}, "the object has neither packet nor id"),
        ({"packet": "Dance"}, "packet: there is no 'Dance'"),
        ({"packet": "\x1b[2J"}, "packet: there is no '\\x1b[2J'"),
        ({"packet": ["x"]}, "packet: there is no ['x']"),
        ({"id": 7}, "id: no packet has the id 7"),
        ({"id": True}, "id: no packet has the id True"),
        ({"id": 20050.0}, "id: no packet has the id 20050.0"),
        ({"id": 20020, "packet": "ExecuteActionRequest"}, "id: ExecuteActionRequest has the id 20050, not 20020"),
        ({"id": 20050, "fields": [1]}, "ExecuteActionRequest.fields: must be an object, not [1]"),
        ({"id": 20050, "fields": {"setps": []}}, "ExecuteActionRequest.setps: no such field; the fields are steps"),
        ({"id": 20010, "fields": {"x": 1}}, "QueryServoListRequest.x: no such field; the fields are none"),
        ({"id": 20020}, "QueryServoRequest: 'servo_id' is missing"),
        ({"id": 20020, "fields": {"servo_id": 256}}, "QueryServoRequest.servo_id: 256 is outside 0..255"),
        ({"id": 20020, "fields": {"servo_id": True}}, "QueryServoRequest.servo_id: must be an integer, not true"),
        ({"id": 20020, "fields": {"servo_id": "1"}}, "QueryServoRequest.servo_id: must be an integer, not '1'"),
        (
            {"id": 20020, "fields": {"servo_id": 10**30}},
            "QueryServoRequest.servo_id: 1" + "0" * 30 + " is outside 0..255",
        ),
        ({"id": 20011, "fields": {"servo_id_list": [1, -1]}}, "QueryServoListResponse.servo_id_list[1]: -1 is outside"),
        (
            {"id": 20050, "fields": {"steps": [STEP, {**STEP, "interval": -1}]}},
            "ExecuteActionRequest.steps[1].interval: -1 is",
        ),
        (
            {"id": 20050, "fields": {"steps": [{**STEP, "speed": 9}]}},
            "ExecuteActionRequest.steps[0]: 'speed' is not a field; the fields are servo_id, degree, interval",
        ),
        ({"id": 20050, "fields": {"steps": 3}}, "ExecuteActionRequest.steps: must be a list, not 3"),
        (
            {"id": 30030, "fields": {"action_id": 1, "action_caption": 5}},
            "AddActionRequest.action_caption: must be text, not 5",
        ),
        (
            {"id": 20050, "fields": {"steps": [{"\udcff": 9}]}},
            "ExecuteActionRequest.steps[0]: '\ufffd' is not a field",
        ),
        ({"id": 10050, "fields": {"data": "1"}}, "SendDummyDataRequest.data: must be text of hex digits, not '1'"),
        ({"id": 10050, "fields": {"data": 19}}, "SendDummyDataRequest.data: must be text of hex digits, not 19"),
        (
            {"id": 10031, "fields": {"size": 1, "total_size": -2}},
            "QueryMemorySizeResponse.total_size: -2 is outside 0..2",
        ),
    ],
)
def test_what_is_wrong_with_an_object_is_said(described: Any, fault: str) -> None:
    with pytest.raises(EncodeError) as refused:
        packet_from_json(described)
    assert str(refused.value).startswith(fault)


def test_a_huge_value_is_not_repeated_whole() -> None:
    with pytest.raises(EncodeError) as refused:
        packet_from_json({"id": 20020, "fields": {"servo_id": "x" * 10_000}})
    assert len(str(refused.value)) < 200


_json = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(st.characters(), max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(st.characters(), max_size=3), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(any_packet, st.data())
def test_no_value_in_any_place_raises_anything_else(packet: Packet, data: Any) -> None:
    described = json.loads(json.dumps(packet_to_json(packet)))
    place = described["fields"]
    while isinstance(place, (dict, list)) and place:
        key = data.draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
        if data.draw(st.booleans()):
            place[key] = data.draw(_json)
            break
        place = place[key]
    try:
        again = packet_from_json(described)
        good = Codec().decode_frame(Codec().encode(again)) == again
    except EncodeError as error:
        good = type(packet).__name__ in str(error)
    assert good


@given(_json)
def test_what_is_no_packet_at_all_is_refused(described: Any) -> None:
    with pytest.raises(EncodeError):
        packet_from_json(described)
