"""TOML edited by people: errors with line numbers, and changes to single values that keep comments and spacing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Any

from servolink.escaping import escape

if TYPE_CHECKING:
    from tomlkit.container import Container
    from tomlkit.items import Item, Table

_UNUSUAL = re.compile(r"[^ !#-\[\]-~]")
_HEADER = re.compile(r"\s*\[\[?(?P<name>[^\[\]]+)\]")
_KEY = re.compile(r"""\s*(?P<name>("[^"]*"|'[^']*'|[\w-]+)(\s*\.\s*("[^"]*"|'[^']*'|[\w-]+))*)\s*=""", re.ASCII)
_KEY_PART = re.compile(r""""([^"]*)"|'([^']*)'|([\w-]+)""", re.ASCII)
_UNKNOWN_COMMENT = re.compile(r"(?P<indent>[ \t]*)#[ \t]*(?P<name>[\w-]+)[ \t]*=[ \t]*(?P<rest>(#.*)?)$", re.ASCII)
_UNKNOWN = "servolink: unknown value"
_UNKNOWN_VALUE = re.compile(rf'^(?P<indent>[ \t]*)(?P<name>[^\n=]*[^\n= ]) *= *"{_UNKNOWN}"', re.MULTILINE)
_PLACEHOLDER = 0
_HEXADECIMAL = {"vendor_id", "product_id"}
_MOST_DOTS = 1000
_PLACE = re.compile(r" \(at line (\d+), column \d+\)$| \(at end of document\)$")


class TextError(ValueError):
    """Error in a text, with the line number."""

    def __init__(self, text: str, line: int) -> None:
        super().__init__(text)
        self.text = text
        self.line = line


def read_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raise TextError for any other text."""
    import tomllib  # imported late: needed for reading only

    try:
        return parse_toml(text)
    except TextError:
        raise
    except tomllib.TOMLDecodeError as error:
        place = _PLACE.search(message := str(error))
        line = int(place[1]) if place and place[1] else _last_line(text)
        raise TextError(f"is not TOML: {_PLACE.sub('', message)}", line) from None
    except RecursionError:
        raise TextError("is nested too deeply", 1) from None
    except ValueError:  # such as an integer of thousands of digits, or the 31st of February
        raise TextError("is not TOML: a number or a date is impossible", _bad_line(text)) from None


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text, as `tomllib.loads` does, within a few seconds.

    Raise TextError for a line with 1,000 dots: a key of many parts takes time with their square.
    """
    import tomllib

    for number, line in enumerate(text.split("\n"), 1):
        if line.count(".") >= _MOST_DOTS and not line.lstrip().startswith("#"):
            raise TextError(f"has {_MOST_DOTS:,} dots or more in line {number}", number)
    return tomllib.loads(text)


def line_of(text: str, path: Sequence[str]) -> int:
    """Return the line number of the value at `path`, or else of the nearest enclosing table."""
    best, found = 0, 1
    for number, keys in _keys(text):
        if len(keys) > best and tuple(keys) == tuple(path[: len(keys)]):
            best, found = len(keys), number
    return found


def changed_toml(text: str, tables: Mapping[str, object]) -> str:
    """Return `text` with the content of `tables`; comments, spacing and the form of other values stay.

    None means unknown: the line becomes a comment, `# name =`, and such a comment becomes a value again.
    """
    import tomlkit  # imported late: needed for writing only

    newline = "\r\n" if "\r\n" in text else "\n"
    lines = text.replace("\r\n", "\n")
    document = tomlkit.parse(_with_values(lines if lines.endswith("\n") or not lines else f"{lines}\n", tables))
    _change(document, tables)
    return _UNKNOWN_VALUE.sub(r"\g<indent># \g<name> =", tomlkit.dumps(document)).replace("\n", newline)


def toml_value(name: str, value: object) -> str:
    """Return a value as TOML, with USB ids in hexadecimal and control characters escaped."""
    if isinstance(value, str):
        return '"' + _UNUSUAL.sub(_escape_match, value) + '"'
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(toml_value(name, each) for each in value)}]"
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    return f"{value:#06x}" if name in _HEXADECIMAL and isinstance(value, int) else repr(value).removesuffix(".0")


def _with_values(text: str, tables: Mapping[str, object]) -> str:
    """Return `text` with a placeholder value in place of each comment `# name =` for a known setting."""
    lines, table = text.split("\n"), tables
    for number, line in enumerate(lines):
        if header := _HEADER.match(line):
            table = _part_of(tables, _parts(header["name"]))
        elif (comment := _UNKNOWN_COMMENT.match(line)) and table.get(comment["name"]) is not None:
            lines[number] = f"{comment['indent']}{comment['name']} = {_PLACEHOLDER}{comment['rest']}"
    return "\n".join(lines)


