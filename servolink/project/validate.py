"""Problem: one thing that is wrong with a project."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from servolink.errors import EncodeError
from servolink.project.model import UNFINISHED, Project
from servolink.project.records import dependency_order, named, total_size, wrong_times
from servolink.project.speed import servo_moves
from servolink.protocol.codec import PACKETS
from servolink.protocol.editing import AddServoParameterRequest
from servolink.protocol.json_errors import convert
from servolink.protocol.json_form import json_type, record_to_json
from servolink.protocol.layout import layout
from servolink.protocol.packet import Packet
from servolink.protocol.record_types import ACTION, MACRO, RECORD_TYPES
from servolink.protocol.records import Button, Macro, ServoParameter, Step
from servolink.protocol.servos import ALL_SERVOS

Severity: TypeAlias = Literal["error", "warning"]
"""`error`: a board cannot store it, or would run for ever; `warning`: a board does something else than was meant."""


class Diagnostic(Struct, frozen=True):
    """One thing that is wrong with a project."""

    path: str
    """Where, in the names of the project file, such as `actions[3].steps[7].degree`; empty for all of it."""
    text: str
    severity: Severity
    fixable: bool = False
    """There is one right answer, and `fix_project` gives it."""

    def __str__(self) -> str:
        """Return place and text."""
        return f"{self.path}: {self.text}" if self.path else self.text


class Repeat(NamedTuple):
    """A part that has the number of a part before it; the number is the first field and says what the part is for."""

    at: int
    first: int
    same: bool
    """All parts with the number are the same, so that nothing is lost without this one."""


def number_of(part: Any) -> int:
    """Return the first field."""
    return int(getattr(part, part.__struct_fields__[0]))


def repeats(parts: Sequence[Any]) -> Iterator[Repeat]:
    """Yield the repeats among `parts`, in their order."""
    first: dict[int, int] = {}
    for at, part in enumerate(parts):
        first.setdefault(number_of(part), at)
    differing = {number_of(part) for part in parts if parts[first[number_of(part)]] != part}
    for at, part in enumerate(parts):
        if (before := first[number_of(part)]) != at:
            yield Repeat(at, before, number_of(part) not in differing)


_STARTS = tuple(name for name in Button.__struct_fields__ if name.endswith("_macro"))
_NAMED = 6
"""Macros of a cycle that are named."""


def wrong_calls(project: Project) -> Iterator[Diagnostic]:
    """Yield calls of what is not there, macros that never end, and buttons that start nothing."""
    action_ids, macros = ACTION.by_id(project).keys(), MACRO.by_id(project)
    for at, macro in enumerate(project.macros):
        for number, command in enumerate(macro.commands):
            path = f"macros[{at}].commands[{number}]"
            if command.type == 0 and command.command_id not in action_ids:
                yield Diagnostic(f"{path}.action_id", f"there is no action {command.command_id}", "warning")
            if command.type == 2 and command.command_id not in macros:
                yield Diagnostic(f"{path}.macro_id", f"there is no macro {command.command_id}", "warning")
    yield from _endless(project, macros)
    for at, table in enumerate(project.joystick_tables):
        for number, button in enumerate(table.buttons):
            yield from _wrong_button(f"joystick_tables[{at}].buttons[{number}]", button, macros)


def _endless(project: Project, macros: Mapping[int, Macro]) -> Iterator[Diagnostic]:
    """Name macros that call themselves, also through others: of those that have macros in common, one way round."""
    ends = set(dependency_order(macros))
    goes_on = {
        macro_id: next(
            called
            for kind, called in MACRO.references(macro)
            if kind is MACRO and called in macros and called not in ends
        )
        for macro_id, macro in macros.items()
        if macro_id not in ends
    }
    places = {macro.macro_id: at for at, macro in enumerate(project.macros)}
    seen: set[int] = set()
    for macro_id in goes_on:
        way: dict[int, None] = {}  # in order, and quick to look into
        here = macro_id
        while here not in seen:
            seen.add(here)
            way[here] = None
            here = goes_on[here]
        if here in way:
            cycle = list(way)[list(way).index(here) :]
            calling = (one.type == 2 and one.command_id == goes_on[here] for one in macros[here].commands)
            path = f"macros[{places[here]}].commands[{list(calling).index(True)}].macro_id"
            yield Diagnostic(path, f"{named(macros[here])} calls itself{_round(cycle)}, so it never ends", "error")


def _round(cycle: list[int]) -> str:
    """Return the way round a cycle, such as ` (1 -> 2 -> 3 -> 1)`; nothing for a macro that calls just itself."""
    if len(cycle) == 1:
        return ""
    between = ["..."] if len(cycle) > _NAMED else []
    return f" ({' -> '.join([*map(str, cycle[:_NAMED]), *between, str(cycle[0])])})"


def _wrong_button(path: str, button: Button, macros: Mapping[int, Macro]) -> Iterator[Diagnostic]:
    starts = {name: getattr(button, name) for name in _STARTS}
    if not any(starts.values()):
        yield Diagnostic(path, f"button {button.button_id} starts no macro", "warning")
    for name, macro_id in starts.items():
        if macro_id and macro_id not in macros:
            yield Diagnostic(f"{path}.{name}", f"there is no macro {macro_id}", "warning")


def unstorable(project: Project, caption_encoding: str = "utf-8", memory: int | None = None) -> Iterator[Diagnostic]:
    """Yield why a board with `memory` bytes cannot store `project`."""
    yield from _numbers_of_all(project)
    yield from _shelf("servo_parameters", project.servo_parameters, 0x100, _servo_parameter_request, caption_encoding)
    for kind in RECORD_TYPES:
        most = layout(PACKETS[kind.list_request.packet_id + 1], "little").rule.limit
        yield from _shelf(kind.field, getattr(project, kind.field), most, kind.add, caption_encoding)
    size = total_size(project)
    if memory is not None and size > memory:
        yield Diagnostic("", f"all of it takes {size:,} bytes; the board has {memory:,}", "error")


def _numbers_of_all(project: Project) -> Iterator[Diagnostic]:
    if project.project_id in UNFINISHED:
        text = f"{project.project_id} means that an import is under way; take another id, such as 1"
        yield Diagnostic("project_id", text, "error")
    alone = replace(project, servo_parameters=(), actions=(), macros=(), joystick_tables=())
    yield from schema_errors("", alone)
    ids = {table.table_id for table in project.joystick_tables}
    active = project.active_joystick_table
    if active is not None and active not in ids:
        yield Diagnostic(
            "active_joystick_table", f"there is no joystick table {active}", "error", fixable=len(ids) <= 1
        )


def _shelf(
    place: str, records: tuple[Any, ...], most: int, request: Callable[[Any], Packet], caption_encoding: str
) -> Iterator[Diagnostic]:
    """Look at all records of a kind, of which `request` stores one."""
    if len(records) > most:
        yield Diagnostic(place, f"there are {len(records):,}; a board can list {most:,}", "error")
    yield from _ids(place, records)
    for at, record in enumerate(records):
        yield from _unsendable(f"{place}[{at}]", record, request, caption_encoding)


def _ids(place: str, records: tuple[Any, ...]) -> Iterator[Diagnostic]:
    """Find ids that no record can have, or that several have."""
    for at, record in enumerate(records):
        record_id, path = number_of(record), f"{place}[{at}].{record.__struct_fields__[0]}"
        if record_id == 0 and place != "servo_parameters":
            yield Diagnostic(path, "0 is no id: boards say it for what is not there", "error")
        elif record_id < 0:
            yield Diagnostic(path, f"{record_id} is negative; take an id from 1 on, as boards do", "warning")
    for at, before, same in repeats(records):
        path = f"{place}[{at}].{records[at].__struct_fields__[0]}"
        text = f"{number_of(records[at])} is also the id of {place}[{before}]{', which is the same' if same else ''}"
        yield Diagnostic(path, text, "error", fixable=same)


def _unsendable(
    path: str, record: Any, request: Callable[[Any], Packet], caption_encoding: str
) -> Iterator[Diagnostic]:
    """Find the first thing in a record that the request for storing it cannot carry."""
    if misfits := list(schema_errors(path, record)):
        yield from misfits
        return
    packet = request(record)
    try:
        layout(type(packet), "little").encode(packet, caption_encoding)
    except EncodeError as error:
        within = error.path.removeprefix("servos[0].")
        yield Diagnostic(f"{path}.{within}", error.text, "error")


def _servo_parameter_request(parameter: ServoParameter) -> Packet:
    return AddServoParameterRequest((parameter,))


def schema_errors(path: str, part: Struct, *, unchecked: bool = False) -> Iterator[Diagnostic]:
    """Find the first value that no project file may have, in the file's words; `unchecked` as for `load_project`."""
    try:
        convert(record_to_json(part), json_type(type(part), unchecked=unchecked))
    except EncodeError as error:
        yield Diagnostic(".".join(filter(None, (path, error.path))), error.text, "error")


