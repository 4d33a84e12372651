"""What the board answers: one small function for each packet that a host can send.

An answer is a packet, the bare content of one (for records, which are kept as the bytes that came), or None.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.codec import in_range
from servolink.protocol.frame import MAX_CONTENT
from servolink.protocol.packet import Packet
from servolink.protocol.servos import ALL_SERVOS
from servolink.virtual.player import playable
from servolink.virtual.servo import Servo
from servolink.virtual.storage import Kind

if TYPE_CHECKING:
    from servolink.virtual.board import Session, VirtualBoard

Answer = Packet | bytes | None
P = TypeVar("P", bound=Packet)


@dataclass(frozen=True, slots=True)
class Asked(Generic[P]):
    """A packet from a host, with all that an answer may depend on."""

    session: Session
    request: P
    content: bytes
    now: float

    @property
    def board(self) -> VirtualBoard:
        """The board that is asked."""
        return self.session.board


Handler = Callable[[Asked[P]], Answer]

ANSWERS: dict[type[Packet], Handler[Any]] = {}
"""The function that answers each packet class."""

_LISTED = 36  # a record's id and caption, which is also its entry in the list of records
_MOST_LISTED = (MAX_CONTENT - 2) // _LISTED
_PARAMETER = 35


def answers(declared: type[P]) -> Callable[[Handler[P]], Handler[P]]:
    """Make the decorated function the one that answers `declared`."""

    def register(handler: Handler[P]) -> Handler[P]:
        ANSWERS[declared] = handler
        return handler

    return register


# ── settings, 3.1 ──


@answers(settings.TransmissionModeSettingRequest)
def _set_mode(asked: Asked[settings.TransmissionModeSettingRequest]) -> Answer:
    if in_range(asked.request):
        asked.board.mode = asked.request.mode
    return settings.TransmissionModeSettingResponse(asked.board.mode)


@answers(settings.ClearAllDataRequest)
def _clear(asked: Asked[settings.ClearAllDataRequest]) -> Answer:
    asked.board.player.stop()
    asked.board.storage.clear()
    return settings.ClearAllDataResponse(1)


@answers(settings.QueryMemorySizeRequest)
def _memory(asked: Asked[settings.QueryMemorySizeRequest]) -> Answer:
    storage = asked.board.storage
    return settings.QueryMemorySizeResponse(storage.free, storage.memory)


@answers(settings.QueryRemainPowerRequest)
def _power(asked: Asked[settings.QueryRemainPowerRequest]) -> Answer:
    return settings.QueryRemainPowerResponse(round(asked.board.battery))


@answers(settings.SendDummyDataRequest)
def _dummy(asked: Asked[settings.SendDummyDataRequest]) -> Answer:
    return None


# ── servos, 3.2 ──


@answers(servos.QueryServoListRequest)
def _servo_list(asked: Asked[servos.QueryServoListRequest]) -> Answer:
    return servos.QueryServoListResponse(tuple(asked.board.servos))


@answers(servos.QueryServoRequest)
def _servo(asked: Asked[servos.QueryServoRequest]) -> Answer:
    return servos.QueryServoResponse(tuple(servo.state() for servo in _addressed(asked.board, asked.request.servo_id)))


@answers(servos.SetServoParameterRequest)
def _set_servo(asked: Asked[servos.SetServoParameterRequest]) -> Answer:
    addressed = _addressed(asked.board, asked.request.servo_id)
    if not addressed or not in_range(asked.request):
        # Servo 0 may be what was asked for, so the flags differ too.
        return servos.SetServoParameterResponse(0, int(not asked.request.is_start), int(not asked.request.is_hold))
    if asked.request.servo_id == ALL_SERVOS and not asked.request.is_start:
        asked.board.player.stop()
    for servo in addressed:
        servo.set_flags(asked.request.is_start, asked.request.is_hold, asked.now)
    return servos.SetServoParameterResponse(asked.request.servo_id, asked.request.is_start, asked.request.is_hold)


@answers(servos.SetAngleUnitRequest)
def _set_unit(asked: Asked[servos.SetAngleUnitRequest]) -> Answer:
    addressed = _addressed(asked.board, asked.request.servo_id)
    if not addressed or not in_range(asked.request):
        return servos.SetAngleUnitResponse(0, int(not asked.request.unit_type))
    for servo in addressed:
        servo.unit = asked.request.unit_type
    return servos.SetAngleUnitResponse(asked.request.servo_id, asked.request.unit_type)


@answers(servos.ExecuteActionRequest)
def _move(asked: Asked[servos.ExecuteActionRequest]) -> Answer:
    if in_range(asked.request):
        asked.board.player.move(asked.request.steps, asked.now)
    return None


@answers(servos.ExecuteActionExRequest)
def _run_action(asked: Asked[servos.ExecuteActionExRequest]) -> Answer:
    asked.board.player.run_action(asked.request.action_id, asked.now)
    return None


# ── editing, 3.3 ──


@answers(editing.QueryActionListRequest)
def _action_list(asked: Asked[editing.QueryActionListRequest]) -> Answer:
    return _list(asked.board, Kind.ACTION)


@answers(editing.QueryActionRequest)
def _action(asked: Asked[editing.QueryActionRequest]) -> Answer:
    return asked.board.storage.get(Kind.ACTION, asked.request.action_id) or editing.QueryActionResponse(0)


@answers(editing.AddActionRequest)
def _add_action(asked: Asked[editing.AddActionRequest]) -> Answer:
    return editing.AddActionResponse(_add(asked, Kind.ACTION, asked.request.action_id))


@answers(editing.DeleteActionRequest)
def _delete_action(asked: Asked[editing.DeleteActionRequest]) -> Answer:
    return editing.DeleteActionResponse(asked.board.storage.delete(Kind.ACTION, asked.request.action_id))


@answers(editing.QueryMacroListRequest)
def _macro_list(asked: Asked[editing.QueryMacroListRequest]) -> Answer:
    return _list(asked.board, Kind.MACRO)


@answers(editing.QueryMacroRequest)
def _macro(asked: Asked[editing.QueryMacroRequest]) -> Answer:
    return asked.board.storage.get(Kind.MACRO, asked.request.macro_id) or editing.QueryMacroResponse(0)


@answers(editing.AddMacroRequest)
def _add_macro(asked: Asked[editing.AddMacroRequest]) -> Answer:
    added = playable(asked.request) and asked.board.storage.put(Kind.MACRO, {asked.request.macro_id: asked.content})
    return editing.AddMacroResponse(added)


@answers(editing.DeleteMacroRequest)
def _delete_macro(asked: Asked[editing.DeleteMacroRequest]) -> Answer:
    return editing.DeleteMacroResponse(asked.board.storage.delete(Kind.MACRO, asked.request.macro_id))


@answers(editing.ExecuteMacroRequest)
def _run_macro(asked: Asked[editing.ExecuteMacroRequest]) -> Answer:
    return editing.ExecuteMacroResponse(asked.board.player.run_macro(asked.request.macro_id, asked.now))


@answers(editing.QueryServoParameterRequest)
def _parameters(asked: Asked[editing.QueryServoParameterRequest]) -> Answer:
    records = [record for _, record in asked.board.storage.all(Kind.SERVO)]
    return _count(asked.board, len(records)) + b"".join(records)


@answers(editing.AddServoParameterRequest)
def _add_parameters(asked: Asked[editing.AddServoParameterRequest]) -> Answer:
    parameters = cut_parameters(asked.request, asked.content)
    known = parameters.keys() <= asked.board.servos.keys()
    stored = known and in_range(asked.request) and asked.board.storage.put(Kind.SERVO, parameters)
    return editing.AddServoParameterResponse(stored)


@answers(editing.WriteProjectIDRequest)
def _write_project(asked: Asked[editing.WriteProjectIDRequest]) -> Answer:
    asked.board.storage.project_id = asked.request.project_id
    return editing.WriteProjectIDResponse(1)


@answers(editing.QueryProjectIDRequest)
def _project(asked: Asked[editing.QueryProjectIDRequest]) -> Answer:
    return editing.QueryProjectIDResponse(asked.board.storage.project_id)


# ── remote control, 3.4 ──


@answers(joystick.QueryJoystickTableListRequest)
def _table_list(asked: Asked[joystick.QueryJoystickTableListRequest]) -> Answer:
    return _list(asked.board, Kind.TABLE)


@answers(joystick.QueryJoystickTableRequest)
def _table(asked: Asked[joystick.QueryJoystickTableRequest]) -> Answer:
    return asked.board.storage.get(Kind.TABLE, asked.request.table_id) or joystick.QueryJoystickTableResponse(0)


@answers(joystick.AddJoystickTableRequest)
def _add_table(asked: Asked[joystick.AddJoystickTableRequest]) -> Answer:
    return joystick.AddJoystickTableResponse(_add(asked, Kind.TABLE, asked.request.table_id))


@answers(joystick.DeleteJoystickTableRequest)
def _delete_table(asked: Asked[joystick.DeleteJoystickTableRequest]) -> Answer:
    return joystick.DeleteJoystickTableResponse(asked.board.storage.delete(Kind.TABLE, asked.request.table_id))


@answers(joystick.SetActiveJoystickTableRequest)
def _activate(asked: Asked[joystick.SetActiveJoystickTableRequest]) -> Answer:
    return joystick.SetActiveJoystickTableResponse(asked.board.storage.activate(asked.request.table_id))


@answers(joystick.QueryActiveJoystickTableRequest)
def _active(asked: Asked[joystick.QueryActiveJoystickTableRequest]) -> Answer:
    return joystick.QueryActiveJoystickTableResponse(asked.board.storage.active_table)


@answers(joystick.SubscribeButtonEventRequest)
def _subscribe(asked: Asked[joystick.SubscribeButtonEventRequest]) -> Answer:
    if not in_range(asked.request):
        return joystick.SubscribeButtonEventResponse(0)
    asked.session.subscribed = bool(asked.request.subscribe)
    return joystick.SubscribeButtonEventResponse(1)


def cut_parameters(request: editing.AddServoParameterRequest, content: bytes) -> dict[int, bytes]:
    """Return the record of each servo in the content of `request`; the last one counts."""
    cut = [content[at : at + _PARAMETER] for at in range(2, len(content), _PARAMETER)]
    return dict(zip([servo.servo_id for servo in request.servos], cut, strict=True))


def _addressed(board: VirtualBoard, servo_id: int) -> list[Servo]:
    """Return the servos that `servo_id` means: all, one or none."""
    servos_by_id = board.servos
    if servo_id == ALL_SERVOS:
        return list(servos_by_id.values())
    return [servos_by_id[servo_id]] if servo_id in servos_by_id else []


def _add(asked: Asked[Any], kind: Kind, record_id: int) -> bool:
    return in_range(asked.request) and asked.board.storage.put(kind, {record_id: asked.content})


def _list(board: VirtualBoard, kind: Kind) -> bytes:
    """Return the content of a list answer; records beyond what a frame can hold are not listed."""
    entries = [record[:_LISTED] for _, record in board.storage.all(kind)[:_MOST_LISTED]]
    return _count(board, len(entries)) + b"".join(entries)


def _count(board: VirtualBoard, count: int) -> bytes:
    return count.to_bytes(2, board.codec.byte_order)
