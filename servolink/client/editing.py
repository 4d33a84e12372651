"""Commands of chapter 3.3: actions, macros, servo parameters and project id stored on the board."""

from __future__ import annotations

from collections.abc import Iterable

from servolink.client.chapter import Chapter
from servolink.errors import NotFound
from servolink.protocol.editing import (
    Action,
    ActionEntry,
    AddActionRequest,
    AddMacroRequest,
    AddServoParameterRequest,
    DeleteActionRequest,
    DeleteMacroRequest,
    ExecuteMacroRequest,
    Macro,
    MacroEntry,
    QueryActionListRequest,
    QueryActionRequest,
    QueryMacroListRequest,
    QueryMacroRequest,
    QueryProjectIDRequest,
    QueryServoParameterRequest,
    ServoParameter,
    WriteProjectIDRequest,
)

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
