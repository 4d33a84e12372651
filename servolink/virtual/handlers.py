"""Handlers of requests on the board, by chapters of the document.

A handler returns the response packet; or only the content of the response, for records stored as bytes; or whether the
request was executed, for a response with no other content; or None for a request without a response.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Generic, Protocol, TypeVar

from msgspec import Struct

from servolink.protocol import (
    ALL_SERVOS,
    PACKETS,
    RECORD_TYPES,
    SERVO_PARAMETER,
    AddServoParameterRequest,
    ClearAllDataRequest,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    QueryActiveJoystickTableRequest,
    QueryActiveJoystickTableResponse,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoParameterRequest,
    QueryServoRequest,
    QueryServoResponse,
    RecordType,
    SendDummyDataRequest,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    SetServoParameterRequest,
    SetServoParameterResponse,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
    WriteProjectIDRequest,
    layout,
)
from servolink.virtual.hardware import Hardware
from servolink.virtual.player import is_playable
from servolink.virtual.simulated_servo import SimulatedServo
from servolink.virtual.storage import servo_parameters

Response = Packet | bytes | bool | None
P = TypeVar("P", bound=Packet)


class Host(Protocol):
    """Host with a request."""

    subscribed: bool
    """Whether the host receives button events."""


class RequestContext(Struct, Generic[P], frozen=True):
    """Request with its host and board, for a handler."""

    hardware: Hardware
    host: Host
    request: P
    content: bytes
    """Content of the request, as received."""
    now: float


Handler = Callable[[RequestContext[P]], Response]

HANDLERS: dict[type[Packet], Handler[Any]] = {}
"""Handler of each packet class."""


def handles(declared: type[P]) -> Callable[[Handler[P]], Handler[P]]:
    """Register the decorated function as the handler of `declared`."""

    def register(handler: Handler[P]) -> Handler[P]:
        HANDLERS[declared] = handler
        return handler

    return register


# ── settings, 3.1 ──


@handles(TransmissionModeSettingRequest)
def _set_mode(context: RequestContext[TransmissionModeSettingRequest]) -> Response:
    if context.request.is_in_range():
        context.hardware.mode = context.request.mode
    return TransmissionModeSettingResponse(context.hardware.mode)


@handles(ClearAllDataRequest)
def _clear(context: RequestContext[ClearAllDataRequest]) -> Response:
    context.hardware.player.stop()
    context.hardware.storage.clear()
    return True


@handles(QueryMemorySizeRequest)
def _memory(context: RequestContext[QueryMemorySizeRequest]) -> Response:
    storage, kind = context.hardware.storage, context.hardware.kind
    total = kind.memory_reported * kind.memory_unit or storage.memory
    free = max(0, total - storage.used)
    return QueryMemorySizeResponse(free // kind.memory_unit, total // kind.memory_unit)


@handles(QueryRemainPowerRequest)
def _power(context: RequestContext[QueryRemainPowerRequest]) -> Response:
    return QueryRemainPowerResponse(round(context.hardware.battery))


@handles(SendDummyDataRequest)
def _dummy(context: RequestContext[SendDummyDataRequest]) -> Response:
    return None


# ── servos, 3.2 ──


@handles(QueryServoListRequest)
def _servo_list(context: RequestContext[QueryServoListRequest]) -> Response:
    return QueryServoListResponse(tuple(context.hardware.servos))


@handles(QueryServoRequest)
def _servo(context: RequestContext[QueryServoRequest]) -> Response:
    servo_id = context.request.servo_id
    addressed = _addressed(context.hardware, servo_id)
    if not addressed and servo_id != ALL_SERVOS and _is_silent(context):
        return None
    return QueryServoResponse(tuple([servo.state() for servo in addressed]))


@handles(SetServoParameterRequest)
def _set_flags(context: RequestContext[SetServoParameterRequest]) -> Response:
    request, addressed = context.request, _addressed(context.hardware, context.request.servo_id)
    if not addressed or not request.is_in_range():
        # The flags of servo 0 must differ as well: a query may address servo 0.
        return SetServoParameterResponse(0, int(not request.is_start), int(not request.is_hold))
    if request.servo_id == ALL_SERVOS and not request.is_start:
        context.hardware.player.stop()
    for servo in addressed:
        servo.set_flags(request.is_start, request.is_hold, context.now)
    return SetServoParameterResponse(request.servo_id, request.is_start, request.is_hold)


@handles(SetAngleUnitRequest)
def _set_unit(context: RequestContext[SetAngleUnitRequest]) -> Response:
    request, addressed = context.request, _addressed(context.hardware, context.request.servo_id)
    if not addressed or not request.is_in_range():
        return SetAngleUnitResponse(0, int(not request.unit_type))
    for servo in addressed:
        servo.unit = request.unit_type
    return SetAngleUnitResponse(request.servo_id, request.unit_type)


@handles(ExecuteActionRequest)
def _move(context: RequestContext[ExecuteActionRequest]) -> Response:
    if context.request.is_in_range():
        context.hardware.player.move(context.request.steps, context.now)
    return None


@handles(ExecuteActionExRequest)
def _run_action(context: RequestContext[ExecuteActionExRequest]) -> Response:
    context.hardware.player.run_action(context.request.action_id, context.now)
    return None


def _is_silent(context: RequestContext[Any]) -> bool:
    """Return whether the board ignores queries of unknown ids."""
    return context.hardware.kind.unknown_ids == "silent"


def _addressed(hardware: Hardware, servo_id: int) -> list[SimulatedServo]:
    """Return the servos addressed by an id: all for 255, otherwise at most one."""
    if servo_id == ALL_SERVOS:
        return list(hardware.servos.values())
    return [hardware.servos[servo_id]] if servo_id in hardware.servos else []


# ── stored records, 3.3 and 3.4: one set of handlers for actions, macros and joystick tables ──


def _handle_records(record_type: RecordType[Any]) -> None:
    not_found = bytes(
        layout(PACKETS.response_of(record_type.query(0)), "little").size()
    )  # all zeros: id 0, empty caption, no parts

    @handles(type(record_type.list_request))
    def list_all(context: RequestContext[Any]) -> Response:
        return _group(context, context.hardware.storage.all(record_type))

    @handles(record_type.query_class)
    def query(context: RequestContext[Any]) -> Response:
        record = context.hardware.storage.get(record_type, record_type.id_of(context.request))
        return record or (None if _is_silent(context) else not_found)

    @handles(record_type.add_class)
    def add(context: RequestContext[Any]) -> Response:
        records = {record_type.id_of(context.request): context.content}
        return is_playable(context.request) and context.hardware.storage.put(record_type, records)

    @handles(record_type.delete_class)
    def delete(context: RequestContext[Any]) -> Response:
        return context.hardware.storage.delete(record_type, record_type.id_of(context.request))


for _record_type in RECORD_TYPES:
    _handle_records(_record_type)


def _group(context: RequestContext[Any], records: Iterable[tuple[int, bytes]]) -> bytes:
    """Return the content of a response with a counted group of records; records beyond a full frame are left out.

    An entry in a list is the beginning of the record: id and caption.
    """
    order = context.hardware.codec.byte_order
    rule = layout(PACKETS.response_of(context.request), order).rule
    entries = [record[: rule.unit] for _, record in records][: rule.limit]
    return len(entries).to_bytes(rule.base, order) + b"".join(entries)


# ── editing, 3.3 ──


@handles(ExecuteMacroRequest)
def _run_macro(context: RequestContext[ExecuteMacroRequest]) -> Response:
    return context.hardware.player.run_macro(context.request.macro_id, context.now)


@handles(QueryServoParameterRequest)
def _servo_parameters(context: RequestContext[QueryServoParameterRequest]) -> Response:
    return _group(context, context.hardware.storage.all(SERVO_PARAMETER))


@handles(AddServoParameterRequest)
def _add_servo_parameters(context: RequestContext[AddServoParameterRequest]) -> Response:
    parameters = servo_parameters(context.request, context.content)
    valid = parameters.keys() <= context.hardware.servos.keys() and context.request.is_in_range()
    return valid and context.hardware.storage.put(SERVO_PARAMETER, parameters)


@handles(WriteProjectIDRequest)
def _write_project_id(context: RequestContext[WriteProjectIDRequest]) -> Response:
    context.hardware.storage.project_id = context.request.project_id
    return True


@handles(QueryProjectIDRequest)
def _project_id(context: RequestContext[QueryProjectIDRequest]) -> Response:
    return QueryProjectIDResponse(context.hardware.storage.project_id)


# ── remote control, 3.4 ──


@handles(SetActiveJoystickTableRequest)
def _activate(context: RequestContext[SetActiveJoystickTableRequest]) -> Response:
    return context.hardware.storage.activate(context.request.table_id)


@handles(QueryActiveJoystickTableRequest)
def _active(context: RequestContext[QueryActiveJoystickTableRequest]) -> Response:
    return QueryActiveJoystickTableResponse(context.hardware.storage.active_table)


@handles(SubscribeButtonEventRequest)
def _subscribe(context: RequestContext[SubscribeButtonEventRequest]) -> Response:
    if not context.request.is_in_range():
        return False
    context.host.subscribed = bool(context.request.subscribe)
    return True
