"""Methods of the control interface for stored content of the board: records and projects."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, cast

from msgspec.structs import replace

from servolink.client import Board
from servolink.control import (
    AnyRecord,
    Applied,
    NoParams,
    ProjectExported,
    RecordEntry,
    RecordKind,
    RecordList,
    Role,
    Touches,
    encoded,
)
from servolink.errors import NotFound, ProjectError
from servolink.hub.method_messages import (
    BackupEntry,
    BackupList,
    Changed,
    MemoryNow,
    Planned,
    ProjectApply,
    ProjectPlan,
    ProjectRollback,
    RecordsGet,
    RecordsList,
    RecordStored,
)
from servolink.hub.methods.methods import METHODS, Caller
from servolink.project import (
    UNFINISHED,
    ApplyResult,
    BackupStore,
    Plan,
    ProgressCallback,
    Project,
    ProjectFile,
    add_record,
    remove_records,
    replace_record,
    validate_project,
)
from servolink.protocol import RECORD_TYPES, RecordType, record_from_json, record_to_json
from servolink.support import computed

_KINDS: dict[RecordKind, RecordType[Any]] = {
    cast("RecordKind", kind.label.replace(" ", "_")): kind for kind in RECORD_TYPES
}


@METHODS.add("records.list", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
async def records_list(caller: Caller, params: RecordsList) -> RecordList:
    """Return id and caption of each stored record."""

    async def read(board: Board) -> RecordList:
        found = []
        for name, kind in _KINDS.items():
            if params.type in {None, name}:
                entries = await getattr(board, kind.field)()
                found += [RecordEntry(name, kind.id_of(entry), kind.caption_of(entry)) for entry in entries]
        return RecordList(tuple(found))

    return await caller.control.read(read)


@METHODS.add("records.get", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
async def records_get(caller: Caller, params: RecordsGet) -> AnyRecord:
    """Return a stored record, in the form of project files; NotFound if there is none."""
    record = await caller.control.read(lambda board: getattr(board, params.type)(params.id))
    return {"type": params.type, "record": record_to_json(record)}


@METHODS.add("records.put", Role.EDIT, touches=Touches.BOARD, from_afar=True, in_order=True)
async def records_put(caller: Caller, params: AnyRecord, on_progress: ProgressCallback) -> RecordStored:
    """Store a record, replacing a record of the same id.

    Done like an import: with a backup, read back, and undone by `project.rollback`. ProjectError says that the record
    refers to one that is missing, or that no board could store it.
    """
    name = params.__struct_config__.tag
    kind = _KINDS[name]
    record = await computed(record_from_json)(kind.record_class, params.record)
    record_id = kind.id_of(record)

    def edit(before: Project, caption_encoding: str) -> Project:
        change = replace_record if record_id in kind.by_id(before) else add_record
        return change(before, record, caption_encoding=caption_encoding)

    before, after, result = await _change(caller, edit, on_progress)
    if not record_id:
        (record_id,) = kind.by_id(after).keys() - kind.by_id(before).keys()
    return RecordStored(name, record_id, result.changed, _text(result.backup))


@METHODS.add("records.delete", Role.EDIT, touches=Touches.BOARD, from_afar=True, in_order=True)
async def records_delete(caller: Caller, params: RecordsGet, on_progress: ProgressCallback) -> Applied:
    """Delete a stored record, in the way of `records.put`; ProjectError if another record refers to it."""
    kind = _KINDS[params.type]
    board = await caller.control.board()
    record: Any = await getattr(board, params.type)(params.id)

    def edit(before: Project, caption_encoding: str) -> Project:
        if kind.id_of(record) not in kind.by_id(before):
            raise NotFound(f"the board has no {kind} {kind.id_of(record)} any more")
        return remove_records(before, kind, {kind.id_of(record)})

    _, _, result = await _change(caller, edit, on_progress)
    return _applied(result)


Edit = Callable[[Project, str], Project]


async def _change(caller: Caller, edit: Edit, on_progress: ProgressCallback) -> tuple[Project, Project, ApplyResult]:
    """Replace the content of the board by the result of `edit`; return both contents and the outcome."""
    board = await caller.control.board()
    async with caller.control.exclusive("a record is being changed"):
        if await board.has_unfinished_import():
            raise ProjectError("the board holds an unfinished import: apply the project again, or roll back")
        before = await board.export_project(on_progress=on_progress)
        after = await computed(edit)(before, board.codec.caption_encoding)
        return before, after, await board.apply_project(after, unchecked=True, on_progress=on_progress)


@METHODS.add("project.export", Role.WATCH, touches=Touches.NOTHING, from_afar=True)
async def project_export(caller: Caller, params: NoParams, on_progress: ProgressCallback) -> ProjectExported:
    """Return everything that is stored on the board, as a project file.

    If an import is unfinished, the project id is the one that the board was to get, or 0 if that is not known here.
    """
    project = await caller.control.read(lambda board: board.export_project(on_progress=on_progress))
    if project.project_id in UNFINISHED:
        url = caller.control.hub.board.url
        project = replace(project, project_id=await asyncio.to_thread(_wanted_id, project.project_id, url))
    return await _exported(project, caller.control.hub.board.codec.caption_encoding)


@computed
def _exported(project: Project, caption_encoding: str) -> ProjectExported:
    found = validate_project(project, caption_encoding=caption_encoding)
    is_odd = any(one.severity == "error" for one in found)
    return encoded(ProjectExported(ProjectFile(project, unchecked=is_odd).form()))


def _wanted_id(marker: int, url: str) -> int:
    begun = BackupStore().journal_of(marker, url)
    return 0 if begun is None else begun.project_id


@METHODS.add("project.plan", Role.EDIT, touches=Touches.NOTHING, from_afar=True, in_order=True)
async def project_plan(caller: Caller, params: ProjectPlan, on_progress: ProgressCallback) -> Planned:
    """Return the changes of `project.apply` and their cost. Nothing is changed, and other programs wait meanwhile."""
    project, unchecked, *_ = await computed(ProjectFile.of_form)(params.project)

    async def read(board: Board) -> Plan:
        async with caller.control.exclusive("a project is being compared"):
            return await board.plan_project(
                project, replace=params.replace, unchecked=unchecked, on_progress=on_progress
            )

    return await _planned(await caller.control.read(read))


@computed
def _planned(plan: Plan) -> Planned:
    memory = None
    if (found := plan.memory) is not None:
        memory = MemoryNow(found.unit, found.size, found.free_before, found.free_after, found.warning or None)
    planned = Planned(
        tuple(Changed(one.what, record_to_json(one.old), record_to_json(one.new)) for one in plan.changes),
        plan.inconsistencies,
        plan.requests,
        plan.wire_bytes,
        plan.seconds,
        memory,
        plan.is_unfinished,
    )
    return encoded(planned)


@METHODS.add("project.apply", Role.EDIT, touches=Touches.MOTION | Touches.BOARD, from_afar=True, in_order=True)
async def project_apply(caller: Caller, params: ProjectApply, on_progress: ProgressCallback) -> Applied:
    """Make the board hold exactly this project, and keep exclusive use of the board meanwhile.

    If it is interrupted, by the end of this program too, apply the same project again, or roll back.
    """
    board = await caller.control.board()
    project, unchecked, *_ = await computed(ProjectFile.of_form)(params.project)
    async with caller.control.exclusive("a project is being written"):
        with caller.control.moving():  # corrections turn servos, and half an import helps nobody
            result = await board.apply_project(
                project, replace=params.replace, backup=params.backup, unchecked=unchecked, on_progress=on_progress
            )
    return _applied(result)


@METHODS.add("project.rollback", Role.EDIT, touches=Touches.MOTION | Touches.BOARD, from_afar=True, in_order=True)
async def project_rollback(caller: Caller, params: ProjectRollback, on_progress: ProgressCallback) -> Applied:
    """Restore the content from before the last import, or of a backup; with exclusive use, as `project.apply`."""
    board = await caller.control.board()
    backup = None
    if params.backup is not None:
        paths = [one.path for one in await asyncio.to_thread(BackupStore().backups) if one.number == params.backup]
        if not paths:
            raise ProjectError(f"there is no backup {params.backup}; project.backups lists them")
        backup = paths[0]
    async with caller.control.exclusive("a backup is being restored"):
        with caller.control.moving():
            result = await board.rollback_project(backup, on_progress=on_progress)
    return _applied(result)


@METHODS.add("project.backups", Role.EDIT, touches=Touches.NOTHING, from_afar=True)
@computed
def project_backups(caller: Caller, params: NoParams) -> BackupList:
    """Return all backups of boards on this computer."""
    return BackupList(
        tuple(
            BackupEntry(backup.number, backup.time.isoformat(), backup.board, str(backup.path))
            for backup in BackupStore().backups()
        )
    )


def _applied(result: ApplyResult) -> Applied:
    return Applied(result.changed, result.resumed, _text(result.backup), result.project_id_bits)


def _text(path: object) -> str | None:
    return None if path is None else str(path)
