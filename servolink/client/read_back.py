"""Find out, by reading back, whether a command whose answer was lost took effect."""

from __future__ import annotations

from typing import TypeAlias

from servolink.client.editing import Editing
from servolink.client.joystick import Joystick
from servolink.errors import NotFound
from servolink.protocol.editing import (
    Action,
    AddActionRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    DeleteActionRequest,
    DeleteMacroRequest,
    Macro,
    WriteProjectIDRequest,
)
from servolink.protocol.joystick import (
    AddJoystickTableRequest,
    DeleteJoystickTableRequest,
    JoystickTable,
    SetActiveJoystickTableRequest,
)
from servolink.protocol.packet import Packet
from servolink.protocol.servos import QueryServoRequest, SetServoParameterRequest
from servolink.protocol.settings import ClearAllDataRequest

_Adding: TypeAlias = AddActionRequest | AddMacroRequest | AddJoystickTableRequest
_Deleting: TypeAlias = DeleteActionRequest | DeleteMacroRequest | DeleteJoystickTableRequest


class ReadBack(Editing, Joystick):
    """Answers the question that OutcomeUnknown leaves open."""

    async def took_effect(self, request: Packet) -> bool | None:
        """Tell whether the board is now as `request` would have made it; None where nothing on the board shows it.

        Motion, the angle unit, the transmission mode and the event subscription leave no trace that can be read.
        """
        match request:
            case AddActionRequest() | AddMacroRequest() | AddJoystickTableRequest():
                return await self._stored(request) == _described(request)
            case DeleteActionRequest() | DeleteMacroRequest() | DeleteJoystickTableRequest():
                return await self._stored(request) is None
            case AddServoParameterRequest():
                return set(request.servos) <= set(await self.servo_parameters())
            case WriteProjectIDRequest():
                return await self.project_id() == request.project_id
            case SetActiveJoystickTableRequest():
                return await self.active_joystick_table() == request.table_id
            case SetServoParameterRequest():
                return await self._is_set(request)
            case ClearAllDataRequest():
                return not (await self.actions() or await self.macros() or await self.joystick_tables())
            case _:
                return None

    async def _stored(self, request: _Adding | _Deleting) -> Action | Macro | JoystickTable | None:
        try:
            match request:
                case AddActionRequest() | DeleteActionRequest():
                    return await self.action(request.action_id)
                case AddMacroRequest() | DeleteMacroRequest():
                    return await self.macro(request.macro_id)
                case _:
                    return await self.joystick_table(request.table_id)
        except NotFound:
            return None

    async def _is_set(self, request: SetServoParameterRequest) -> bool:
        states = (await self.request(QueryServoRequest(request.servo_id))).servos
        wanted = (request.is_start, request.is_hold)
        return bool(states) and all((state.is_start, state.is_hold) == wanted for state in states)


def _described(request: _Adding) -> Action | Macro | JoystickTable:
    match request:
        case AddActionRequest():
            return Action(request.action_id, request.action_caption, tuple(request.steps))
        case AddMacroRequest():
            return Macro(request.macro_id, request.macro_caption, tuple(request.commands))
        case _:
            return JoystickTable(request.table_id, request.table_caption, tuple(request.buttons))
