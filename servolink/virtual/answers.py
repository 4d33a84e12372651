"""What the board answers: one small function for each packet that a host can send.

An answer is a packet, the bare content of one (for records, which are kept as the bytes that came), or None.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import msgspec

from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.frame import MAX_CONTENT
from servolink.protocol.packet import Packet
from servolink.protocol.servos import ALL_SERVOS
from servolink.virtual.player import DELAY
from servolink.virtual.servo import Servo
from servolink.virtual.storage import Kind

if TYPE_CHECKING:
    from servolink.virtual.board import Session, VirtualBoard

Answer = Packet | bytes | None
P = TypeVar("P", bound=Packet)
Handler = Callable[["Session", P, bytes, float], Answer]

ANSWERS: dict[type[Packet], Handler[Any]] = {}
"""The function that answers each packet class, called with session, packet, its content and the time."""

_LISTED = 36  # a record's id and caption, which is also its entry in the list of records
_MOST_LISTED = (MAX_CONTENT - 2) // _LISTED
_PARAMETER = 35


def answers(declared: type[P]) -> Callable[[Handler[P]], Handler[P]]:
    """Make the decorated function the one that answers `declared`."""

    def register(handler: Handler[P]) -> Handler[P]:
        ANSWERS[declared] = handler
        return handler

    return register


def in_range(packet: Packet) -> bool:
    """Tell whether all values of `packet` are allowed by its declaration; decoding lets everything pass."""
    try:
        msgspec.convert(msgspec.to_builtins(packet), type(packet))
    except msgspec.ValidationError:
        return False
    return True


# ── settings, 3.1 ──


@answers(settings.TransmissionModeSettingRequest)
def _set_mode(session: Session, request: settings.TransmissionModeSettingRequest, content: bytes, now: float) -> Answer:
    if in_range(request):
        session.board.mode = request.mode
    return settings.TransmissionModeSettingResponse(session.board.mode)


@answers(settings.ClearAllDataRequest)
def _clear(session: Session, request: settings.ClearAllDataRequest, content: bytes, now: float) -> Answer:
    session.board.player.stop()
    session.board.storage.clear()
    return settings.ClearAllDataResponse(1)


@answers(settings.QueryMemorySizeRequest)
def _memory(session: Session, request: settings.QueryMemorySizeRequest, content: bytes, now: float) -> Answer:
    storage = session.board.storage
    return settings.QueryMemorySizeResponse(storage.free, storage.memory)


@answers(settings.QueryRemainPowerRequest)
def _power(session: Session, request: settings.QueryRemainPowerRequest, content: bytes, now: float) -> Answer:
    return settings.QueryRemainPowerResponse(round(session.board.battery))


@answers(settings.SendDummyDataRequest)
def _dummy(session: Session, request: settings.SendDummyDataRequest, content: bytes, now: float) -> Answer:
    return None


# ── servos, 3.2 ──


@answers(servos.QueryServoListRequest)
def _servo_list(session: Session, request: servos.QueryServoListRequest, content: bytes, now: float) -> Answer:
    return servos.QueryServoListResponse(tuple(session.board.servos))


@answers(servos.QueryServoRequest)
def _servo(session: Session, request: servos.QueryServoRequest, content: bytes, now: float) -> Answer:
    return servos.QueryServoResponse(tuple(servo.state() for servo in _addressed(session, request.servo_id)))


@answers(servos.SetServoParameterRequest)
def _set_servo(session: Session, request: servos.SetServoParameterRequest, content: bytes, now: float) -> Answer:
    addressed = _addressed(session, request.servo_id)
    if not addressed or not in_range(request):
        # Servo 0 may be what was asked for, so the flags differ too.
        return servos.SetServoParameterResponse(0, int(not request.is_start), int(not request.is_hold))
    if request.servo_id == ALL_SERVOS and not request.is_start:
        session.board.player.stop()
    for servo in addressed:
        servo.set_flags(request.is_start, request.is_hold, now)
    return servos.SetServoParameterResponse(request.servo_id, request.is_start, request.is_hold)


@answers(servos.SetAngleUnitRequest)
def _set_unit(session: Session, request: servos.SetAngleUnitRequest, content: bytes, now: float) -> Answer:
    addressed = _addressed(session, request.servo_id)
    if not addressed or not in_range(request):
        return servos.SetAngleUnitResponse(0, int(not request.unit_type))
    for servo in addressed:
        servo.unit = request.unit_type
    return servos.SetAngleUnitResponse(request.servo_id, request.unit_type)


@answers(servos.ExecuteActionRequest)
def _move(session: Session, request: servos.ExecuteActionRequest, content: bytes, now: float) -> Answer:
    if in_range(request):
        session.board.player.move(request.steps, now)
    return None


@answers(servos.ExecuteActionExRequest)
def _run_action(session: Session, request: servos.ExecuteActionExRequest, content: bytes, now: float) -> Answer:
    session.board.player.run_action(request.action_id, now)
    return None


# ── editing, 3.3 ──


@answers(editing.QueryActionListRequest)
def _action_list(session: Session, request: editing.QueryActionListRequest, content: bytes, now: float) -> Answer:
    return _list(session, Kind.ACTION)


@answers(editing.QueryActionRequest)
def _action(session: Session, request: editing.QueryActionRequest, content: bytes, now: float) -> Answer:
    return session.board.storage.get(Kind.ACTION, request.action_id) or editing.QueryActionResponse(0)


@answers(editing.AddActionRequest)
def _add_action(session: Session, request: editing.AddActionRequest, content: bytes, now: float) -> Answer:
    return editing.AddActionResponse(_add(session, Kind.ACTION, request, request.action_id, content))


@answers(editing.DeleteActionRequest)
def _delete_action(session: Session, request: editing.DeleteActionRequest, content: bytes, now: float) -> Answer:
    return editing.DeleteActionResponse(session.board.storage.delete(Kind.ACTION, request.action_id))


@answers(editing.QueryMacroListRequest)
def _macro_list(session: Session, request: editing.QueryMacroListRequest, content: bytes, now: float) -> Answer:
    return _list(session, Kind.MACRO)


@answers(editing.QueryMacroRequest)
def _macro(session: Session, request: editing.QueryMacroRequest, content: bytes, now: float) -> Answer:
    return session.board.storage.get(Kind.MACRO, request.macro_id) or editing.QueryMacroResponse(0)


@answers(editing.AddMacroRequest)
def _add_macro(session: Session, request: editing.AddMacroRequest, content: bytes, now: float) -> Answer:
    if any(command.type == DELAY and command.command_id < 0 for command in request.commands):
        return editing.AddMacroResponse(0)
    return editing.AddMacroResponse(_add(session, Kind.MACRO, request, request.macro_id, content))


@answers(editing.DeleteMacroRequest)
def _delete_macro(session: Session, request: editing.DeleteMacroRequest, content: bytes, now: float) -> Answer:
    return editing.DeleteMacroResponse(session.board.storage.delete(Kind.MACRO, request.macro_id))


@answers(editing.ExecuteMacroRequest)
def _run_macro(session: Session, request: editing.ExecuteMacroRequest, content: bytes, now: float) -> Answer:
    return editing.ExecuteMacroResponse(session.board.player.run_macro(request.macro_id, now))


@answers(editing.QueryServoParameterRequest)
def _parameters(session: Session, request: editing.QueryServoParameterRequest, content: bytes, now: float) -> Answer:
    records = session.board.storage.all(Kind.SERVO).values()
    return _count(session, len(records)) + b"".join(records)


@answers(editing.AddServoParameterRequest)
def _add_parameters(session: Session, request: editing.AddServoParameterRequest, content: bytes, now: float) -> Answer:
    ids = [servo.servo_id for servo in request.servos]
    cut = [content[at : at + _PARAMETER] for at in range(2, len(content), _PARAMETER)]
    known = all(servo_id in session.board.servos for servo_id in ids)
    stored = known and in_range(request) and session.board.storage.put(Kind.SERVO, dict(zip(ids, cut, strict=True)))
    return editing.AddServoParameterResponse(stored)


@answers(editing.WriteProjectIDRequest)
def _write_project(session: Session, request: editing.WriteProjectIDRequest, content: bytes, now: float) -> Answer:
    session.board.storage.project_id = request.project_id
    return editing.WriteProjectIDResponse(1)


@answers(editing.QueryProjectIDRequest)
def _project(session: Session, request: editing.QueryProjectIDRequest, content: bytes, now: float) -> Answer:
    return editing.QueryProjectIDResponse(session.board.storage.project_id)


# ── remote control, 3.4 ──


@answers(joystick.QueryJoystickTableListRequest)
def _table_list(
    session: Session, request: joystick.QueryJoystickTableListRequest, content: bytes, now: float
) -> Answer:
    return _list(session, Kind.TABLE)


@answers(joystick.QueryJoystickTableRequest)
def _table(session: Session, request: joystick.QueryJoystickTableRequest, content: bytes, now: float) -> Answer:
    return session.board.storage.get(Kind.TABLE, request.table_id) or joystick.QueryJoystickTableResponse(0)


@answers(joystick.AddJoystickTableRequest)
def _add_table(session: Session, request: joystick.AddJoystickTableRequest, content: bytes, now: float) -> Answer:
    return joystick.AddJoystickTableResponse(_add(session, Kind.TABLE, request, request.table_id, content))


@answers(joystick.DeleteJoystickTableRequest)
def _delete_table(session: Session, request: joystick.DeleteJoystickTableRequest, content: bytes, now: float) -> Answer:
    return joystick.DeleteJoystickTableResponse(session.board.storage.delete(Kind.TABLE, request.table_id))


@answers(joystick.SetActiveJoystickTableRequest)
def _activate(session: Session, request: joystick.SetActiveJoystickTableRequest, content: bytes, now: float) -> Answer:
    return joystick.SetActiveJoystickTableResponse(session.board.storage.activate(request.table_id))


@answers(joystick.QueryActiveJoystickTableRequest)
def _active(session: Session, request: joystick.QueryActiveJoystickTableRequest, content: bytes, now: float) -> Answer:
    return joystick.QueryActiveJoystickTableResponse(session.board.storage.active_table)


@answers(joystick.SubscribeButtonEventRequest)
def _subscribe(session: Session, request: joystick.SubscribeButtonEventRequest, content: bytes, now: float) -> Answer:
    if not in_range(request):
        return joystick.SubscribeButtonEventResponse(0)
    session.subscribed = bool(request.subscribe)
    return joystick.SubscribeButtonEventResponse(1)


def _addressed(session: Session, servo_id: int) -> list[Servo]:
    """Return the servos that `servo_id` means: all, one or none."""
    servos_by_id = session.board.servos
    if servo_id == ALL_SERVOS:
        return list(servos_by_id.values())
    return [servos_by_id[servo_id]] if servo_id in servos_by_id else []


def _add(session: Session, kind: Kind, request: Packet, record_id: int, content: bytes) -> bool:
    return in_range(request) and session.board.storage.put(kind, {record_id: content})


def _list(session: Session, kind: Kind) -> bytes:
    """Return the content of a list answer; records beyond what a frame can hold are not listed."""
    entries = [record[:_LISTED] for record in session.board.storage.all(kind).values()][:_MOST_LISTED]
    return _count(session, len(entries)) + b"".join(entries)


def _count(session: Session, count: int) -> bytes:
    return count.to_bytes(2, session.board.codec.byte_order)
