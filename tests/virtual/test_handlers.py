"""Every request of the document, and its answer, failures included."""

from __future__ import annotations

import struct

import pytest

from servolink.protocol import (
    MAGIC,
    OVERHEAD,
    PACKETS,
    ActionEntry,
    AddActionRequest,
    AddJoystickTableRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    Button,
    ByteOrder,
    ClearAllDataRequest,
    Codec,
    Command,
    DeleteActionRequest,
    DeleteJoystickTableRequest,
    DeleteMacroRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    JoystickTableEntry,
    MacroCommand,
    MacroEntry,
    Packet,
    QueryActionListRequest,
    QueryActionRequest,
    QueryActiveJoystickTableRequest,
    QueryJoystickTableListRequest,
    QueryJoystickTableRequest,
    QueryJoystickTableResponse,
    QueryMacroListRequest,
    QueryMacroRequest,
    QueryMacroResponse,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryProjectIDRequest,
    QueryRemainPowerRequest,
    QueryServoListRequest,
    QueryServoParameterRequest,
    QueryServoRequest,
    Request,
    Response,
    ServoParameter,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
    encode_frame,
)
from servolink.virtual.board import VirtualBoard
from servolink.virtual.handlers import HANDLERS
from servolink.virtual.kind import BoardKind
from tests.tables import over
from tests.virtual.host import START, Host

HOSTILE = b"\x1b[2J" + MAGIC + b"\xff\xfe\0after the end\x80\r\n".ljust(24, b"\x01")


@pytest.fixture(params=["little", "big"])
def host(request: pytest.FixtureRequest) -> Host:
    return Host(VirtualBoard(servos=3, codec=Codec(request.param)))


def raw(host: Host, packet_id: int, content: bytes) -> bytes:
    """Send a content that no honest host can write and return the frame that comes back."""
    heard: list[bytes] = []
    session = host.board.attach(heard.append)
    session.receive(encode_frame(packet_id, content, host.board.codec.byte_order), START)
    session.detach()
    return b"".join(heard)


def pack(host: Host, codes: str, *values: object) -> bytes:
    return struct.pack((">" if host.board.codec.byte_order == "big" else "<") + codes, *values)


def test_every_request_and_command_of_the_document_has_its_function() -> None:
    from_host = {declared for declared in PACKETS.values() if not issubclass(declared, Response)}
    assert set(HANDLERS) == from_host
    assert len(from_host) == 31


@over("declared", [packet for packet in PACKETS.values() if issubclass(packet, Request)])
def test_every_request_is_answered_once_and_with_its_own_response(declared: type[Packet]) -> None:
    host = Host(VirtualBoard())
    groups = ("steps", "commands", "buttons", "servos")
    fields = {
        name: "caption" if name.endswith("caption") else 1 for name in declared.__struct_fields__ if name not in groups
    }
    (answer,) = host.tell(declared(**fields))
    assert answer.packet_id == declared.packet_id + 1


@pytest.mark.parametrize("declared", [packet for packet in PACKETS.values() if issubclass(packet, Command)])
def test_commands_are_not_answered(declared: type[Packet]) -> None:
    fields = {"action_id": 1} if "action_id" in declared.__struct_fields__ else {}
    assert Host(VirtualBoard()).tell(declared(**fields)) == []


# ── settings ──


def test_the_mode_is_echoed_and_the_old_protocol_hears_nothing_but_mode_setting(host: Host) -> None:
    assert host.ask(TransmissionModeSettingRequest(1)).result == 1
    assert host.ask(TransmissionModeSettingRequest(0)).result == 0
    assert host.tell(QueryServoListRequest()) == []
    assert host.ask(TransmissionModeSettingRequest(1)).result == 1
    assert host.ask(QueryServoListRequest()).servo_id_list == (1, 2, 3)


def test_an_unknown_mode_is_answered_with_the_one_in_force(host: Host) -> None:
    assert raw(host, 10010, b"\x07")[-2] == 1


def test_memory_is_counted_to_the_byte(host: Host) -> None:
    empty = host.ask(QueryMemorySizeRequest())
    assert empty.size == empty.total_size == host.board.storage.memory
    host.store_action(1, (1, 90, 100), (2, 90, 100))
    assert host.ask(QueryMemorySizeRequest()).size == empty.size - (38 + 2 * 5)
    host.ask(DeleteActionRequest(1))
    assert host.ask(QueryMemorySizeRequest()) == empty


