"""docs/reference/packets.md, made from the declarations of the packets."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from msgspec import Meta, Struct

from servolink.protocol.codec import PACKETS
from servolink.protocol.layouts import layout
from servolink.protocol.packet import Counted, Effect, FieldFormat, Packet, Query, Response
from servolink.protocol.servos import SetServoParameterRequest

PAGE = Path(__file__).parent / "reference/packets.md"

_CHAPTERS = ("3.1", "3.2", "3.3", "3.4")
_TYPES = {"B": "u8", "H": "u16", "I": "u32", "h": "i16", "i": "i32", "32s": "caption"}
_INTRODUCTION = """\
# Packet reference

All 60 packets, made from the declarations in `servolink/protocol/`. Names in JSON and in Python are the same.
`u8`, `u16` and `u32` are unsigned numbers, `i16` and `i32` signed ones, in the byte order of the connection; a caption
is 32 bytes of text. The ranges are those that servolink sends; what a board sends is accepted as it is.
"""


def packet_reference() -> str:
    """Return the page, in MyST Markdown."""
    parts = [_INTRODUCTION]
    for section in _CHAPTERS:
        chapter = [declared for _, declared in sorted(PACKETS.items()) if declared.section.startswith(section)]
        parts.append(f"## {section} {_title(chapter[0])}\n")
        parts += map(_packet, chapter)
    return "\n".join(parts)


def _title(declared: type[Packet]) -> str:
    """Return the chapter's name: "Settings (document, 3.1): transmission mode, ..." is about settings."""
    return (sys.modules[declared.__module__].__doc__ or "").partition(" (")[0]


def _packet(declared: type[Packet]) -> str:
    facts = [f"Document {declared.section}", _direction(declared), f"content {_length(declared)}", _response(declared)]
    facts.append(_effect(declared))
    lines = [f"### {declared.packet_id} {declared.__name__}", "", inspect.cleandoc(declared.__doc__ or ""), ""]
    lines += [" · ".join(fact for fact in facts if fact) + ".", ""]
    if rows := list(_rows(declared)):
        lines += ["| field | type | range | meaning |", "| --- | --- | --- | --- |"]
        lines += [f"| {' | '.join(row)} |" for row in rows]
        lines.append("")
    return "\n".join(lines)


def _direction(declared: type[Packet]) -> str:
    return "board to host" if issubclass(declared, Response) else "host to board"


def _effect(declared: type[Packet]) -> str:
    """Return the effect on the servos, empty for none."""
    if declared is SetServoParameterRequest:
        return "moves, goes limp or stops, as its fields say"
    return "" if declared.effect is Effect.NONE else declared.effect.value


def _length(declared: type[Packet]) -> str:
    rule = layout(declared, "little").rule
    if rule.unit == 0:
        return f"{rule.base} byte" + "s" * (rule.base != 1)
    if rule.base == 0:
        return f"up to {rule.limit * rule.unit:,} bytes"
    if rule.limit == 1:
        return f"{rule.base} or {rule.base + rule.unit} bytes"
    return f"{rule.base} + n * {rule.unit} bytes, n up to {rule.limit:,}"


def _response(declared: type[Packet]) -> str:
    """Return which packet is the response, or to which request this is one."""
    other = PACKETS.get(declared.packet_id + (-1 if issubclass(declared, Response) else 1))
    if other is None:
        return "sent without a request" if issubclass(declared, Response) else "no response"
    relation = "response to" if issubclass(declared, Response) else "response:"
    kind = " · changes nothing" if issubclass(declared, Query) else ""
    return f"{relation} {other.packet_id} `{other.__name__}`{kind}"


def _rows(declared: type[Struct], prefix: str = "") -> Iterator[tuple[str, str, str, str]]:
    """Yield name, type, range and meaning of each field, in the order on the wire; records after their count."""
    hints = get_type_hints(declared, include_extras=True)
    for name in declared.__struct_fields__:
        notes = list(_notes(hints[name]))
        meaning = next((note.description for note in notes if isinstance(note, Meta) and note.description), "")
        counted = next((note for note in notes if isinstance(note, Counted)), None)
        if counted is None:
            yield f"`{prefix}{name}`", *_type_and_range(notes), meaning
            continue
        item = get_args(get_args(hints[name])[0])[0]
        yield f"`{name}`", f"{_TYPES[counted.count]} count, then each", "", meaning
        if isinstance(item, type) and issubclass(item, Struct):
            yield from _rows(item, f"{name}[].")
        else:
            yield f"`{name}[]`", *_type_and_range(list(_notes(item))), ""


def _type_and_range(notes: list[Any]) -> tuple[str, str]:
    wire = next((note for note in notes if isinstance(note, FieldFormat)), None)
    if wire is None:
        return "bytes", ""
    low = next((note.ge for note in notes if isinstance(note, Meta) and note.ge is not None), None)
    high = next((note.le for note in notes if isinstance(note, Meta) and note.le is not None), None)
    return _TYPES[wire.code], "" if low is None else f"{low} to {high}"


def _notes(hint: Any) -> Iterator[Any]:
    """Yield what a type is annotated with, however deep it stands, but not in the records of a group."""
    yield from getattr(hint, "__metadata__", ())
    if get_origin(hint) is not tuple:
        for argument in get_args(hint):
            yield from _notes(argument)
