"""Changes of a single project record: add, replace, remove, as if the whole project had been rewritten."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from msgspec.structs import replace

from servolink.errors import ProjectError, escape
from servolink.project.build import extend_project, refuse_new_errors
from servolink.project.merge import merge_projects
from servolink.project.model import Project, name_of
from servolink.project.record_lookup import with_id, with_records, wrong_durations
from servolink.protocol import RECORD_TYPES, TABLE, Macro, Record, RecordType


def add_record(project: Project, record: Record, *, caption_encoding: str = "utf-8") -> Project:
    """Return `project` with a further record. A record with the id 0 gets the lowest free id.

    A macro gets missing durations of commands filled in. Raise ProjectError for an id in use, for references to
    missing records, and for a record impossible to store on any board.
    """
    kind = RecordType.of(record)
    if (before := kind.by_id(project).get(kind.id_of(record))) is not None:
        raise ProjectError(f"{name_of(before)} exists; use `set` to change the record, or leave out the id")
    _refuse_missing(project, record)
    return extend_project(project, record, caption_encoding=caption_encoding)


def add_from(project: Project, source: Project, record: Record, *, caption_encoding: str = "utf-8") -> Project:
    """Return `project` with `record` of the project `source`, and with all records run by `record`.

    Records already present are not added again; a record with an id in use gets a new id. Raise ProjectError for
    references to missing records, and for a result impossible to store on any board.
    """
    after, _ = merge_projects(project, project_of(source, record))
    after = replace(after, project_id=project.project_id, active_joystick_table=project.active_joystick_table)
    refuse_new_errors(project, after, caption_encoding)
    return after


def project_of(source: Project, record: Record) -> Project:
    """Return the project of `record` and all records run by `record`, directly or not."""
    records: dict[str, dict[int, Any]] = {kind.field: {} for kind in RECORD_TYPES}
    for one in source.with_dependencies([record]):
        kind = RecordType.of(one)
        records[kind.field][kind.id_of(one)] = one
    return with_records(Project(), records)


def replace_record(project: Project, record: Record, *, caption_encoding: str = "utf-8") -> Project:
    """Return `project` with `record` in place of the record with the same id.

    Durations of macros made wrong by the change are corrected; durations wrong before stay unchanged. Raise
    ProjectError for a new reference to a missing record, and for a record impossible to store on any board.
    """
    kind = RecordType.of(record)
    records = project.by_type()
    _refuse_missing(project, record, records[kind.field].get(kind.id_of(record)))
    records[kind.field][kind.id_of(record)] = record
    after = _with_right_durations(project, with_records(project, records), record)
    refuse_new_errors(project, after, caption_encoding)
    return after


def replace_from(
    project: Project, source: Project, record: Record, record_id: int, *, caption_encoding: str = "utf-8"
) -> Project:
    """Return `project` with `record` of the project `source` in place of the record with the same id.

    Works like `replace_record`. Raise ProjectError too if `record` runs a record that differs between both projects.
    """
    for one in source.with_dependencies([record]):
        kind = RecordType.of(one)
        if one is not record and kind.by_id(project).get(kind.id_of(one)) != one:
            raise ProjectError(
                f"{name_of(record)} of the file runs {name_of(one)}, missing or different on the board; "
                "`add --from` also adds the records that a record runs"
            )
    return replace_record(project, with_id(record, record_id), caption_encoding=caption_encoding)


def remove_records(project: Project, kind: RecordType[Any], record_ids: set[int]) -> Project:
    """Return `project` without these records. Raise ProjectError if another record refers to a removed record."""
    records = project.by_type()
    removed = {record_id: records[kind.field].pop(record_id) for record_id in record_ids}
    for one in (one for shelf in records.values() for one in shelf.values()):
        for target, number in RecordType.of(one).references(one):
            if target is kind and number in removed:
                runner = f"{RecordType.of(one)} {RecordType.of(one).id_of(one)}"
                raise ProjectError(f"{name_of(one)} runs {name_of(removed[number])}; change or delete {runner} first")
    active = project.active_joystick_table
    if kind is TABLE and active in removed:
        active = None  # the board chooses another table
    return replace(with_records(project, records), active_joystick_table=active)


def _refuse_missing(project: Project, record: Record, old: Record | None = None) -> None:
    """Raise ProjectError for a reference of `record`, absent in `old`, to a missing record."""
    kind = RecordType.of(record)
    had = set(kind.references(old)) if old is not None else set()
    for target, number in kind.references(record):
        if number and number not in target.by_id(project) and (target, number) not in had:
            caption = escape(kind.caption_of(record))
            raise ProjectError(f"{kind} '{caption}' runs {target} {number}, not on the board; add the {target} first")


def _with_right_durations(before: Project, after: Project, changed: Record) -> Project:
    was_wrong = {(macro_id, at) for macro_id, at, _ in _wrong(before)}
    macros = {macro.macro_id: macro for macro in after.macros}
    for macro_id, at, takes in _wrong(after):
        commands = list(macros[macro_id].commands)
        # In the changed macro, correct missing durations only: given ones are on purpose.
        is_own = isinstance(changed, Macro) and changed.macro_id == macro_id
        if commands[at].total_interval == 0 if is_own else (macro_id, at) not in was_wrong:
            commands[at] = replace(commands[at], total_interval=takes)
            macros[macro_id] = replace(macros[macro_id], commands=tuple(commands))
    return replace(after, macros=tuple(macros.values()))


def _wrong(project: Project) -> Iterator[tuple[int, int, int]]:
    """Yield id of the macro, index of the command and right duration where a duration is wrong."""
    for at, number, takes in wrong_durations(project):
        yield project.macros[at].macro_id, number, takes
