"""What the board answers: one small function for each packet that a host can send.

An answer is a packet, the bare content of one (for records, which are kept as the bytes that came), or None.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.codec import in_range
from servolink.protocol.frame import MAX_CONTENT
from servolink.protocol.packet import Packet
from servolink.protocol.servos import ALL_SERVOS
from servolink.virtual.hardware import Hardware
from servolink.virtual.player import playable
from servolink.virtual.servo import Servo
from servolink.virtual.storage import Kind

Response = Packet | bytes | None
P = TypeVar("P", bound=Packet)


class Host(Protocol):
    """The host that sent a request."""

    subscribed: bool
    """Whether button events are sent to it."""


@dataclass(frozen=True, slots=True)
class RequestContext(Generic[P]):
    """A request with everything that its response may depend on."""

    hardware: Hardware
    host: Host
    request: P
    content: bytes
    """The request's content as it was received."""
    now: float


Handler = Callable[[RequestContext[P]], Response]

HANDLERS: dict[type[Packet], Handler[Any]] = {}
"""The function that answers each packet class."""

_LISTED = 36  # a record's id and caption, which is also its entry in the list of records
_MOST_LISTED = (MAX_CONTENT - 2) // _LISTED
_PARAMETER = 35


def handles(declared: type[P]) -> Callable[[Handler[P]], Handler[P]]:
    """Make the decorated function the one that answers `declared`."""

    def register(handler: Handler[P]) -> Handler[P]:
        HANDLERS[declared] = handler
        return handler

    return register


# ── settings, 3.1 ──


@handles(settings.TransmissionModeSettingRequest)
def _set_mode(context: RequestContext[settings.TransmissionModeSettingRequest]) -> Response:
    if in_range(context.request):
        context.hardware.mode = context.request.mode
    return settings.TransmissionModeSettingResponse(context.hardware.mode)


@handles(settings.ClearAllDataRequest)
def _clear(context: RequestContext[settings.ClearAllDataRequest]) -> Response:
    context.hardware.player.stop()
    context.hardware.storage.clear()
    return settings.ClearAllDataResponse(1)


@handles(settings.QueryMemorySizeRequest)
def _memory(context: RequestContext[settings.QueryMemorySizeRequest]) -> Response:
    storage = context.hardware.storage
    return settings.QueryMemorySizeResponse(storage.free, storage.memory)


@handles(settings.QueryRemainPowerRequest)
def _power(context: RequestContext[settings.QueryRemainPowerRequest]) -> Response:
    return settings.QueryRemainPowerResponse(round(context.hardware.battery))


@handles(settings.SendDummyDataRequest)
def _dummy(context: RequestContext[settings.SendDummyDataRequest]) -> Response:
    return None


# ── servos, 3.2 ──


@handles(servos.QueryServoListRequest)
def _servo_list(context: RequestContext[servos.QueryServoListRequest]) -> Response:
    return servos.QueryServoListResponse(tuple(context.hardware.servos))


@handles(servos.QueryServoRequest)
def _servo(context: RequestContext[servos.QueryServoRequest]) -> Response:
    return servos.QueryServoResponse(
        tuple(servo.state() for servo in _addressed(context.hardware, context.request.servo_id))
    )


@handles(servos.SetServoParameterRequest)
def _set_servo(context: RequestContext[servos.SetServoParameterRequest]) -> Response:
    addressed = _addressed(context.hardware, context.request.servo_id)
    if not addressed or not in_range(context.request):
        # Servo 0 may be what was asked for, so the flags differ too.
        return servos.SetServoParameterResponse(0, int(not context.request.is_start), int(not context.request.is_hold))
    if context.request.servo_id == ALL_SERVOS and not context.request.is_start:
        context.hardware.player.stop()
    for servo in addressed:
        servo.set_flags(context.request.is_start, context.request.is_hold, context.now)
    return servos.SetServoParameterResponse(context.request.servo_id, context.request.is_start, context.request.is_hold)


@handles(servos.SetAngleUnitRequest)
def _set_unit(context: RequestContext[servos.SetAngleUnitRequest]) -> Response:
    addressed = _addressed(context.hardware, context.request.servo_id)
    if not addressed or not in_range(context.request):
        return servos.SetAngleUnitResponse(0, int(not context.request.unit_type))
    for servo in addressed:
        servo.unit = context.request.unit_type
    return servos.SetAngleUnitResponse(context.request.servo_id, context.request.unit_type)


@handles(servos.ExecuteActionRequest)
def _move(context: RequestContext[servos.ExecuteActionRequest]) -> Response:
    if in_range(context.request):
        context.hardware.player.move(context.request.steps, context.now)
    return None


@handles(servos.ExecuteActionExRequest)
def _run_action(context: RequestContext[servos.ExecuteActionExRequest]) -> Response:
    context.hardware.player.run_action(context.request.action_id, context.now)
    return None


# ── editing, 3.3 ──


@handles(editing.QueryActionListRequest)
def _action_list(context: RequestContext[editing.QueryActionListRequest]) -> Response:
    return _list(context.hardware, Kind.ACTION)


@handles(editing.QueryActionRequest)
def _action(context: RequestContext[editing.QueryActionRequest]) -> Response:
    return context.hardware.storage.get(Kind.ACTION, context.request.action_id) or editing.QueryActionResponse(0)


@handles(editing.AddActionRequest)
def _add_action(context: RequestContext[editing.AddActionRequest]) -> Response:
    return editing.AddActionResponse(_add(context, Kind.ACTION, context.request.action_id))


@handles(editing.DeleteActionRequest)
def _delete_action(context: RequestContext[editing.DeleteActionRequest]) -> Response:
    return editing.DeleteActionResponse(context.hardware.storage.delete(Kind.ACTION, context.request.action_id))


