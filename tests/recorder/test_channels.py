"""The messages of a recording, and the schemas that other tools read."""

from __future__ import annotations

import json
from typing import Any

import pytest

from servolink.errors import DecodeError
from servolink.recorder.channels import (
    CHANNELS,
    CommandDone,
    Event,
    Message,
    PacketSeen,
    ProblemFound,
    RecordedServo,
    ServosRead,
    Wire,
    decode,
    encode,
    schema,
)

MESSAGES: dict[str, Message] = {
    "/wire": Wire("sent", b"\x00\xff", 1.25),
    "/packets": PacketSeen("received", 30021, "QueryActionResponse", {"action_id": 3}, 40),
    "/servos": ServosRead((RecordedServo(1, 90, "degree", 3, 40, 1, is_start=True, is_hold=True, caption="knee"),), 2),
    "/events": Event("button", "press", button_id=7),
    "/commands": CommandDone("SetAngleUnitRequest", {"servo_id": 255}, "answered", 0.002, "studio", "a1", "studio"),
    "/problems": ProblemFound("dropped", "the disk is slow", "/servos", 12),
}


@pytest.mark.parametrize("topic", CHANNELS)
def test_message_comes_back(topic: str) -> None:
    assert decode(topic, encode(MESSAGES[topic])) == MESSAGES[topic]


@pytest.mark.parametrize("topic", CHANNELS)
def test_schema_is_one_that_foxglove_reads(topic: str) -> None:
    """Each part has one simple type, as its reader of JSON Schema knows neither references nor alternatives."""
    found = json.loads(schema(topic))
    assert found["type"] == "object"
    assert set(json.loads(encode(MESSAGES[topic]))) <= set(found["properties"])
    parts: list[dict[str, Any]] = [found]
    while parts:
        part = parts.pop()
        assert part["type"] in {"object", "array", "string", "number", "integer", "boolean"}
        assert not {"$ref", "anyOf", "oneOf"} & set(part)
        parts += [*part.get("properties", {}).values(), *([part["items"]] if "items" in part else [])]


def test_bytes_are_marked_as_base64() -> None:
    assert json.loads(schema("/wire"))["properties"]["data"] == {"type": "string", "contentEncoding": "base64"}


@pytest.mark.parametrize(
    ("topic", "data"),
    [
        ("/other", b"{}"),
        ("/wire", b"{}"),
        ("/wire", b"\xff"),
        ("/events", b"[" * 100_000),
        ("/servos", b'{"servos": 1}'),
    ],
)
def test_what_is_no_message_is_an_error_that_keeps_the_bytes(topic: str, data: bytes) -> None:
    with pytest.raises(DecodeError) as caught:
        decode(topic, data)
    assert caught.value.data == data
