"""What the board keeps: actions, macros, joystick tables, servo parameters, project id, active table.

Records are kept as the bytes that came, for two reasons: a board gives back what it was given, byte for byte,
also captions that are no text; and what it takes of the memory is then simply its length. It costs no
translation either: the content of an "add" request is the content of the answer that gives the record back.
"""

from __future__ import annotations

from enum import StrEnum


class Kind(StrEnum):
    """The kinds of records."""

    ACTION = "action"
    MACRO = "macro"
    TABLE = "table"
    SERVO = "servo"


class Storage:
    """Records by kind and id, in the order in which their ids were first added, within `memory` bytes."""

    def __init__(self, memory: int) -> None:
        """Have nothing stored."""
        self.memory = memory
        self.used = 0
        self.project_id = 0
        self.chosen_table = 0
        """The table that was made active, 0 if none was."""
        self._records: dict[Kind, dict[int, bytes]] = {kind: {} for kind in Kind}

    @property
    def free(self) -> int:
        """Bytes not used."""
        return self.memory - self.used

    @property
    def active_table(self) -> int:
        """Id of the table that was made active, else of the only one there is, else 0."""
        tables = self._records[Kind.TABLE]
        if self.chosen_table in tables:
            return self.chosen_table
        return next(iter(tables)) if len(tables) == 1 else 0

    def activate(self, table_id: int) -> bool:
        """Make a table the active one; False if there is no such table."""
        if table_id not in self._records[Kind.TABLE]:
            return False
        self.chosen_table = table_id
        return True

    def put(self, kind: Kind, records: dict[int, bytes]) -> bool:
        """Add `records`, in place of those with the same ids: all of them, or none and False if they do not fit.

        The id 0 says "no such record" in every answer, so nothing can be stored under it.
        """
        shelf = self._records[kind]
        growth = sum(len(record) - len(shelf.get(record_id, b"")) for record_id, record in records.items())
        if growth > self.free or 0 in records:
            return False
        shelf.update(records)
        self.used += growth
        return True

    def get(self, kind: Kind, record_id: int) -> bytes | None:
        """Return a record, None if there is none."""
        return self._records[kind].get(record_id)

    def all(self, kind: Kind) -> dict[int, bytes]:
        """Return a copy of all records of a kind, by id."""
        return dict(self._records[kind])

    def delete(self, kind: Kind, record_id: int) -> bool:
        """Delete a record; False if there was none."""
        record = self._records[kind].pop(record_id, None)
        if record is None:
            return False
        self.used -= len(record)
        if kind is Kind.TABLE and record_id == self.chosen_table:
            self.chosen_table = 0
        return True

    def clear(self) -> None:
        """Forget everything."""
        for shelf in self._records.values():
            shelf.clear()
        self.used = self.project_id = self.chosen_table = 0