@handles(editing.QueryMacroListRequest)
def _macro_list(context: RequestContext[editing.QueryMacroListRequest]) -> Response:
    return _list(context.hardware, Kind.MACRO)


@handles(editing.QueryMacroRequest)
def _macro(context: RequestContext[editing.QueryMacroRequest]) -> Response:
    return context.hardware.storage.get(Kind.MACRO, context.request.macro_id) or editing.QueryMacroResponse(0)


@handles(editing.AddMacroRequest)
def _add_macro(context: RequestContext[editing.AddMacroRequest]) -> Response:
    added = playable(context.request) and context.hardware.storage.put(
        Kind.MACRO, {context.request.macro_id: context.content}
    )
    return editing.AddMacroResponse(added)


@handles(editing.DeleteMacroRequest)
def _delete_macro(context: RequestContext[editing.DeleteMacroRequest]) -> Response:
    return editing.DeleteMacroResponse(context.hardware.storage.delete(Kind.MACRO, context.request.macro_id))


@handles(editing.ExecuteMacroRequest)
def _run_macro(context: RequestContext[editing.ExecuteMacroRequest]) -> Response:
    return editing.ExecuteMacroResponse(context.hardware.player.run_macro(context.request.macro_id, context.now))


@handles(editing.QueryServoParameterRequest)
def _parameters(context: RequestContext[editing.QueryServoParameterRequest]) -> Response:
    records = [record for _, record in context.hardware.storage.all(Kind.SERVO)]
    return _count(context.hardware, len(records)) + b"".join(records)


@handles(editing.AddServoParameterRequest)
def _add_parameters(context: RequestContext[editing.AddServoParameterRequest]) -> Response:
    parameters = cut_parameters(context.request, context.content)
    known = parameters.keys() <= context.hardware.servos.keys()
    stored = known and in_range(context.request) and context.hardware.storage.put(Kind.SERVO, parameters)
    return editing.AddServoParameterResponse(stored)


@handles(editing.WriteProjectIDRequest)
def _write_project(context: RequestContext[editing.WriteProjectIDRequest]) -> Response:
    context.hardware.storage.project_id = context.request.project_id
    return editing.WriteProjectIDResponse(1)


@handles(editing.QueryProjectIDRequest)
def _project(context: RequestContext[editing.QueryProjectIDRequest]) -> Response:
    return editing.QueryProjectIDResponse(context.hardware.storage.project_id)


# ── remote control, 3.4 ──


@handles(joystick.QueryJoystickTableListRequest)
def _table_list(context: RequestContext[joystick.QueryJoystickTableListRequest]) -> Response:
    return _list(context.hardware, Kind.TABLE)


@handles(joystick.QueryJoystickTableRequest)
def _table(context: RequestContext[joystick.QueryJoystickTableRequest]) -> Response:
    return context.hardware.storage.get(Kind.TABLE, context.request.table_id) or joystick.QueryJoystickTableResponse(0)


@handles(joystick.AddJoystickTableRequest)
def _add_table(context: RequestContext[joystick.AddJoystickTableRequest]) -> Response:
    return joystick.AddJoystickTableResponse(_add(context, Kind.TABLE, context.request.table_id))


@handles(joystick.DeleteJoystickTableRequest)
def _delete_table(context: RequestContext[joystick.DeleteJoystickTableRequest]) -> Response:
    return joystick.DeleteJoystickTableResponse(context.hardware.storage.delete(Kind.TABLE, context.request.table_id))


@handles(joystick.SetActiveJoystickTableRequest)
def _activate(context: RequestContext[joystick.SetActiveJoystickTableRequest]) -> Response:
    return joystick.SetActiveJoystickTableResponse(context.hardware.storage.activate(context.request.table_id))


@handles(joystick.QueryActiveJoystickTableRequest)
def _active(context: RequestContext[joystick.QueryActiveJoystickTableRequest]) -> Response:
    return joystick.QueryActiveJoystickTableResponse(context.hardware.storage.active_table)


@handles(joystick.SubscribeButtonEventRequest)
def _subscribe(context: RequestContext[joystick.SubscribeButtonEventRequest]) -> Response:
    if not in_range(context.request):
        return joystick.SubscribeButtonEventResponse(0)
    context.host.subscribed = bool(context.request.subscribe)
    return joystick.SubscribeButtonEventResponse(1)


def cut_parameters(request: editing.AddServoParameterRequest, content: bytes) -> dict[int, bytes]:
    """Return the record of each servo in the content of `request`; the last one counts."""
    cut = [content[at : at + _PARAMETER] for at in range(2, len(content), _PARAMETER)]
    return dict(zip([servo.servo_id for servo in request.servos], cut, strict=True))


def _addressed(hardware: Hardware, servo_id: int) -> list[Servo]:
    """Return the servos that `servo_id` means: all, one or none."""
    servos_by_id = hardware.servos
    if servo_id == ALL_SERVOS:
        return list(servos_by_id.values())
    return [servos_by_id[servo_id]] if servo_id in servos_by_id else []


def _add(context: RequestContext[Any], kind: Kind, record_id: int) -> bool:
    return in_range(context.request) and context.hardware.storage.put(kind, {record_id: context.content})


def _list(hardware: Hardware, kind: Kind) -> bytes:
    """Return the content of a list answer; records beyond what a frame can hold are not listed."""
    entries = [record[:_LISTED] for _, record in hardware.storage.all(kind)[:_MOST_LISTED]]
    return _count(hardware, len(entries)) + b"".join(entries)


def _count(hardware: Hardware, count: int) -> bytes:
    return count.to_bytes(2, hardware.codec.byte_order)