def _part_of(tables: Mapping[str, object], path: Sequence[str]) -> Mapping[str, object]:
    for name in path:
        part = tables.get(name)
        if not isinstance(part, Mapping):
            return {}
        tables = part
    return tables


def _change(table: Any, values: Mapping[str, object]) -> None:
    """Set the content of a table of tomlkit to `values`; tomlkit has a type for each form of tables."""
    from tomlkit import value as parse_value
    from tomlkit.items import InlineTable

    for name in [name for name in table if name not in values or _becomes_table(table[name], values[name])]:
        _remove(table, name)
    for name, value in values.items():
        if isinstance(value, Mapping):
            if name in table:
                _change(table[name], value)
            elif any(each is not None for each in value.values()):
                _add_table(table, name, value)
        elif value is None and name in table:
            if isinstance(table, InlineTable):
                del table[name]
            else:
                table[name] = _UNKNOWN
        elif value is not None and not (name in table and _is_same(table[name], value)):
            item = parse_value(toml_value(name, value))
            if name in table or not hasattr(
                table, "append"
            ):  # no `append`: a table in several pieces, joined by tomlkit
                table[name] = item
            else:
                _add(table, name, item)


def _becomes_table(item: Any, value: object) -> bool:
    return isinstance(value, Mapping) and not isinstance(item, Mapping)


def _is_same(item: Any, value: object) -> bool:
    found = item if isinstance(item, bool) else item.unwrap()  # tomlkit returns flags as they are
    return found == (list(value) if isinstance(value, tuple) else value) and isinstance(found, bool) == isinstance(
        value, bool
    )


def _add_table(table: Any, name: str, values: Mapping[str, object]) -> None:
    from tomlkit import inline_table
    from tomlkit import table as new_table
    from tomlkit.items import InlineTable

    if isinstance(table, InlineTable):
        added: Any = inline_table()
    else:
        added = new_table(is_super_table=all(isinstance(each, Mapping) for each in values.values()))
        added.trivia.indent = "\n"
    _change(added, values)
    if hasattr(table, "append"):
        _add(table, name, added)
    else:
        table[name] = added


def _add(table: Any, name: str, item: Item) -> None:
    """Add a value or a table in front of the comments at the end: comments there belong to the next header."""
    body = _body(table)
    end: list[Any] = []
    while body and body[-1][0] is None:
        end.insert(0, body.pop())
    table.append(name, item)
    body.extend(end)


def _remove(table: Any, name: str) -> None:
    """Remove a value or a table, but keep the comments at the end: comments there belong to the next header."""
    from tomlkit import ws
    from tomlkit.items import Table

    item, body = table[name], _body(table)
    index = next((at for at, (key, _) in enumerate(body) if key is not None and key.key == name), None)
    table.remove(name)
    if isinstance(item, Table) and index is not None:
        body[index] = (None, ws(_end_of(item).removeprefix("\n")))


def _end_of(table: Table) -> str:
    """Return the comments and empty lines at the end of a table."""
    from tomlkit.items import Table

    end = ""
    for key, item in reversed(table.value.body):
        if key is not None:
            return (_end_of(item) if isinstance(item, Table) else "") + end
        end = item.as_string() + end
    return end


def _body(table: Any) -> list[Any]:
    container: Container = getattr(table, "value", table)
    return container.body if hasattr(container, "body") else []


def _keys(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line and full name of each table and each value at the beginning of a line."""
    table: list[str] = []
    in_text = False  # between three quotes, where a line may look like a key
    for number, line in enumerate(text.split("\n"), 1):
        if not in_text:
            if header := _HEADER.match(line):
                table = _parts(header["name"])
                yield number, table
            elif key := _KEY.match(line):
                yield number, table + _parts(key["name"])
        in_text ^= (line.count('"""') + line.count("'''")) % 2 == 1


def _parts(name: str) -> list[str]:
    return ["".join(part) for part in _KEY_PART.findall(name)]


def _last_line(text: str) -> int:
    return text.rstrip("\n").count("\n") + 1


def _bad_line(text: str) -> int:
    """Return the number of the first line with an impossible number or date, or else of the last line."""
    import tomllib

    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        try:
            tomllib.loads(line)
        except tomllib.TOMLDecodeError:
            continue
        except ValueError:
            return number
    return len(lines)


def _escape_match(found: re.Match[str]) -> str:
    character = found[0]
    is_plain = character not in '"\\' and escape(character) == character
    return character if is_plain else f"\\U{ord(character):08x}"