_NUMBER = re.compile(r"\d+")
_PLACES = tuple(Project.__struct_fields__)


def validate_project(
    project: Project,
    *,
    servo_ids: Collection[int] | None = None,
    speed_cap: float | None = None,
    memory: int | None = None,
    start: Mapping[int, int] | None = None,
    caption_encoding: str = "utf-8",
) -> list[Diagnostic]:
    """Return what is wrong with `project`, in the order of its file.

    Looked at as far as it is given: whether there are servos other than `servo_ids`; ways faster than `speed_cap`
    in degrees per second, with `start` as the pose (degrees by servo) before the first; whether all fits into
    `memory` bytes of a board, in whose `caption_encoding` captions are written.
    """
    if misfits := list(schema_errors("", project, unchecked=True)):
        return misfits  # values of other types, which no other check expects
    found = [*unstorable(project, caption_encoding, memory), *wrong_calls(project), *_twice(project)]
    found += _wrong_times(project)
    found += _unknown_servos(project, servo_ids)
    if speed_cap is not None:
        found += (
            Diagnostic(turn.path, f"{turn}; its cap is {speed_cap:g}", "warning")
            for turn in servo_moves(project, start)
            if turn.degrees_per_second > speed_cap
        )
    return sorted(found, key=_place)


def _wrong_times(project: Project) -> Iterator[Diagnostic]:
    for at, number, takes in wrong_times(project):
        stated = project.macros[at].commands[number].total_interval
        given = f"is {stated}" if stated else "is not given"
        path = f"macros[{at}].commands[{number}].total_interval_ms"
        yield Diagnostic(path, f"{given}; the command takes {takes} ms", "warning", fixable=True)


