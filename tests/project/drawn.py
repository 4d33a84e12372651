"""Projects for hypothesis: any that this library would make up, and any that a board can say."""

from __future__ import annotations

from typing import Any, cast

from hypothesis import strategies as st
from msgspec import inspect
from msgspec.structs import replace

from servolink.project.model import Project
from servolink.protocol import (
    ALL_SERVOS,
    RECORD_TYPES,
    Packet,
    QueryActionResponse,
    QueryJoystickTableResponse,
    QueryMacroResponse,
    QueryServoParameterResponse,
    RecordType,
    layout,
)
from tests.protocol.declared import plain_captions, values_of

ENCODINGS = ("utf-8", "big5", "utf-16-le", "cp437")


def _without_negative_delays(project: Project) -> Project:
    macros = tuple(
        replace(macro, commands=tuple(replace(one, command_id=one.command_id & 0x7FFF_FFFF) for one in macro.commands))
        for macro in project.macros
    )
    return replace(project, macros=macros)


projects = cast("st.SearchStrategy[Project]", values_of(inspect.type_info(Project), plain_captions)).map(
    _without_negative_delays
)
"""Projects whose values are all allowed, though what they call may not be there."""


def _storable(project: Project) -> Project:
    shelves: dict[str, Any] = {
        kind.field: tuple(one for record_id, one in kind.by_id(project).items() if record_id) for kind in RECORD_TYPES
    }
    parameters = {one.servo_id: one for one in project.servo_parameters if one.servo_id != ALL_SERVOS}
    return replace(project, servo_parameters=tuple(parameters.values()), active_joystick_table=None, **shelves)


storable_projects = projects.map(_storable)
"""Those of them in which no id is there twice, or none."""

_ids = st.integers(-(2**31), 2**31 - 1)
_ANSWERS: tuple[type[Packet], ...] = (QueryActionResponse, QueryMacroResponse, QueryJoystickTableResponse)


@st.composite
def _answered(draw: st.DrawFn, declared: type[Packet], encoding: str) -> Any:
    """Draw an answer by its bytes: a board may put any into any field."""
    compiled = layout(declared, "little")
    count = draw(st.integers(0, 3))
    head = draw(st.binary(min_size=compiled.rule.base - 2, max_size=compiled.rule.base - 2))
    rest = draw(st.binary(min_size=count * compiled.rule.unit, max_size=count * compiled.rule.unit))
    return compiled.decode(head + count.to_bytes(2, "little") + rest, encoding)


@st.composite
def said_projects(draw: st.DrawFn) -> Project:
    """Draw what a board can say, whatever nonsense it is."""
    encoding = draw(st.sampled_from(ENCODINGS))

    def records(kind: RecordType[Any], declared: type[Packet]) -> tuple[Any, ...]:
        answers = draw(st.lists(_answered(declared, encoding), max_size=3))
        return tuple(found for answer in answers if (found := kind.record_in(answer)) is not None)

    return Project(
        draw(_ids),
        draw(_answered(QueryServoParameterResponse, encoding)).servos,
        active_joystick_table=draw(_ids | st.none()),
        **{kind.field: records(kind, declared) for kind, declared in zip(RECORD_TYPES, _ANSWERS, strict=True)},
    )
