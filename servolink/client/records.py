"""Commands of chapter 3.3: actions, macros, servo parameters and project id stored on the board."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeAlias

from servolink.client.events import ButtonEvents, Subscription
from servolink.client.session import Chapter
from servolink.connection.connection import Connection
from servolink.errors import NotFound
from servolink.protocol.editing import (
    AddActionRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    DeleteActionRequest,
    DeleteMacroRequest,
    ExecuteMacroRequest,
    QueryActionListRequest,
    QueryActionRequest,
    QueryMacroListRequest,
    QueryMacroRequest,
    QueryProjectIDRequest,
    QueryServoParameterRequest,
    WriteProjectIDRequest,
)
from servolink.protocol.joystick import (
    AddJoystickTableRequest,
    DeleteJoystickTableRequest,
    QueryActiveJoystickTableRequest,
    QueryJoystickTableListRequest,
    QueryJoystickTableRequest,
    SetActiveJoystickTableRequest,
)
from servolink.protocol.packet import Packet
from servolink.protocol.records import (
    Action,
    ActionEntry,
    JoystickTable,
    JoystickTableEntry,
    Macro,
    MacroEntry,
    ServoParameter,
)
from servolink.protocol.servos import QueryServoRequest, SetServoParameterRequest
from servolink.protocol.settings import ClearAllDataRequest

_NOT_STORED = "its memory may be full, or the id may be taken"


class Editing(Chapter):
    """What is stored on the board."""

    async def actions(self) -> tuple[ActionEntry, ...]:
        """Return id and caption of each stored action (3.3.1)."""
        return (await self.request(QueryActionListRequest())).actions

    async def action(self, action_id: int) -> Action:
        """Return a stored action (3.3.2); NotFound if there is none."""
        request = QueryActionRequest(action_id)
        found = await self.request(request)
        if found.action_id != action_id or action_id == 0:
            raise NotFound(f"the board has no action {action_id}", request)
        return Action(found.action_id, found.action_caption, found.steps)

    async def add_action(self, action: Action) -> None:
        """Store an action (3.3.3); Rejected if the board does not."""
        await self._do(AddActionRequest(action.action_id, action.action_caption, action.steps), _NOT_STORED)

    async def delete_action(self, action_id: int) -> None:
        """Delete a stored action (3.3.4); Rejected if there is none."""
        await self._do(DeleteActionRequest(action_id), "it may have no such action")

    async def macros(self) -> tuple[MacroEntry, ...]:
        """Return id and caption of each stored macro (3.3.5)."""
        return (await self.request(QueryMacroListRequest())).macros

    async def macro(self, macro_id: int) -> Macro:
        """Return a stored macro (3.3.6); NotFound if there is none."""
        request = QueryMacroRequest(macro_id)
        found = await self.request(request)
        if found.macro_id != macro_id or macro_id == 0:
            raise NotFound(f"the board has no macro {macro_id}", request)
        return Macro(found.macro_id, found.macro_caption, found.commands)

    async def add_macro(self, macro: Macro) -> None:
        """Store a macro (3.3.7); Rejected if the board does not."""
        await self._do(AddMacroRequest(macro.macro_id, macro.macro_caption, macro.commands), _NOT_STORED)

    async def delete_macro(self, macro_id: int) -> None:
        """Delete a stored macro (3.3.8); Rejected if there is none."""
        await self._do(DeleteMacroRequest(macro_id), "it may have no such macro")

    async def run_macro(self, macro_id: int) -> None:
        """Run a stored macro (3.3.9); returns when it has started; Rejected if it has not."""
        await self._do(ExecuteMacroRequest(macro_id), "it may have no such macro, or the macro runs itself")

    async def servo_parameters(self) -> tuple[ServoParameter, ...]:
        """Return caption and angle correction of each servo; empty also after an error on the board (3.3.10)."""
        return (await self.request(QueryServoParameterRequest())).servos

    async def add_servo_parameters(self, servos: Iterable[ServoParameter]) -> None:
        """Store caption and angle correction of servos (3.3.11); Rejected if the board does not."""
        await self._do(AddServoParameterRequest(tuple(servos)), "its memory may be full, or it has no such servo")

    async def project_id(self) -> int:
        """Return the project id; 0 if the board has none (3.3.13)."""
        changes = self._identity.changes
        project_id = (await self.request(QueryProjectIDRequest())).project_id
        self._identity.hear(project_id, changes)
        return project_id

    async def write_project_id(self, project_id: int) -> None:
        """Write the project id over the one the board has (3.3.12); Rejected if the board does not."""
        with self._identity.changing(self._link, project_id):
            await self._do(WriteProjectIDRequest(project_id), "it was not written")
        self._identity.know(project_id)


class Joystick(Chapter):
    """What the buttons do."""

    def __init__(self, link: Connection) -> None:
        """Speak through `link`."""
        super().__init__(link)
        self._events = Subscription(link)

    async def joystick_tables(self) -> tuple[JoystickTableEntry, ...]:
        """Return id and caption of each stored joystick table (3.4.1)."""
        return (await self.request(QueryJoystickTableListRequest())).tables

    async def joystick_table(self, table_id: int) -> JoystickTable:
        """Return a stored joystick table (3.4.2); NotFound if there is none."""
        request = QueryJoystickTableRequest(table_id)
        found = await self.request(request)
        if found.table_id != table_id or table_id == 0:
            raise NotFound(f"the board has no joystick table {table_id}", request)
        return JoystickTable(found.table_id, found.table_caption, found.buttons)

    async def add_joystick_table(self, table: JoystickTable) -> None:
        """Store a joystick table (3.4.3); Rejected if the board does not."""
        request = AddJoystickTableRequest(table.table_id, table.table_caption, table.buttons)
        await self._do(request, "its memory may be full, or the id may be taken")

    async def delete_joystick_table(self, table_id: int) -> None:
        """Delete a stored joystick table (3.4.4); Rejected if there is none."""
        await self._do(DeleteJoystickTableRequest(table_id), "it may have no such table")

    async def active_joystick_table(self) -> int | None:
        """Return the id of the active joystick table; None if the board has no table (3.4.6)."""
        return (await self.request(QueryActiveJoystickTableRequest())).table_id or None

    async def set_active_joystick_table(self, table_id: int) -> None:
        """Make a stored joystick table the active one (3.4.5); Rejected if there is none."""
        await self._do(SetActiveJoystickTableRequest(table_id), "it may have no such table")

    def button_events(self, limit: int = 256) -> ButtonEvents:
        """Return the button events from now on (3.4.7, 3.4.8); see ButtonEvents. At most `limit` wait to be read."""
        return ButtonEvents(self._events, limit)


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
