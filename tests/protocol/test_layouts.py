"""Compiled declarations: contents in both directions, and errors for values and lengths that do not fit.

Modules: servolink.protocol.editing, servolink.protocol.joystick, servolink.protocol.servos,
servolink.protocol.settings.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import Meta

from servolink.errors import DecodeError, EncodeError
from servolink.protocol import packet as fields
from servolink.protocol.editing import (
    AddActionRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    QueryActionListResponse,
    WriteProjectIDRequest,
)
from servolink.protocol.joystick import AddJoystickTableRequest, ButtonEventResponse
from servolink.protocol.layouts import LengthRule, layout
from servolink.protocol.packet import Caption, Command, Packet
from servolink.protocol.records import Button, MacroCommand, ServoParameter, Step
from servolink.protocol.servos import (
    ExecuteActionRequest,
    QueryServoListResponse,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
)
from servolink.protocol.settings import QueryMemorySizeResponse, QueryRemainPowerResponse, SendDummyDataRequest


def encode(packet: Packet) -> bytes:
    return layout(type(packet), "little").encode(packet, "utf-8")


OUT_OF_RANGE: list[tuple[Packet, str]] = [
    (QueryServoRequest(256), "QueryServoRequest.servo_id: 256 is outside 0..255"),
    (QueryServoRequest(-1), "QueryServoRequest.servo_id: -1 is outside 0..255"),
    (SetServoParameterRequest(1, 2, 0), "SetServoParameterRequest.is_start: 2 is outside 0..1"),
    (SetAngleUnitRequest(1, 2), "SetAngleUnitRequest.unit_type: 2 is outside 0..1"),
    (WriteProjectIDRequest(2**31), "WriteProjectIDRequest.project_id: 2147483648 is outside -2147483648..2147483647"),
    (ButtonEventResponse(-1, 1), "ButtonEventResponse.button_id: -1 is outside 0..4294967295"),
    (QueryRemainPowerResponse(-1), "QueryRemainPowerResponse.permil: -1 is outside 0..32767"),
    (QueryMemorySizeResponse(1, -1), "QueryMemorySizeResponse.total_size: -1 is outside 0..2147483647"),
    (QueryMemorySizeResponse(-1), "QueryMemorySizeResponse.size: -1 is outside 0..2147483647"),
    (ExecuteActionRequest((Step(1, 2, -1),)), "ExecuteActionRequest.steps[0].interval: -1 is outside 0..32767"),
    (
        AddActionRequest(1, "pose", (Step(1, 0, 0), Step(300, 40_000, 0))),
        ("AddActionRequest.steps[1].servo_id: 300 is outside 0..255; steps[1].degree: 40000 is outside -32768..32767"),
    ),
    (AddMacroRequest(1, "", (MacroCommand(1, 3),)), "AddMacroRequest.commands[0].type: 3 is outside 0..2"),
    (AddMacroRequest(1, "", (MacroCommand(1, 0, 0),)), "AddMacroRequest.commands[0].ratio: 0 is outside 1..100"),
    (QueryServoListResponse((1, 256)), "QueryServoListResponse.servo_id_list[1]: 256 is outside 0..255"),
    (AddJoystickTableRequest(1, "", (Button(-1),)), "AddJoystickTableRequest.buttons[0].button_id: -1 is outside"),
    (WriteProjectIDRequest(10**5000), "WriteProjectIDRequest.project_id: this int is outside -2147483648..2147483647"),
]


@pytest.mark.parametrize(("packet", "fault"), OUT_OF_RANGE)
def test_a_value_out_of_range_is_refused_with_packet_field_value_and_range(packet: Packet, fault: str) -> None:
    with pytest.raises(EncodeError) as refused:
        encode(packet)
    assert str(refused.value).startswith(fault)


WRONG: Any = "1"  # a value that no type checker would let pass

WRONG_TYPE: list[tuple[Packet, str]] = [
    (QueryServoRequest(WRONG), "QueryServoRequest.servo_id: must be an integer, not '1'"),
    (SetServoParameterRequest(1, WRONG, 0), "SetServoParameterRequest.is_start: must be an integer, not '1'"),
    (QueryServoRequest(1.0), "QueryServoRequest.servo_id: must be an integer, not 1.0"),  # type: ignore[arg-type]
    (QueryRemainPowerResponse(float("nan")), "permil: must be an integer, not nan"),  # type: ignore[arg-type]
    (ExecuteActionRequest(WRONG), "ExecuteActionRequest.steps: must be a tuple, not str"),
    (ExecuteActionRequest(((1, 2, 3),)), "ExecuteActionRequest.steps[0]: must be a Step, not tuple"),  # type: ignore[arg-type]
    (SendDummyDataRequest(WRONG), "SendDummyDataRequest.data: must be bytes, not str"),
    (
        AddServoParameterRequest((ServoParameter(1, 0, WRONG * 33),)),
        "AddServoParameterRequest.servos[0].servo_caption: ",
    ),
]


@pytest.mark.parametrize(("packet", "fault"), WRONG_TYPE)
def test_a_value_of_the_wrong_type_is_refused(packet: Packet, fault: str) -> None:
    with pytest.raises(EncodeError) as refused:
        encode(packet)
    assert fault in str(refused.value)


@pytest.mark.parametrize(
    ("packet", "fault"),
    [
        (ExecuteActionRequest((Step(0, 0, 0),) * 256), "ExecuteActionRequest.steps: 256 records are outside 0..255"),
        (
            AddActionRequest(1, "", (Step(0, 0, 0),) * 13_100),
            "AddActionRequest.steps: 13100 records are outside 0..13099",
        ),
        (SendDummyDataRequest(bytes(65_536)), "SendDummyDataRequest.data: 65536 bytes are outside 0..65535"),
    ],
)
def test_more_than_a_frame_holds_is_refused(packet: Packet, fault: str) -> None:
    with pytest.raises(EncodeError) as refused:
        encode(packet)
    assert str(refused.value) == fault


@pytest.mark.parametrize(
    ("packet", "size"),
    [
        (ExecuteActionRequest((Step(0, 0, 0),) * 255), 1 + 5 * 255),
        (AddActionRequest(1, "", (Step(0, 0, 0),) * 13_099), 38 + 5 * 13_099),
        (SendDummyDataRequest(bytes(65_535)), 65_535),
    ],
)
def test_as_much_as_a_frame_holds_is_written(packet: Packet, size: int) -> None:
    assert len(encode(packet)) == size


def test_lists_and_integers_of_other_types_are_taken() -> None:
    class Number:
        def __index__(self) -> int:
            return 7

    steps: Any = [Step(Number(), 2, 3)]  # type: ignore[arg-type]
    assert encode(ExecuteActionRequest(steps)) == bytes.fromhex("01 07 0200 0300")
    assert encode(SendDummyDataRequest(bytearray(b"ab"))) == b"ab"  # type: ignore[arg-type]


def decode(declared: type[Packet], content: str) -> Packet:
    return layout(declared, "little").decode(bytes.fromhex(content), "utf-8")


@pytest.mark.parametrize(
    ("declared", "content", "fault"),
    [
        (QueryServoRequest, "", "QueryServoRequest: the content has 0 bytes, not 1"),
        (QueryServoRequest, "0102", "QueryServoRequest: the content has 2 bytes, not 1"),
        (QueryMemorySizeResponse, "010203", "QueryMemorySizeResponse: the content has 3 bytes, not 4 + n * 4"),
        (QueryActionListResponse, "01", "QueryActionListResponse: the content has 1 bytes, not 2 + n * 36"),
        (AddActionRequest, "0100", "AddActionRequest: the content has 2 bytes, not 38 + n * 5"),
        (AddActionRequest, "00" * 36 + "0100", "AddActionRequest: 1 steps take 43 bytes, the content has 38"),
        (ExecuteActionRequest, "02 0102000300", "ExecuteActionRequest: 2 steps take 11 bytes, the content has 6"),
        (ExecuteActionRequest, "00 0102000300", "ExecuteActionRequest: 0 steps take 1 bytes, the content has 6"),
    ],
)
def test_a_content_that_lies_about_its_length_is_refused_with_its_bytes(
    declared: type[Packet], content: str, fault: str
) -> None:
    with pytest.raises(DecodeError) as refused:
        decode(declared, content)
    assert str(refused.value) == fault
    assert refused.value.data == bytes.fromhex(content)


def test_memory_may_come_without_its_total() -> None:
    assert decode(QueryMemorySizeResponse, "01000000") == QueryMemorySizeResponse(1, None)
    assert decode(QueryMemorySizeResponse, "01000000 02000000") == QueryMemorySizeResponse(1, 2)
    assert encode(QueryMemorySizeResponse(1, None)) == bytes.fromhex("01000000")


def test_what_a_board_sends_is_shown_though_we_would_not_send_it() -> None:
    assert decode(QueryRemainPowerResponse, "ffff") == QueryRemainPowerResponse(-1)


@given(st.integers(0, 20), st.integers(0, 5), st.integers(0, 6), st.integers(0, 60))
def test_a_length_rule_admits_base_and_whole_records_only(base: int, unit: int, limit: int, length: int) -> None:
    lengths = {base + count * unit for count in range(limit + 1)}
    assert LengthRule(base, unit, limit).admits(length) == (length in lengths)


def test_a_layout_is_compiled_once_for_each_byte_order() -> None:
    assert layout(QueryServoRequest, "little") is layout(QueryServoRequest, "little")
    assert layout(QueryServoRequest, "little") is not layout(QueryServoRequest, "big")


class NoWire(Command, frozen=True):
    """A field without a wire form."""

    packet_id: ClassVar[int] = 1
    number: int


class LastCaption(Command, frozen=True):
    """A kind of content that no packet of the document has."""

    packet_id: ClassVar[int] = 3
    caption: Caption


class NumberAndBytes(Command, frozen=True):
    """Another one."""

    packet_id: ClassVar[int] = 5
    number: fields.U8
    data: fields.Data


@pytest.mark.parametrize(
    ("declared", "fault"),
    [
        (NoWire, "has no wire form"),
        (LastCaption, "captions are supported only in records and before a group"),
        (NumberAndBytes, "data is supported only as the only field"),
    ],
)
def test_a_declaration_that_cannot_be_laid_out_is_refused_at_once(declared: type[Packet], fault: str) -> None:
    with pytest.raises(TypeError, match=fault):
        layout(declared, "little")


@pytest.mark.parametrize(
    ("field", "low", "high"),
    [
        (fields.U8, 0, 255),
        (fields.U32, 0, 2**32 - 1),
        (fields.I16, -(2**15), 2**15 - 1),
        (fields.I32, -(2**31), 2**31 - 1),
        (fields.Flag, 0, 1),
        (fields.CommandType, 0, 2),
        (fields.Percent, 1, 100),
        (fields.Natural16, 0, 2**15 - 1),
        (fields.Natural32, 0, 2**31 - 1),
    ],
)
def test_a_field_type_has_its_range_for_msgspec_as_well(field: Any, low: int, high: int) -> None:
    assert [msgspec.convert(value, field) for value in (low, high)] == [low, high]
    for value in (low - 1, high + 1):
        with pytest.raises(msgspec.ValidationError):
            msgspec.convert(value, field)


def test_a_description_on_a_field_keeps_its_range() -> None:
    class Described(Command, frozen=True):
        packet_id: ClassVar[int] = 4
        flag: Annotated[fields.Flag, Meta(description="on or off")]

    with pytest.raises(EncodeError, match=r"flag: 2 is outside 0\.\.1"):
        encode(Described(2))