def test_clearing_forgets_all_that_is_stored(host: Host) -> None:
    host.store_action(1)
    host.store_macro(1)
    host.ask(AddJoystickTableRequest(1))
    host.ask(SetActiveJoystickTableRequest(1))
    host.ask(AddServoParameterRequest((ServoParameter(1),)))
    host.ask(WriteProjectIDRequest(9))
    assert host.ask(ClearAllDataRequest()).result == 1
    assert host.ask(QueryActionListRequest()).actions == ()
    assert host.ask(QueryMacroListRequest()).macros == ()
    assert host.ask(QueryJoystickTableListRequest()).tables == ()
    assert host.ask(QueryActiveJoystickTableRequest()).table_id == 0
    assert host.ask(QueryServoParameterRequest()).servos == ()
    assert host.ask(QueryProjectIDRequest()).project_id == 0


def test_the_battery_drains_with_time_and_faster_with_motion() -> None:
    def after(packet: Packet, hours: float) -> int:
        host = Host(VirtualBoard())
        host.tell(packet)
        return host.ask(QueryRemainPowerRequest(), START + 3600 * hours).permil

    released = SetServoParameterRequest(255, 1, 0)
    moved = ExecuteActionRequest(tuple(Step(servo_id, 180, 32767) for servo_id in range(1, 17)))
    assert after(released, 0) == 1000
    assert after(moved, 0.09) < after(SetServoParameterRequest(255, 1, 1), 0.09) < after(released, 0.09) < 1000
    assert after(released, 1000) == 0


# ── servos ──


def test_states_are_told_of_all_of_one_and_of_none(host: Host) -> None:
    everything = host.ask(QueryServoRequest(255)).servos
    assert [servo.servo_id for servo in everything] == [1, 2, 3]
    assert host.ask(QueryServoRequest(2)).servos == (everything[1],)
    assert host.ask(QueryServoRequest(4)).servos == ()
    assert host.ask(QueryServoRequest(0)).servos == ()


def test_flags_are_set_for_one_and_for_all(host: Host) -> None:
    assert host.ask(SetServoParameterRequest(2, 0, 1)) == SetServoParameterResponse(2, 0, 1)
    flags = [(servo.is_start, servo.is_hold) for servo in host.ask(QueryServoRequest(255)).servos]
    assert flags == [(1, 1), (0, 1), (1, 1)]
    assert host.ask(SetServoParameterRequest(255, 1, 0)) == SetServoParameterResponse(255, 1, 0)
    flags = [(servo.is_start, servo.is_hold) for servo in host.ask(QueryServoRequest(255)).servos]
    assert flags == [(1, 0)] * 3


@pytest.mark.parametrize("servo_id", [0, 4, 254])
@pytest.mark.parametrize("value", [0, 1])
def test_unknown_servos_are_answered_with_0_and_what_was_not_asked(host: Host, servo_id: int, value: int) -> None:
    flags = host.ask(SetServoParameterRequest(servo_id, value, value))
    assert flags == SetServoParameterResponse(0, 1 - value, 1 - value)
    unit = host.ask(SetAngleUnitRequest(servo_id, value))
    assert unit == SetAngleUnitResponse(0, 1 - value)


def test_flags_and_units_out_of_range_change_nothing(host: Host) -> None:
    before = host.ask(QueryServoRequest(255))
    assert raw(host, 20030, b"\x01\x02\x01")[8] == 0
    assert raw(host, 20040, b"\x01\x02")[8] == 0
    assert host.ask(QueryServoRequest(255)) == before


def test_each_servo_has_its_own_unit(host: Host) -> None:
    host.tell(ExecuteActionRequest((Step(1, 90, 0), Step(2, 90, 0))))
    assert host.ask(SetAngleUnitRequest(2, 1)) == SetAngleUnitResponse(2, 1)
    assert (host.angle(1, START), host.angle(2, START)) == (90, 3072)
    host.tell(ExecuteActionRequest((Step(2, 1024, 0),)))
    assert host.ask(SetAngleUnitRequest(255, 0)) == SetAngleUnitResponse(255, 0)
    assert host.angle(2, START) == -90


def test_a_move_with_a_negative_time_is_not_done(host: Host) -> None:
    before = host.angle(1, START)
    assert raw(host, 20050, pack(host, "BBhh", 1, 1, 90, -1)) == b""
    assert host.angle(1, START + 10) == before


# ── editing and remote control ──


