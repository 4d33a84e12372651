"""Search for faults of a project, without a board."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from servolink.errors import EncodeError
from servolink.motion import INTERVAL_UNIT, MotionLimits, SpeedCap, motion_limits
from servolink.project.model import UNFINISHED, Project, name_of
from servolink.project.record_lookup import dependency_levels, dependency_order, wrong_durations
from servolink.project.speed import servo_moves
from servolink.protocol import (
    ALL_SERVOS,
    MACRO,
    RECORD_TYPES,
    SERVO_PARAMETER,
    TABLE,
    AddServoParameterRequest,
    Button,
    Macro,
    MacroCommandType,
    Packet,
    ServoParameter,
    Step,
    convert,
    json_type,
    layout,
    record_to_json,
)

Severity: TypeAlias = Literal["error", "warning"]
"""`error`: impossible to store on a board, or never finished by a board. `warning`: an effect that was hardly meant."""


class Diagnostic(Struct, frozen=True):
    """Problem of a project, with the place."""

    path: str
    """Place in the names of the project file, such as `actions[3].steps[7].degree`; empty for the whole file."""
    text: str
    severity: Severity
    fixable: bool = False
    """Whether there is a single right solution, applied by `fix_project`."""

    def __str__(self) -> str:
        """Return place and text."""
        return f"{self.path}: {self.text}" if self.path else self.text


def validate_project(
    project: Project,
    *,
    servo_ids: Collection[int] | None = None,
    speed_cap: SpeedCap | None = None,
    memory: int | None = None,
    start: Mapping[int, int] | None = None,
    caption_encoding: str = "utf-8",
) -> list[Diagnostic]:
    """Return the problems of `project`, in the order of the project file.

    Args:
        project: Project to check.
        servo_ids: Ids of the existing servos; unchecked if None.
        speed_cap: Highest speed in degrees per second, for all servos or by servo id; unchecked if None.
        memory: Memory of the board in bytes; unchecked if None.
        start: Pose before the first movement, degrees by servo id; first movements are unchecked if None.
        caption_encoding: Caption encoding of the board.

    Raises:
        EncodeError: A speed cap is 0 or less.
    """
    if errors := list(schema_errors("", project, unchecked=True)):
        return errors  # values of wrong types, unexpected by the other checks
    found = [
        *_unstorable(project, caption_encoding, memory),
        *_wrong_references(project),
        *_endless(project),
        *_nested_too_deep(project),
        *_duplicate_parts(project),
        *_wrong_durations(project),
        *_unknown_servos(project, servo_ids),
    ]
    if speed_cap is not None:
        found += too_fast(project, motion_limits(speed_cap=speed_cap), start)
    return sorted(found, key=_place)


_NUMBER = re.compile(r"\d+")
_PLACES = tuple(Project.__struct_fields__)


def _place(found: Diagnostic) -> tuple[int, list[int]]:
    """Return the key to sort diagnostics in the order of a file."""
    name = found.path.partition("[")[0].partition(".")[0]
    return _PLACES.index(name) if name in _PLACES else -1, [int(number) for number in _NUMBER.findall(found.path)]


def schema_errors(path: str, part: Struct, *, unchecked: bool = False) -> Iterator[Diagnostic]:
    """Find the first value impossible to store in a project file; `unchecked` as for `load_project`."""
    try:
        convert(record_to_json(part), json_type(type(part), unchecked=unchecked))
    except EncodeError as error:
        yield Diagnostic(".".join(filter(None, (path, error.path))), error.text, "error")


def _unstorable(project: Project, caption_encoding: str, memory: int | None) -> Iterator[Diagnostic]:
    """Find values impossible to store on a board with `memory` bytes."""
    yield from _wrong_project_fields(project)
    yield from _unstorable_records(
        SERVO_PARAMETER.field, project.servo_parameters, 0x100, _servo_parameter_request, caption_encoding
    )
    for kind in RECORD_TYPES:
        records = getattr(project, kind.field)
        yield from _unstorable_records(kind.field, records, kind.list_limit, kind.add, caption_encoding)
    size = project.total_size()
    if memory is not None and size > memory:
        yield Diagnostic("", f"the project takes {size:,} bytes; the board has {memory:,}", "error")


def _servo_parameter_request(parameter: ServoParameter) -> Packet:
    return AddServoParameterRequest((parameter,))


def _wrong_project_fields(project: Project) -> Iterator[Diagnostic]:
    if project.project_id in UNFINISHED:
        text = f"{project.project_id} means that an import is under way; choose another id, such as 1"
        yield Diagnostic("project_id", text, "error")
    yield from schema_errors("", replace(project, servo_parameters=(), actions=(), macros=(), joystick_tables=()))
    ids = TABLE.by_id(project)
    active = project.active_joystick_table
    if active is not None and active not in ids:
        yield Diagnostic(
            "active_joystick_table", f"there is no joystick table {active}", "error", fixable=len(ids) <= 1
        )


def _unstorable_records(
    field: str, records: tuple[Any, ...], most: int, request: Callable[[Any], Packet], caption_encoding: str
) -> Iterator[Diagnostic]:
    """Find records in `field` impossible to store on a board; `request` makes the request to store a record."""
    if len(records) > most:
        yield Diagnostic(field, f"there are {len(records):,}; a board can list {most:,}", "error")
    yield from _wrong_ids(field, records)
    for at, record in enumerate(records):
        path = f"{field}[{at}]"
        if errors := list(schema_errors(path, record)):
            yield from errors
            continue
        packet = request(record)
        try:
            layout(type(packet), "little").encode(packet, caption_encoding)
        except EncodeError as error:
            yield Diagnostic(f"{path}.{error.path.removeprefix('servos[0].')}", error.text, "error")


def _wrong_ids(field: str, records: tuple[Any, ...]) -> Iterator[Diagnostic]:
    """Find ids that no record can have, and duplicate ids."""
    for at, record in enumerate(records):
        record_id, path = number_of(record), f"{field}[{at}].{record.__struct_fields__[0]}"
        if record_id == 0 and field != SERVO_PARAMETER.field:
            yield Diagnostic(path, "a record cannot have the id 0, which boards return for missing records", "error")
        elif record_id < 0:
            yield Diagnostic(path, f"{record_id} is negative; boards use ids from 1 on", "warning")
    for at, first, same in duplicates(records):
        path = f"{field}[{at}].{records[at].__struct_fields__[0]}"
        text = f"{number_of(records[at])} is also the id of {field}[{first}]{', which is identical' if same else ''}"
        yield Diagnostic(path, text, "error", fixable=same)


class Duplicate(NamedTuple):
    """Record, step or button with the same number as an earlier part; the number is the first field."""

    at: int
    first: int
    same: bool
    """Whether all parts with this number are identical, so that removing a copy loses nothing."""


def number_of(part: Any) -> int:
    """Return the first field of a record, a step or a button: record id, servo id or button id."""
    return int(getattr(part, part.__struct_fields__[0]))


def duplicates(parts: Sequence[Any]) -> Iterator[Duplicate]:
    """Yield the duplicates among `parts`, in order."""
    first: dict[int, int] = {}
    for at, part in enumerate(parts):
        first.setdefault(number_of(part), at)
    differing = {number_of(part) for part in parts if parts[first[number_of(part)]] != part}
    for at, part in enumerate(parts):
        if (before := first[number_of(part)]) != at:
            yield Duplicate(at, before, number_of(part) not in differing)


def _duplicate_parts(project: Project) -> Iterator[Diagnostic]:
    """Find servos with two steps in an action, and buttons with two entries in a table."""
    for at, action in enumerate(project.actions):
        yield from _duplicates_in(f"actions[{at}].steps", action.steps)
    for at, table in enumerate(project.joystick_tables):
        yield from _duplicates_in(f"joystick_tables[{at}].buttons", table.buttons)


def _duplicates_in(place: str, parts: tuple[Step, ...] | tuple[Button, ...]) -> Iterator[Diagnostic]:
    for at, first, same in duplicates(parts):
        which = "with the same values" if same else "and boards differ in the copy used"
        text = f"{number_of(parts[at])} is also in {place}[{first}], {which}"
        yield Diagnostic(f"{place}[{at}].{parts[at].__struct_fields__[0]}", text, "warning", fixable=same)


def _wrong_references(project: Project) -> Iterator[Diagnostic]:
    """Find references to missing records, and buttons without any macro."""
    existing = {kind: kind.by_id(project).keys() for kind in RECORD_TYPES}
    for kind in RECORD_TYPES:
        for at, record in enumerate(getattr(project, kind.field)):
            for number, part in enumerate(kind.parts_of(record)):
                path = f"{kind.field}[{at}].{record.__struct_fields__[-1]}[{number}]"
                links = [(name, target, getattr(part, name)) for name, target in kind.links(part)]
                if kind is TABLE and not any(target_id for _, _, target_id in links):
                    yield Diagnostic(path, f"button {part.button_id} starts no macro", "warning")
                for name, target, target_id in links:
                    # A button without a macro refers to macro 0; a command always refers to a record.
                    if target_id not in existing[target] and (target_id or kind is MACRO):
                        key = f"{target.label}_id" if kind is MACRO else name
                        yield Diagnostic(f"{path}.{key}", f"there is no {target} {target_id}", "warning")


def _endless(project: Project) -> Iterator[Diagnostic]:
    """Find macros that run themselves, directly or through others; a single macro for each such group."""
    macros = MACRO.by_id(project)
    ending = set(dependency_order(macros))
    # An endless macro runs at least one endless macro. Following the first leads into a cycle.
    following = {
        macro_id: next(
            called
            for kind, called in MACRO.references(macro)
            if kind is MACRO and called in macros and called not in ending
        )
        for macro_id, macro in macros.items()
        if macro_id not in ending
    }
    visited: set[int] = set()
    for macro_id in following:
        path: list[int] = []
        node = macro_id
        while node not in visited:
            visited.add(node)
            path.append(node)
            node = following[node]
        if node in path:
            yield _endless_macro(project, macros[node], following[node], path[path.index(node) :])


def _nested_too_deep(project: Project) -> Iterator[Diagnostic]:
    """Find the macros just beyond the limit of virtual boards; macros with deeper nesting contain such a macro."""
    beyond = next(iter(dependency_levels(MACRO.by_id(project))[Macro.MAX_NESTING :]), ())
    for at, macro in enumerate(project.macros):
        if macro.macro_id in beyond:
            nests = f"{name_of(macro)} nests macros {Macro.MAX_NESTING + 1} levels deep"
            text = f"{nests}; a virtual board plays {Macro.MAX_NESTING}, other boards may differ"
            yield Diagnostic(f"macros[{at}]", text, "warning")


def _endless_macro(project: Project, macro: Macro, called: int, cycle: list[int]) -> Diagnostic:
    at = max(number for number, one in enumerate(project.macros) if one.macro_id == macro.macro_id)
    runs = ((one.type, one.command_id) for one in macro.commands)
    command = list(runs).index((MacroCommandType.MACRO, called))
    text = f"{name_of(macro)} runs itself{_cycle_text(cycle)}, so it never ends"
    return Diagnostic(f"macros[{at}].commands[{command}].macro_id", text, "error")


_SHOWN = 6
"""Macros of a cycle named in an error message."""


def _cycle_text(cycle: list[int]) -> str:
    """Return a text such as ` (1 -> 2 -> 3 -> 1)`, empty for a macro that runs itself directly."""
    if len(cycle) == 1:
        return ""
    between = ["..."] if len(cycle) > _SHOWN else []
    return f" ({' -> '.join([*map(str, cycle[:_SHOWN]), *between, str(cycle[0])])})"


def _wrong_durations(project: Project) -> Iterator[Diagnostic]:
    for at, number, takes in wrong_durations(project):
        stated = project.macros[at].commands[number].total_interval
        given = f"is {stated}" if stated else "is not given"
        path = f"macros[{at}].commands[{number}].total_interval_ms"
        yield Diagnostic(path, f"{given}; the command takes {takes} ms", "warning", fixable=True)


def _unknown_servos(project: Project, servo_ids: Collection[int] | None) -> Iterator[Diagnostic]:
    """Find uses of missing servos: boards refuse parameters for missing servos, and skip the steps."""
    places = [(f"servo_parameters[{at}]", one.servo_id) for at, one in enumerate(project.servo_parameters)]
    for at, action in enumerate(project.actions):
        places += [(f"actions[{at}].steps[{number}]", step.servo_id) for number, step in enumerate(action.steps)]
    for path, servo_id in places:
        severity: Severity = "warning" if "steps" in path else "error"
        if servo_id == ALL_SERVOS:
            yield Diagnostic(f"{path}.servo_id", f"{ALL_SERVOS} stands for all servos, not for one", severity)
        elif servo_ids is not None and servo_id not in servo_ids:
            yield Diagnostic(f"{path}.servo_id", f"there is no servo {servo_id}", severity)


def too_fast(
    project: Project,
    limits: MotionLimits,
    start: Mapping[int, int] | None = None,
    interval_unit: float = INTERVAL_UNIT,
) -> Iterator[Diagnostic]:
    """Find turns faster than the speed caps of `limits`, with `start` as the pose before the first turn."""
    for move in servo_moves(project, start, interval_unit):
        if exceeded := limits.exceeded_cap(move.step.servo_id, move.degrees, move.seconds):
            yield Diagnostic(move.path, f"{move}; its cap is {exceeded}", "warning")
