"""Merging of two projects, and of motions copied from another robot into a project."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any

from msgspec import Meta, Struct
from msgspec.structs import replace

from servolink.errors import ProjectError, escape
from servolink.project.adjust import scale_project
from servolink.project.build import extend_project
from servolink.project.mirror import Mirror
from servolink.project.model import Project, name_of, without_neutral
from servolink.project.project_file import ProjectFile
from servolink.project.record_lookup import dependency_order, free_id, with_caption, with_id, with_records
from servolink.protocol import (
    CAPTION_SIZE,
    MACRO,
    RECORD_TYPES,
    TABLE,
    MacroCommandType,
    RecordRef,
    RecordType,
    ServoParameter,
    Step,
    convert,
)
from servolink.support import read_json


def merge_projects(one: Project, other: Project) -> tuple[Project, list[str]]:
    """Return `one` with the missing records of `other` added, and the list of changes.

    Identical records are kept once. A record of `other` with an id used differently in `one` gets a new id, in all
    references too. For values possible only once, `one` decides: project id, parameters of a servo, active table. Raise
    ProjectError for a duplicate id within a project, and for references to missing records, which could come to mean a
    record of the other project.
    """
    for project in (one, other):
        _refuse_dangling_references(project)
    merging = _Merging(one, other)
    for kind in RECORD_TYPES:
        merging.assign_ids(kind)
    merging.add()
    changes = merging.changes
    parameters = _parameters(one, other, changes)
    project_id = one.project_id or other.project_id
    if other.project_id not in (0, project_id):
        changes.append(f"project id {project_id} stays; {other.project_id} is dropped")
    active = one.active_joystick_table
    if active is None and other.active_joystick_table is not None:
        active = merging.id_of(TABLE, other.active_joystick_table)
    elif other.active_joystick_table is not None and active != merging.id_of(TABLE, other.active_joystick_table):
        changes.append(f"joystick table {active} stays active")
    project = replace(
        with_records(one, merging.records),
        project_id=project_id,
        servo_parameters=parameters,
        active_joystick_table=active,
    )
    return project, changes


def _refuse_dangling_references(project: Project) -> None:
    shelves = project.by_type()
    for shelf in shelves.values():
        for record in shelf.values():
            for kind, number in RecordType.of(record).references(record):
                if number and number not in shelves[kind.field]:
                    raise ProjectError(
                        f"{name_of(record)} refers to {kind} {number}, which is missing; correct the reference first"
                    )


class _Merging:
    """Assigns ids to the records of the other project, and adds the new records."""

    def __init__(self, one: Project, other: Project) -> None:
        self.changes: list[str] = []
        self.records = one.by_type()
        # Record without an id, to id; of several identical records the lowest id, as in an earlier merge.
        self._ids_of_records = {
            field: {with_id(records[record_id], 0): record_id for record_id in sorted(records, reverse=True)}
            for field, records in self.records.items()
        }
        self._others = other.by_type()
        self._used_ids = {field: {*self.records[field], *others} for field, others in self._others.items()}
        self._new_ids: dict[tuple[str, int], int] = {}

    def id_of(self, kind: RecordType[Any], record_id: int) -> int:
        """Return the new id of a record from the other project."""
        return self._new_ids.get((kind.field, record_id), record_id)

    def assign_ids(self, kind: RecordType[Any]) -> None:
        """Assign ids to the other project's records of a type, after all types referred to by this type.

        Repeated until nothing changes: a macro with a reference to a new id differs now, and may need a new id too.
        """
        changed = True
        while changed:
            changed = False
            for record_id in self._others[kind.field]:
                changed |= self._assign_id(kind, record_id)

    def _assign_id(self, kind: RecordType[Any], record_id: int) -> bool:
        """Assign another id to a record if needed. Return whether the id changed."""
        now = self.id_of(kind, record_id)
        record = self._renumbered(kind, self._others[kind.field][record_id], now)
        if self.records[kind.field].get(now, record) == record:
            return False
        key = (kind.field, record_id)
        alike = self._ids_of_records[kind.field].get(with_id(record, 0))
        if alike is not None and key not in self._new_ids:
            self._new_ids[key] = alike
        else:
            self._new_ids[key] = free_id(self._used_ids[kind.field])
            self._used_ids[kind.field].add(self._new_ids[key])
        return True

    def add(self) -> None:
        """Add the records of the other project not yet in `records`."""
        for kind in RECORD_TYPES:
            shelf = self.records[kind.field]
            for record_id, record in self._others[kind.field].items():
                new_id = self.id_of(kind, record_id)
                if new_id not in shelf:
                    shelf[new_id] = self._renumbered(kind, record, new_id)
                    self.changes.append(f"{name_of(record)} added" + (f" as {new_id}" if new_id != record_id else ""))
                elif new_id != record_id:
                    self.changes.append(f"{name_of(record)} is {name_of(shelf[new_id])}")

    def _renumbered(self, kind: RecordType[Any], record: Any, record_id: int) -> Any:
        return with_id(kind.with_references(record, self.id_of), record_id)


def _parameters(one: Project, other: Project, changes: list[str]) -> tuple[ServoParameter, ...]:
    parameters = one.by_servo()
    for added in without_neutral(other.by_servo().values()):
        existing = parameters.get(added.servo_id)
        if existing is None or not without_neutral([existing]):
            parameters[added.servo_id] = added
            changes.append(f"servo {added.servo_id} '{escape(added.servo_caption)}' added")
        elif existing != added:
            changes.append(
                f"servo {existing.servo_id} stays '{escape(existing.servo_caption)}' with a correction of "
                f"{existing.adjusted_degree}; '{escape(added.servo_caption)}' with {added.adjusted_degree} is dropped"
            )
    return tuple(parameters.values())


class CopiedMotions(Struct, frozen=True):
    """Actions and macros of another robot, with the servos in the steps."""

    class NamedServo(Struct, frozen=True, forbid_unknown_fields=True):
        """Servo with the names by which another robot has the same; both may be empty."""

        id: Annotated[int, Meta(ge=0, le=255)]
        caption: Annotated[str, Meta(max_length=256)]
        part: Annotated[str, Meta(max_length=256)]
        """Part of the figure that the servo turns."""

        def names(self) -> tuple[str, str, str]:
            """Return caption, part and, without both, the id as text."""
            caption = " ".join(self.caption.casefold().split())
            return caption, self.part, "" if caption or self.part else str(self.id)

    servos: tuple[NamedServo, ...]
    records: Project

    @classmethod
    def parse(cls, text: str) -> CopiedMotions:
        """Return the motions in a text from a clipboard. Raise ValueError for any text that no studio has copied."""
        value = read_json(text)
        if not isinstance(value, dict) or (value.get("kind"), value.get("version")) != ("servolink motions", 1):
            raise ValueError("the text was not copied in a studio")
        form = {"schema": 1, "actions": value.get("actions"), "macros": value.get("macros")}
        records = ProjectFile.of_form(convert(form, ProjectFile.form_type(unchecked=False))).project
        return cls(convert(value.get("servos"), tuple[CopiedMotions.NamedServo, ...]), records)

    def pairs(self, ours: Sequence[NamedServo]) -> dict[int, int]:
        """Return the servo of this robot for servos of the other, by id.

        Servos are matched by caption, then by part, then by id. A name that two servos of a robot have matches none.
        """
        pairs: dict[int, int] = {}
        for at in range(3):
            theirs = _by_name(self.servos, at)
            found = _by_name([one for one in ours if one.id not in pairs.values()], at)
            pairs |= {theirs[name]: found[name] for name in theirs.keys() & found if theirs[name] not in pairs}
        return pairs

    def pasted(
        self, project: Project, images: Mapping[int, Mirror.ServoImage], factor: float
    ) -> tuple[Project, list[str]]:
        """Return `project` with the motions, and the names of actions left out, because no servo has an image.

        `images` are on this robot, for servos of the other; durations are multiplied by `factor`. An action that is in
        `project` is used; other records get a caption and an id of their own. ProjectError for too long a duration.
        """
        records, _ = scale_project(self.records, factor)
        actions, macros, left = dict[int, Any](), dict[int, Any](), list[str]()
        made: dict[int, dict[int, Any]] = {MacroCommandType.ACTION: actions, MacroCommandType.MACRO: macros}
        for action in records.actions:
            if steps := _fitted(action.steps, images):
                own = replace(action, action_id=0, steps=steps)
                actions[action.action_id] = _with_own_caption(own, [*project.actions, *actions.values()])
            else:
                left.append(action.action_caption or str(action.action_id))
        for macro_id in dependency_order(by_id := MACRO.by_id(records)):
            commands = tuple(
                replace(one, command_id=RecordRef.of(called) if called else one.command_id, total_interval=0)
                for one in by_id[macro_id].commands
                if (called := made.get(one.type, {}).get(one.command_id)) or one.type == MacroCommandType.DELAY
            )
            macro = replace(by_id[macro_id], macro_id=0, commands=commands)
            macros[macro_id] = _with_own_caption(macro, [*project.macros, *macros.values()])
        return extend_project(project, *actions.values(), *macros.values()), left


def _by_name(servos: Sequence[CopiedMotions.NamedServo], at: int) -> dict[str, int]:
    """Return the ids of servos by one of the names, without names that several servos have."""
    counts = Counter(one.names()[at] for one in servos)
    return {name: one.id for one in servos if counts[name := one.names()[at]] == 1 and name}


def _fitted(steps: Iterable[Step], images: Mapping[int, Mirror.ServoImage]) -> tuple[Step, ...]:
    """Return the steps of servos with an image; of two servos with the same image, the first counts."""
    found, owners = [], dict[int, int]()
    for step in steps:
        image = images.get(step.servo_id)
        if image is not None and owners.setdefault(image.servo, step.servo_id) == step.servo_id:
            found.append(Step(image.servo, round(image.factor * step.degree + image.offset), step.interval))
    return tuple(sorted(found, key=lambda step: step.servo_id))


def _with_own_caption(record: Any, present: list[Any]) -> Any:
    """Return `record`, with a number behind the caption if a different record has the caption."""
    kind = RecordType.of(record)
    caption, taken = kind.caption_of(record), {kind.caption_of(one) for one in present}
    found, number = caption, 2
    while found in taken and caption and all(with_id(one, 0) != record for one in present):
        end, number = f" {number}", number + 1
        found = caption.encode(errors="ignore")[: CAPTION_SIZE - len(end)].decode(errors="ignore") + end
    return with_caption(record, found)