def test_records_are_listed_read_replaced_and_deleted(host: Host) -> None:
    host.store_action(5, (1, 10, 20))
    host.store_action(-3)
    host.store_action(5, (2, 30, 40))
    entries = host.ask(QueryActionListRequest()).actions
    assert entries == (ActionEntry(5, "action 5"), ActionEntry(-3, "action -3"))
    assert host.ask(QueryActionRequest(5)).steps == (Step(2, 30, 40),)
    assert host.ask(DeleteActionRequest(5)).result == 1
    assert host.ask(DeleteActionRequest(5)).result == 0
    assert host.ask(QueryActionListRequest()).actions == entries[1:]


def test_a_board_that_appends_lists_an_id_twice_and_gives_and_deletes_the_first() -> None:
    host = Host(VirtualBoard(kind=BoardKind(on_duplicate="append")))
    for caption in ("one", "two"):
        assert host.ask(AddActionRequest(7, caption)).result == 1
    entries = (ActionEntry(7, "one"), ActionEntry(7, "two"))
    assert host.ask(QueryActionListRequest()).actions == entries
    assert host.ask(QueryActionRequest(7)).action_caption == "one"
    assert host.ask(DeleteActionRequest(7)).result == 1
    assert host.ask(QueryActionListRequest()).actions == entries[1:]
    assert host.ask(QueryActionRequest(7)).action_caption == "two"


def test_a_board_that_rejects_keeps_what_it_has() -> None:
    host = Host(VirtualBoard(kind=BoardKind(on_duplicate="reject")))
    results = [host.ask(AddJoystickTableRequest(7, caption)).result for caption in ("one", "two")]
    assert results == [1, 0]
    assert host.ask(QueryJoystickTableListRequest()).tables == (JoystickTableEntry(7, "one"),)


def test_clearing_the_records_ends_the_macro_and_leaves_project_id_and_parameters() -> None:
    host = Host(VirtualBoard(kind=BoardKind(clear="records")))
    host.ask(WriteProjectIDRequest(5))
    parameters = (ServoParameter(1, 2, "hip"),)
    host.ask(AddServoParameterRequest(parameters))
    host.store_macro(1, MacroCommand(100, 1))
    host.ask(ExecuteMacroRequest(1))
    assert host.ask(ClearAllDataRequest()).result == 1
    assert host.board.next_due(START) is None
    assert host.ask(QueryMacroListRequest()).macros == ()
    assert host.ask(QueryProjectIDRequest()).project_id == 5
    assert host.ask(QueryServoParameterRequest()).servos == parameters


def test_what_is_not_there_is_answered_with_id_0_or_result_0(host: Host) -> None:
    assert host.ask(QueryActionRequest(5)).action_id == 0
    assert host.ask(QueryMacroRequest(5)).macro_id == 0
    assert host.ask(QueryJoystickTableRequest(5)).table_id == 0
    assert host.ask(DeleteMacroRequest(5)).result == 0
    assert host.ask(DeleteJoystickTableRequest(5)).result == 0
    assert host.ask(ExecuteMacroRequest(5)).result == 0
    assert host.ask(SetActiveJoystickTableRequest(5)).result == 0


def test_id_0_cannot_be_stored(host: Host) -> None:
    assert host.ask(AddActionRequest(0)).result == 0
    assert host.ask(AddMacroRequest(0)).result == 0
    assert host.ask(AddJoystickTableRequest(0)).result == 0


def test_macros_and_tables_come_back_as_they_were_sent(host: Host) -> None:
    commands = (MacroCommand(1, 2, 50, 3, 9000), MacroCommand(500, 1))
    assert host.ask(AddMacroRequest(8, "walk", commands)).result == 1
    assert host.ask(QueryMacroRequest(8)) == QueryMacroResponse(8, "walk", commands)
    assert host.ask(QueryMacroListRequest()).macros == (MacroEntry(8, "walk"),)
    buttons = (Button(0xFFFF_FFFF, "fire", 1, 2, 3, 1),)
    assert host.ask(AddJoystickTableRequest(9, "pad", buttons)).result == 1
    assert host.ask(QueryJoystickTableRequest(9)) == QueryJoystickTableResponse(9, "pad", buttons)
    assert host.ask(QueryJoystickTableListRequest()).tables == (JoystickTableEntry(9, "pad"),)
    assert host.ask(QueryActiveJoystickTableRequest()).table_id == 9


