"""Dissector for Wireshark: Lua tables made from the packet declarations, Lua code, and the installation."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from servolink.errors import ServolinkError
from servolink.protocol import PACKETS, ByteOrder, Field, Packet, Response, Result, layout
from servolink.support import MIB, read_file, reason, write_atomically

FIRST_LINE = "-- A Wireshark dissector for servo control boards, written by `servolink wireshark`."
"""First line of each dissector by servolink: a file with another first line is never replaced."""

ENCODINGS = ("utf-8", "big5", "gb18030", "utf-16-le", "utf-16-be", "latin-1")
"""Caption encodings offered in the preferences of the dissector, in this order."""

_BYTE_ORDERS: tuple[ByteOrder | None, ...] = (None, "little", "big")
_MEANING = re.compile(r"(\d+) (?:for )?([a-z][a-zA-Z ]*)")


def dissector(byte_order: ByteOrder | None = None, caption_encoding: str = "utf-8") -> str:
    """Return the dissector in Lua, with byte order (None: detected in each frame) and encoding as default preferences.

    Raise ValueError for an encoding outside ENCODINGS.
    """
    if caption_encoding not in ENCODINGS:
        raise ValueError(f"Wireshark can read captions in {', '.join(ENCODINGS)}, not in {caption_encoding}")
    defaults = {
        "byte_order": _BYTE_ORDERS.index(byte_order),
        "caption_encoding": ENCODINGS.index(caption_encoding),
    }
    code = (files("servolink.doctor.wireshark") / "dissector.lua").read_text(encoding="utf-8")
    return "\n".join([FIRST_LINE, "", *_tables(defaults), "", code])


def _tables(defaults: dict[str, int]) -> Iterator[str]:
    """Yield the lines of the Lua tables: default preferences, fields, packets, and characters of Big5."""
    yield f"local DEFAULTS = {_lua(defaults)}"
    yield "local FIELDS = {"
    yield from (f"  {_lua(field)}," for field in _fields())
    yield "}"
    yield "local PACKETS = {"
    yield from (f"  [{packet_id}] = {_lua(_packet(declared))}," for packet_id, declared in sorted(PACKETS.items()))
    yield "}"
    yield "local BIG5 = { -- by lead byte, the characters of all trail bytes"
    yield from (f"  [{lead}] = {_lua(characters)}," for lead, characters in _big5())
    yield "}"


def _fields() -> list[tuple[str, str, str]]:
    """Return name, kind and meaning of each field of all packets, each name once."""
    found: dict[str, tuple[str, str, str]] = {}
    for _, declared in sorted(PACKETS.items()):
        for field in layout(declared, "little").fields:
            if not field.items:
                found.setdefault(field.name, (field.name, field.code or "data", field.meaning))
            elif not _is_plain(field):
                found.setdefault(field.name, (field.name, "group", ""))
            for each in field.items:
                found.setdefault(each.name, (each.name, each.code, each.meaning))
    return sorted(found.values())


def _packet(declared: type[Packet]) -> dict[str, Any]:
    """Return the description of a packet for the dissector, as a table."""
    rule = layout(declared, "little").rule
    described: dict[str, Any] = {
        "name": declared.__name__,
        "section": declared.section,
        "rule": [rule.base, rule.unit, rule.limit],
        "values": [],
    }
    if issubclass(declared, Response):
        described["from_board"] = True
        if issubclass(declared, Result):
            described["is_result"] = True
    elif echoed := _echoed(declared):
        described["echoed"] = echoed
    for field in layout(declared, "little").fields:
        if field.items:
            items = [_value(each) for each in field.items]
            described["group"] = {"name": field.name, "count": field.code, "size": rule.unit, "values": items}
        elif not field.code:
            described["data"] = field.name
        else:
            described["values"].append(_value(field))
    return described


def _is_plain(group: Field) -> bool:
    """Return whether the items of a group are plain numbers."""
    return [each.name for each in group.items] == [group.name]


def _value(field: Field) -> list[Any]:
    """Return name, `struct` code and meanings of numbers, taken from a description such as "0 failed, 1 done"."""
    meanings = {int(number): text.strip() for number, text in _MEANING.findall(field.meaning)}
    is_list = re.match(r"\d+ (?!in )", field.meaning) is not None
    return [field.name, field.code, *([meanings] if is_list else [])]


def _echoed(declared: type[Packet]) -> str:
    """Return the request field that identifies its response among others; empty without such a field."""
    response = PACKETS.get(declared.packet_id + 1)
    if response is None:
        return ""
    answered = {each.name for field in layout(response, "little").fields for each in (field, *field.items)}
    names = (field.name for field in layout(declared, "little").fields)
    return getattr(declared, "echoed", "") or next((name for name in names if name in answered), "")


def _big5() -> Iterator[tuple[int, str]]:
    """Yield each lead byte of Big5, an encoding unknown to Wireshark, and the characters of its trail bytes."""
    trails = [*range(0x40, 0x7F), *range(0xA1, 0xFF)]
    for lead in range(0xA1, 0xFA):
        yield lead, "".join(bytes((lead, trail)).decode("big5", "replace")[0] for trail in trails)


def _lua(found: Any) -> str:
    """Return a value as Lua source text."""
    match found:
        case bool():
            return "true" if found else "false"
        case int():
            return str(found)
        case str():
            escaped = found.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
            return f'"{escaped}"'
        case dict():
            keys = {key: key if isinstance(key, str) else f"[{key}]" for key in found}
            return "{ " + ", ".join(f"{keys[key]} = {_lua(each)}" for key, each in found.items()) + " }"
        case _:
            return "{ " + ", ".join(map(_lua, found)) + " }"


FILE_NAME = "servolink.lua"
"""Name of the dissector in the folder of plugins."""


def plugin_folder(platform: str = sys.platform, environment: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of personal Lua plugins, existing or not, as in the User's Guide of Wireshark.

    Raise ServolinkError for a user without a home.
    """
    variable, folders = (
        ("APPDATA", "Wireshark/plugins") if platform == "win32" else ("HOME", ".local/lib/wireshark/plugins")
    )
    if not (home := environment.get(variable)):
        raise ServolinkError(
            f"{variable} is not set, so Wireshark has no personal plugins; set the variable, or print the text"
        )
    return Path(home, folders)


def install(text: str) -> Path:
    """Write the dissector into the folder of personal plugins and return the path. Replace only an older dissector."""
    path = plugin_folder() / FILE_NAME
    try:
        if path.exists() and not read_file(path, MIB).startswith(FIRST_LINE.encode()):
            raise ServolinkError(
                f"{path} was not written by servolink; remove the file, or print the text and keep both"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, text.encode())
    except (OSError, ValueError) as error:
        raise ServolinkError(f"{path} cannot be written: {reason(error)}") from error
    return path
