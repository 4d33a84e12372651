"""Project: everything stored on a board (4.2, 4.3)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from itertools import chain
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct

from servolink.errors import ProjectError, escape
from servolink.project.naming import Named, id_or_caption
from servolink.project.summary import project_table, repr_with_counts
from servolink.protocol import (
    I32,
    RECORD_TYPES,
    SERVO_PARAMETER,
    Action,
    JoystickTable,
    Macro,
    Record,
    RecordType,
    ServoParameter,
)

UNFINISHED = range(0x7A00_0000, 0x7A10_0000)
"""Project ids with the meaning "an import is under way". The number identifies the journal (`transfer.backups`)."""

_NUMBERED = re.compile(r"(action|macro|table):([0-9]{1,10})", re.ASCII)


class Project(Struct, frozen=True, forbid_unknown_fields=True):
    """Everything stored on a board, in the types of the packets."""

    project_id: Annotated[I32, Meta(description="0 for none")] = 0
    servo_parameters: tuple[ServoParameter, ...] = ()
    actions: tuple[Action, ...] = ()
    macros: tuple[Macro, ...] = ()
    joystick_tables: tuple[JoystickTable, ...] = ()
    active_joystick_table: Annotated[I32 | None, Meta(description="null: the board chooses")] = None

    def __repr__(self) -> str:
        """Return the project with the number of records in place of all records."""
        return repr_with_counts(self)

    def _repr_html_(self) -> str:
        """Return a table of the records for notebooks."""
        return project_table(self)

    def sorted(self) -> Project:
        """Return the project with records in order of ids, without parameters equal to a servo's defaults."""
        return msgspec.structs.replace(
            self,
            servo_parameters=tuple(sorted(without_neutral(self.servo_parameters), key=lambda one: one.servo_id)),
            actions=tuple(sorted(self.actions, key=lambda one: one.action_id)),
            macros=tuple(sorted(self.macros, key=lambda one: one.macro_id)),
            joystick_tables=tuple(sorted(self.joystick_tables, key=lambda one: one.table_id)),
        )

    def by_type(self) -> dict[str, dict[int, Any]]:
        """Return the records by field and id. Raise ProjectError for a duplicate id."""
        for kind in RECORD_TYPES:
            _refuse_duplicates(kind.label, [kind.id_of(record) for record in getattr(self, kind.field)])
        return {kind.field: kind.by_id(self) for kind in RECORD_TYPES}

    def by_servo(self) -> dict[int, ServoParameter]:
        """Return the parameters by servo id. Raise ProjectError for a servo with duplicate parameters."""
        _refuse_duplicates("servo parameter", [one.servo_id for one in self.servo_parameters])
        return {one.servo_id: one for one in self.servo_parameters}

    def find(self, name: str, kinds: Iterable[RecordType[Any]]) -> Any:
        """Return the record with this name: a caption, an id, a type and id as in `action:3`, or `name:3`.

        `name:3` is the caption `3`. Captions may differ in case. Raise ProjectError if no record matches, or several
        do.
        """
        kinds = tuple(kinds)
        records = [(kind, record) for kind in kinds for record in getattr(self, kind.field)]
        numbered = _NUMBERED.fullmatch(name)
        meant = int(numbered[2]) if numbered else id_or_caption(name)
        if isinstance(meant, int):
            word = numbered and numbered[1]
            found = [one for kind, one in records if kind.id_of(one) == meant and word in (None, _short_label(kind))]
        else:
            named = (Named(kind.label, at, kind.caption_of(one)) for at, (kind, one) in enumerate(records))
            found = [records[one.record_id][1] for one in Named.captioned(named, meant)]
        if len(found) == 1:
            return found[0]
        labels = " or ".join(kind.label for kind in kinds)
        if found:
            ids = " or ".join(f"{_short_label(RecordType.of(one))}:{RecordType.of(one).id_of(one)}" for one in found)
            raise ProjectError(f"'{name}' may be {' or '.join(map(name_of, found))}; write {ids}")
        existing = [Named(kind.label, kind.id_of(record), kind.caption_of(record)) for kind, record in records]
        hint = Named.closest(existing, str(meant), "s or ".join(kind.label for kind in kinds))
        raise ProjectError(f"there is no {labels} '{name}'; {hint}")

    def find_servo(self, servo: int | str) -> int:
        """Return the id of a servo, given by id or caption. Raise ProjectError unless exactly one servo matches."""
        meant = id_or_caption(servo) if isinstance(servo, str) else servo
        if isinstance(meant, int):
            return meant
        named = [Named("servo", one.servo_id, one.servo_caption) for one in self.servo_parameters]
        found = Named.captioned(named, meant)
        if len(found) == 1:
            return found[0].record_id
        if found:
            raise ProjectError(f"'{servo}' may be {Named.listed(found, 'or')}; give the id")
        raise ProjectError(f"there is no servo '{servo}'; {Named.closest(named, meant, 'servo')}")

    def with_dependencies(self, records: Iterable[Record]) -> list[Record]:
        """Return `records` and all records run by them, directly or not, each once, without missing records.

        Raise ProjectError for a duplicate id.
        """
        shelves = self.by_type()
        waiting, found = list(records), dict[tuple[str, int], Record]()
        while waiting:
            record = waiting.pop()
            kind = RecordType.of(record)
            if (key := (kind.field, kind.id_of(record))) in found:
                continue
            found[key] = record
            waiting += [
                shelves[target.field][number]
                for target, number in kind.references(record)
                if number in shelves[target.field]
            ]
        return list(found.values())

    def servos_used(self, record: Record) -> set[int]:
        """Return the ids of the servos moved by `record`, directly or through other records."""
        actions = (one for one in self.with_dependencies([record]) if isinstance(one, Action))
        return {step.servo_id for action in actions for step in action.steps}

    def total_size(self) -> int:
        """Return the bytes of all records and servo parameters on a board."""
        stored: Iterable[Record | ServoParameter] = chain(
            without_neutral(self.servo_parameters), self.actions, self.macros, self.joystick_tables
        )
        return sum(map(stored_size, stored))


def without_neutral(parameters: Iterable[ServoParameter]) -> list[ServoParameter]:
    """Return the parameters with a caption or a correction.

    The protocol cannot delete parameters, only write neutral values, so neutral and missing parameters are equal.
    """
    return [one for one in parameters if one.adjusted_degree or one.servo_caption]


def name_of(record: Any) -> str:
    """Return the name of a record in texts, such as `action 3 'Wave'`, safe to show."""
    kind = RecordType.of(record)
    return f"{kind.label} {kind.id_of(record)} '{escape(kind.caption_of(record))}'"


def _refuse_duplicates(label: str, ids: list[int]) -> None:
    """Raise ProjectError for a duplicate id: an edit by id would lose one of both objects."""
    if duplicates := [number for number, times in Counter(ids).items() if times > 1]:
        raise ProjectError(f"{label} {duplicates[0]} exists twice; remove a copy, or change an id")


def _short_label(kind: RecordType[Any]) -> str:
    """Return the type word for names with a colon: `action`, `macro` or `table`."""
    return kind.label.split()[-1]


def stored_size(record: Record | ServoParameter) -> int:
    """Return the bytes of a record or of the parameters of a servo: 38 + 5n for an action of n steps."""
    if isinstance(record, ServoParameter):
        return SERVO_PARAMETER.size(record)
    return RecordType.of(record).size(record)
