"""Record described by a command line: by options, as JSON, or by name in a project file."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from msgspec.structs import replace

from servolink.cli.command_session import UNTOUCHED
from servolink.cli.stored.verbs import DEFAULT_SECONDS, MacroPart
from servolink.cli.usage import usage_error
from servolink.errors import AmbiguousName, EncodeError, NotFound, ServolinkError, quote
from servolink.project import Named, Project, id_or_caption
from servolink.protocol import (
    ACTION,
    MACRO,
    TABLE,
    Action,
    Button,
    JoystickTable,
    Macro,
    MacroCommand,
    MacroCommandType,
    Record,
    RecordType,
    record_from_json,
    record_to_json,
)
from servolink.support import MAX_SIZE, read_file, read_json, reason

Make: TypeAlias = Callable[[Any, Project], Any]
"""Function from the stored record, or an empty record, and the content of the board to the new record."""

_PRESSES = {"press": "button_press_macro", "long_press": "button_long_press_macro", "up": "button_up_macro"}
"""Option to field."""


def maker(args: argparse.Namespace, kind: RecordType[Any]) -> Make:
    """Return a function that makes the record described by `args`. JSON is read at once, from standard input too."""
    given = [name for name in ("pose", "seconds", "play", *_PRESSES) if getattr(args, name, None) is not None]
    text = _json_text(args.what)
    if text is None:
        if not given or (given == ["seconds"] and args.command.endswith(" add")):
            usage_error(args, f"say what it does: {args.needed}, JSON, or --from FILE")
        return partial(_FROM_OPTIONS[kind], args)
    if given:
        usage_error(args, f"--{given[0].replace('_', '-')} and JSON are both given; choose one")
    fields = _fields(text)
    return lambda old, _: _described(kind, {**record_to_json(old), **fields})


def _described(kind: RecordType[Any], fields: dict[str, Any]) -> Any:
    """Return the record with `fields`, of which stored ones may have any value that a board can have sent.

    Raise EncodeError naming path, value and the range of the document.
    """
    try:
        return record_from_json(kind.record_class, fields, unchecked=True)
    except EncodeError:
        record_from_json(kind.record_class, fields)
        raise


def _json_text(what: str | None) -> str | bytes | None:
    """Return the JSON text in `what`, or in the file named by `what`; None for a caption."""
    if what == "-":
        return sys.stdin.buffer.read(MAX_SIZE + 1) if sys.stdin else b""
    if what and what.startswith("@"):
        try:
            return read_file(Path(what[1:]), MAX_SIZE)
        except (OSError, ValueError) as error:  # ValueError: NUL in the name
            raise ServolinkError(f"{what[1:]} cannot be read: {reason(error)}") from error
    return what if what and what.startswith("{") else None


def _fields(text: str | bytes) -> dict[str, Any]:
    try:
        fields = read_json(text.encode("utf-8", "surrogateescape") if isinstance(text, str) else text)
    except ValueError as error:
        raise EncodeError(f"the record {error}") from error
    if not isinstance(fields, dict):
        raise EncodeError("the record must be a JSON object")
    return fields


# --- options ----------------------------------------------------------------------------------------------------------


def _action(args: argparse.Namespace, old: Action, project: Project) -> Action:
    if args.pose is None:
        interval = Action.pose("", {0: 0}, seconds=args.seconds).steps[0].interval
        return replace(old, steps=tuple(replace(step, interval=interval) for step in old.steps))
    angles = {project.find_servo(servo): angle for servo, angle in args.pose}
    if len(angles) < len(args.pose):
        raise EncodeError(f"a servo is given twice; {UNTOUCHED}")
    seconds = args.seconds if args.seconds is not None else old.seconds if old.steps else DEFAULT_SECONDS
    return replace(old, steps=Action.pose("", angles, seconds=seconds).steps)


def _macro(args: argparse.Namespace, old: Macro, project: Project) -> Macro:
    return replace(old, commands=tuple(_command(part, project) for part in args.play))


def _command(part: MacroPart, project: Project) -> MacroCommand:
    if part.word == "wait":
        return MacroCommand(int(part.value), MacroCommandType.DELAY.value, part.ratio, part.loop)
    kind, record_id = _run(project, part)
    command_type = MacroCommandType.ACTION if kind is ACTION else MacroCommandType.MACRO
    return MacroCommand(record_id, command_type.value, part.ratio, part.loop)


def _run(project: Project, part: MacroPart) -> tuple[RecordType[Any], int]:
    """Return type and id of what a part of a macro runs."""
    kinds: dict[str, RecordType[Any]] = {ACTION.label: ACTION, MACRO.label: MACRO}
    if part.word:
        return kinds[part.word], _id(project, kinds[part.word], part.value)
    caption = id_or_caption(str(part.value))
    named = [one for kind in kinds.values() for one in _named(project, kind)]
    found = Named.captioned(named, str(caption))
    if len(found) > 1:
        raise AmbiguousName(
            f"{quote(caption)} may be {Named.listed(found, 'or')}; give type and id, as in "
            f"{found[0].label}:{found[0].record_id}; {UNTOUCHED}"
        )
    if not found:
        there = Named.closest(named, str(caption), "actions or macro")
        raise NotFound(f"the board has no action or macro {quote(caption)}; {UNTOUCHED}; {there}")
    return kinds[found[0].label], found[0].record_id


def _table(args: argparse.Namespace, old: JoystickTable, project: Project) -> JoystickTable:
    buttons = {button.button_id: button for button in old.buttons}
    for press, field in _PRESSES.items():
        for button_id, macro in getattr(args, press) or ():
            button = buttons.get(button_id, Button(button_id))
            buttons[button_id] = replace(button, **{field: _id(project, MACRO, macro)})
    return replace(old, buttons=tuple(buttons.values()))


_FROM_OPTIONS: dict[RecordType[Any], Callable[[argparse.Namespace, Any, Project], Any]] = {
    ACTION: _action,
    MACRO: _macro,
    TABLE: _table,
}


# --- records of the board ---------------------------------------------------------------------------------------------


def _id(project: Project, kind: RecordType[Any], name: int | str) -> int:
    """Return the id of a record; an id is returned unchanged, even without such a record."""
    return name if isinstance(name, int) else kind.id_of(stored_record(project, kind, name))


def stored_record(project: Project, kind: RecordType[Any], name: int | str) -> Any:
    """Return a record of the board by id or caption. Raise NotFound, with all existing records, if missing."""
    records = kind.by_id(project)
    named = _named(project, kind)
    meant = id_or_caption(name) if isinstance(name, str) else name
    found = (
        Named.captioned(named, meant) if isinstance(meant, str) else [one for one in named if one.record_id == meant]
    )
    if len(found) == 1:
        return records[found[0].record_id]
    if found:
        raise AmbiguousName(f"{quote(meant)} may be {Named.listed(found, 'or')}; give the id; {UNTOUCHED}")
    there = Named.closest(named, meant if isinstance(meant, str) else "", kind.label)
    raise NotFound(f"the board has no {kind} {quote(meant)}; {UNTOUCHED}; {there}")


def _named(project: Project, kind: RecordType[Any]) -> list[Named]:
    return [Named(kind.label, number, kind.caption_of(record)) for number, record in kind.by_id(project).items()]


def empty(kind: RecordType[Any], caption: str, record_id: int) -> Record:
    """Return a record with nothing in it."""
    record: Record = kind.record_class(record_id, caption)
    return record