@pytest.mark.parametrize(
    ("add", "query", "listing", "codes", "last"),
    [
        (30030, 30020, 30010, "i32sHBhh", (1, -5, 32767)),
        (30070, 30060, 30050, "i32sHiBBhi", (5, 1, 50, 2, 0)),
    ],
)
def test_captions_come_back_byte_for_byte(
    host: Host, add: int, query: int, listing: int, codes: str, last: tuple[int, ...]
) -> None:
    order = host.board.codec.byte_order
    content = pack(host, codes, 7, HOSTILE, 1, *last)
    assert raw(host, add, content) == encode_frame(add + 1, b"\x01", order)
    assert raw(host, query, pack(host, "i", 7)) == encode_frame(query + 1, content, order)
    assert raw(host, listing, b"") == encode_frame(listing + 1, pack(host, "Hi32s", 1, 7, HOSTILE), order)


def test_captions_of_tables_and_servos_come_back_byte_for_byte(host: Host) -> None:
    order = host.board.codec.byte_order
    table = pack(host, "i32sHI32siiiB", 7, HOSTILE, 1, 3, HOSTILE, 1, 2, 3, 1)
    assert raw(host, 40030, table) == encode_frame(40031, b"\x01", order)
    assert raw(host, 40020, pack(host, "i", 7)) == encode_frame(40021, table, order)
    parameters = pack(host, "HBh32s", 1, 2, -3, HOSTILE)
    assert raw(host, 30110, parameters) == encode_frame(30111, b"\x01", order)
    assert raw(host, 30100, b"") == encode_frame(30101, parameters, order)


def test_servo_parameters_are_kept_for_each_servo(host: Host) -> None:
    one, two = ServoParameter(1, 5, "hip"), ServoParameter(2, -5, "knee")
    assert host.ask(AddServoParameterRequest((two, one))).result == 1
    better = ServoParameter(2, 0, "knee")
    assert host.ask(AddServoParameterRequest((better,))).result == 1
    assert set(host.ask(QueryServoParameterRequest()).servos) == {one, better}


def test_parameters_of_an_unknown_servo_are_refused_with_the_others(host: Host) -> None:
    parameters = (ServoParameter(1), ServoParameter(4))
    assert host.ask(AddServoParameterRequest(parameters)).result == 0
    assert host.ask(QueryServoParameterRequest()).servos == ()


def test_a_full_memory_refuses_and_keeps_what_it_has() -> None:
    host = Host(VirtualBoard(kind=BoardKind(memory=100)))
    host.store_action(1, (1, 90, 100))
    assert host.ask(AddActionRequest(2, "", (Step(1, 0, 0),) * 5)).result == 0
    assert host.ask(AddMacroRequest(1, "", (MacroCommand(1),) * 2)).result == 0
    assert host.ask(AddJoystickTableRequest(1, "", (Button(1),))).result == 0
    assert host.ask(AddServoParameterRequest((ServoParameter(1), ServoParameter(2)))).result == 0
    assert host.ask(QueryActionRequest(1)).steps == (Step(1, 90, 100),)
    assert host.ask(QueryMemorySizeRequest()) == QueryMemorySizeResponse(57, 100)


def test_the_project_id_is_written_over(host: Host) -> None:
    for project_id in (5, -(2**31)):
        assert host.ask(WriteProjectIDRequest(project_id)).result == 1
        assert host.ask(QueryProjectIDRequest()).project_id == project_id


def test_lists_longer_than_a_frame_show_what_fits() -> None:
    host = Host(VirtualBoard(kind=BoardKind(memory=10**6)))
    for action_id in range(1, 2001):
        host.store_action(action_id)
    listed = host.ask(QueryActionListRequest()).actions
    assert [entry.action_id for entry in listed] == list(range(1, 1821))
    assert host.ask(QueryActionRequest(2000)).action_id == 2000


@pytest.mark.parametrize("byte_order", ["little", "big"])
def test_the_largest_action_that_fits_a_frame_comes_back(byte_order: ByteOrder) -> None:
    host = Host(VirtualBoard(codec=Codec(byte_order), kind=BoardKind(memory=10**6)))
    steps = tuple(Step(at % 256, at, at) for at in range(13099))
    assert host.ask(AddActionRequest(1, "long", steps)).result == 1
    assert host.ask(QueryActionRequest(1)).steps == steps


def test_an_unknown_subscription_is_refused(host: Host) -> None:
    assert raw(host, 40070, b"\x02")[8] == 0
    assert host.ask(SubscribeButtonEventRequest(1)).result == 1
    assert len(raw(host, 40070, b"\x00")) == OVERHEAD + 1
