"""Every declaration against the document: `protocol.json`, transcribed by hand, and its table of lengths."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, get_args, get_type_hints

import msgspec
import pytest

from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.codec import PACKETS
from servolink.protocol.layouts import layout
from servolink.protocol.packet import Caption, Command, Counted, FieldFormat, Packet, Query, Request, Response
from tests.protocol.declared import DOCUMENT, snake_case
from tests.syntax import tree_of
from tests.tables import over

DOCUMENTED: list[dict[str, Any]] = DOCUMENT["packets"]
CODES = {"u8": "B", "u16": "H", "u32": "I", "i16": "h", "i32": "i", "char[32]": "32s"}

LENGTHS = """
10011 10021 30031 30041 30071 30081 30091 30111 30121 40031 40041 40051 40071: 1
10031: 4 or 8
10041: 2
20011: 1+n
20021: 1+11n
20031: 3
20041: 2
30011 30051 40011: 2+36n
30021: 38+5n
30061: 38+12n
30101: 2+35n
30131 40061: 4
40021: 38+49n
40081: 5
"""
"""The length of each response (n: the count field inside)."""

CHAPTERS = {"3.1": settings, "3.2": servos, "3.3": editing, "3.4": joystick}


def test_there_are_31_requests_28_responses_and_one_push() -> None:
    kinds = [Query, Request, Command, Response]
    requests = [declared for declared in PACKETS.values() if not issubclass(declared, Response)]
    assert len(PACKETS) == 60
    assert len(requests) == 31
    assert sum(issubclass(declared, Command) for declared in requests) == 3
    assert sum(packet_id - 1 not in PACKETS for packet_id in PACKETS) == 31 + 1
    assert all(issubclass(declared, tuple(kinds)) for declared in PACKETS.values())


@cache
def written_answers(chapter: ModuleType) -> dict[str, str]:
    """Return the class in the brackets behind `Request` or `Query`, which only type checkers read, by name."""
    classes = [node for node in tree_of(Path(str(chapter.__file__))).body if isinstance(node, ast.ClassDef)]
    bases = [(each.name, base) for each in classes for base in each.bases]
    return {name: ast.unparse(base.slice) for name, base in bases if isinstance(base, ast.Subscript)}


class TestDeclaration:
    """Each packet in the document and its declaration."""

    @over("described", DOCUMENTED)
    def test_name_section_and_chapter(self, described: dict[str, Any]) -> None:
        declared = PACKETS[described["id"]]
        assert declared.__name__ == described["name"]
        assert declared.section == described["section"]
        assert vars(CHAPTERS[described["section"][:3]])[described["name"]] is declared

    @over("described", DOCUMENTED)
    def test_direction(self, described: dict[str, Any]) -> None:
        from_board = described["direction"] == "server-to-client"
        assert issubclass(PACKETS[described["id"]], Response) == from_board
        assert described["id"] % 10 == from_board

    @over("described", DOCUMENTED)
    def test_who_answers(self, described: dict[str, Any]) -> None:
        declared = PACKETS[described["id"]]
        if issubclass(declared, Request):
            answer = PACKETS[described["id"] + 1]
            assert answer.__name__ == written_answers(CHAPTERS[described["section"][:3]])[declared.__name__]
        else:
            assert described["id"] + 1 not in PACKETS

    @over("described", DOCUMENTED)
    def test_fields(self, described: dict[str, Any]) -> None:
        assert written(PACKETS[described["id"]]) == documented(described["fields"])

    @over("described", DOCUMENTED)
    def test_it_is_frozen_and_documented(self, described: dict[str, Any]) -> None:
        declared = PACKETS[described["id"]]
        config = declared.__struct_config__
        assert config.frozen
        assert not config.gc
        assert re.fullmatch(r"[A-Z].*\.", declared.__doc__ or "")


def documented(fields: list[dict[str, Any]]) -> list[tuple[str, Any]]:
    """Return names and wire codes in order; a group as (code of the count, fields), without counts."""
    counts = {field["repeat"]: field for field in fields if "repeat" in field}
    shape: list[tuple[str, Any]] = []
    for field in fields:
        name = snake_case(field["name"])
        if "repeat" in field:
            count = next(other for other in fields if other["name"] == field["repeat"])
            shape.append((name, (CODES[count["type"]], documented(field["fields"]))))
        elif field["name"] not in counts:
            shape.append((name, CODES.get(field["type"], field["type"])))
    return shape


def written(declared: type[msgspec.Struct]) -> list[tuple[str, Any]]:
    """Return the same for a declaration."""
    hints = get_type_hints(declared, include_extras=True)
    return [(name, _shape(hints[name], name)) for name in declared.__struct_fields__]


def _shape(hint: Any, name: str) -> Any:
    if hint is bytes or bytes in get_args(hint):
        return "bytes"
    counted = next((entry for entry in getattr(hint, "__metadata__", ()) if isinstance(entry, Counted)), None)
    if counted is None:
        return _wire(hint)
    item = get_args(get_args(hint)[0])[0]
    if isinstance(item, type) and issubclass(item, msgspec.Struct):
        return counted.count, written(item)
    return counted.count, [(name.removesuffix("_list"), _wire(item))]


def _wire(hint: Any) -> str:
    """Return the wire code in an annotation, however deeply nested."""
    found = [entry.code for entry in getattr(hint, "__metadata__", ()) if isinstance(entry, FieldFormat)]
    for argument in get_args(hint):
        found += [code] if (code := _wire(argument)) else []
    return found[0] if found else ""


def _length_rules() -> list[tuple[int, int, int, set[int]]]:
    rules = []
    for line in LENGTHS.split("\n")[1:-1]:
        ids, _, rule = line.partition(": ")
        base, _, unit = rule.replace(" or 8", "").partition("+")
        per_record = int(unit.removesuffix("n") or 1) if unit else 0
        rules += [
            (int(packet_id), int(base), per_record, {8} if " or " in rule else set()) for packet_id in ids.split()
        ]
    return rules


def test_the_table_has_a_length_for_every_answer() -> None:
    assert {rule[0] for rule in _length_rules()} == {id_ for id_, kind in PACKETS.items() if issubclass(kind, Response)}


@over("packet_id, base, unit, more", _length_rules())
def test_the_parser_admits_just_the_lengths_of_the_table(packet_id: int, base: int, unit: int, more: set[int]) -> None:
    rule = layout(PACKETS[packet_id], "little").rule
    most = 255 if packet_id in (20011, 20021) else 65_535
    wanted = more | {base + unit * n for n in range(most + 1 if unit else 1) if base + unit * n <= 65_535}
    assert {length for length in range(65_536) if rule.admits(length)} == wanted


@over("described", DOCUMENTED)
def test_a_request_too_has_the_length_of_its_fields(described: dict[str, Any]) -> None:
    sizes = {"u8": 1, "u16": 2, "i16": 2, "i32": 4, "u32": 4, "char[32]": 32, "bytes": 0}
    fixed = sum(sizes[field["type"]] for field in described["fields"] if "type" in field)
    groups = [field["fields"] for field in described["fields"] if "repeat" in field]
    rule = layout(PACKETS[described["id"]], "big").rule
    if described["id"] == 10031:
        assert (rule.base, rule.unit, rule.limit) == (4, 4, 1)
    elif any(field.get("type") == "bytes" for field in described["fields"]):
        assert (rule.base, rule.unit, rule.limit) == (0, 1, 65_535)
    else:
        assert rule.base == fixed
        assert rule.unit == sum(sizes[field["type"]] for group in groups for field in group)


def test_captions_are_32_bytes() -> None:
    assert _wire(Caption) == CODES["char[32]"] == "32s"


def test_packets_cannot_be_changed() -> None:
    packet: Packet = servos.QueryServoRequest(1)
    with pytest.raises(AttributeError):
        packet.servo_id = 2  # type: ignore[attr-defined]
