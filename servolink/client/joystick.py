"""Commands of chapter 3.4: joystick tables and button events."""

from __future__ import annotations

from servolink.client.chapter import Chapter
from servolink.client.events import ButtonEvents, Subscription
from servolink.client.link import Link
from servolink.errors import NotFound
from servolink.protocol.joystick import (
    AddJoystickTableRequest,
    DeleteJoystickTableRequest,
    JoystickTable,
    JoystickTableEntry,
    QueryActiveJoystickTableRequest,
    QueryJoystickTableListRequest,
    QueryJoystickTableRequest,
    SetActiveJoystickTableRequest,
)


class Joystick(Chapter):
    """What the buttons do."""

    def __init__(self, link: Link) -> None:
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
