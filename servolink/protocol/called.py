"""Called: a reference to a record that may have no id yet."""

from __future__ import annotations

from typing import Any


class Called(int):
    """The id of `record`, and the record itself: a macro can be written before what it calls has an id."""

    record: Any

    @classmethod
    def of(cls, record: Any) -> Called:
        """Return the reference to an Action or a Macro; it is 0 as long as that has no id."""
        called = cls(getattr(record, record.__struct_fields__[0]))
        called.record = record
        return called
