"""What actions, macros and joystick tables have to do with each other: ids, and who calls whom."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping
from itertools import count
from typing import Any

import msgspec

from servolink.errors import ProjectError
from servolink.printable import printable, shown
from servolink.project.kinds import ACTION, KINDS, MACRO, Kind
from servolink.project.model import Project
from servolink.protocol.editing import Macro, MacroCommand, ServoParameter
from servolink.protocol.joystick import JoystickTable

_BY_TYPE = {0: ACTION, 2: MACRO}
"""What a macro's command calls; type 1 is a delay."""
_BUTTON_MACROS = ("button_press_macro", "button_long_press_macro", "button_up_macro")


def kind_of(record: object) -> Kind:
    """Return the kind of a record; ProjectError if it is none."""
    for kind in KINDS:
        if isinstance(record, kind.record):
            return kind
    raise ProjectError(f"{shown(record)} is no action, macro or joystick table")


def named(record: Any) -> str:
    """Return what a record is called in texts: `action 3 'Wave'`."""
    kind = kind_of(record)
    return f"{kind.word} {kind.id_of(record)} '{printable(kind.caption_of(record))}'"


def by_kind(project: Project) -> dict[str, dict[int, Any]]:
    """Return the records of a project, by the field that they are in and their id; ProjectError for an id twice."""
    for kind in KINDS:
        _refuse_twice(kind.word, [kind.id_of(record) for record in getattr(project, kind.plural)])
    return {kind.plural: kind.of(project) for kind in KINDS}


def by_servo(project: Project) -> dict[int, ServoParameter]:
    """Return the parameters of servos, by servo; ProjectError for a servo that has them twice."""
    _refuse_twice("servo", [one.servo_id for one in project.servo_parameters])
    return {one.servo_id: one for one in project.servo_parameters}


def _refuse_twice(word: str, ids: list[int]) -> None:
    """Refuse what an edit would lose."""
    if twice := [number for number, times in Counter(ids).items() if times > 1]:
        raise ProjectError(f"{word} {twice[0]} is there twice: which one is meant cannot be known")


def with_records(project: Project, records: Mapping[str, Mapping[int, Any]]) -> Project:
    """Return `project` with other records, given as `by_kind` gives them."""
    return msgspec.structs.replace(project, **{plural: tuple(shelf.values()) for plural, shelf in records.items()})


def free_id(taken: Container[int]) -> int:
    """Return the lowest id that is not taken; 0 means "there is none" everywhere."""
    return next(number for number in count(1) if number not in taken)


def with_id(record: Any, record_id: int) -> Any:
    """Return `record` under another id."""
    return msgspec.structs.replace(record, **{record.__struct_fields__[0]: record_id})


def calls(record: Any) -> Iterator[tuple[Kind, int]]:
    """Yield kind and id of what a record calls; a button without a macro calls macro 0."""
    if isinstance(record, Macro):
        for command in record.commands:
            if command.type in _BY_TYPE:
                yield _BY_TYPE[command.type], command.command_id
    elif isinstance(record, JoystickTable):
        for button in record.buttons:
            yield from ((MACRO, getattr(button, name)) for name in _BUTTON_MACROS)


def with_calls(record: Any, instead: Callable[[Kind, int], int]) -> Any:
    """Return `record` with other ids of what it calls."""
    if isinstance(record, Macro):
        return msgspec.structs.replace(record, commands=tuple(_command(one, instead) for one in record.commands))
    if isinstance(record, JoystickTable):
        buttons = tuple(
            msgspec.structs.replace(one, **{name: instead(MACRO, getattr(one, name)) for name in _BUTTON_MACROS})
            for one in record.buttons
        )
        return msgspec.structs.replace(record, buttons=buttons)
    return record


def _command(command: MacroCommand, instead: Callable[[Kind, int], int]) -> MacroCommand:
    if command.type not in _BY_TYPE:
        return command
    return msgspec.structs.replace(command, command_id=instead(_BY_TYPE[command.type], command.command_id))