def _twice(project: Project) -> Iterator[Diagnostic]:
    """Find servos with two steps in one action, and buttons that are twice in one table."""
    for at, action in enumerate(project.actions):
        yield from _repeated(f"actions[{at}].steps", action.steps)
    for at, table in enumerate(project.joystick_tables):
        yield from _repeated(f"joystick_tables[{at}].buttons", table.buttons)


def _repeated(place: str, parts: tuple[Step, ...] | tuple[Button, ...]) -> Iterator[Diagnostic]:
    for at, before, same in repeats(parts):
        which = "with the same values" if same else "and boards differ in which they take"
        text = f"{number_of(parts[at])} is also in {place}[{before}], {which}"
        yield Diagnostic(f"{place}[{at}].{parts[at].__struct_fields__[0]}", text, "warning", fixable=same)


def _unknown_servos(project: Project, servo_ids: Collection[int] | None) -> Iterator[Diagnostic]:
    """Find what is for servos that are not there: boards refuse their parameters, and pass over their steps."""
    places = [(f"servo_parameters[{at}]", one.servo_id) for at, one in enumerate(project.servo_parameters)]
    for at, action in enumerate(project.actions):
        places += [(f"actions[{at}].steps[{number}]", step.servo_id) for number, step in enumerate(action.steps)]
    for path, servo_id in places:
        severity: Severity = "warning" if "steps" in path else "error"
        if servo_id == ALL_SERVOS:
            yield Diagnostic(f"{path}.servo_id", f"{ALL_SERVOS} means all servos and is none", severity)
        elif servo_ids is not None and servo_id not in servo_ids:
            yield Diagnostic(f"{path}.servo_id", f"there is no servo {servo_id}", severity)


def _place(problem: Diagnostic) -> tuple[int, list[int]]:
    """Return what sorts problems as a file does."""
    name = problem.path.partition("[")[0].partition(".")[0]
    return _PLACES.index(name) if name in _PLACES else -1, [int(number) for number in _NUMBER.findall(problem.path)]
