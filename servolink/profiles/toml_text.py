"""TOML text: errors with their line, and values written so that they are safe to print."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

from servolink.escaping import escape

_UNUSUAL = re.compile(r"[^ !#-\[\]-~]")
_HEADER = re.compile(r"\s*\[\[?(?P<name>[^\[\]]+)\]")
_KEY = re.compile(r"""\s*(?P<name>("[^"]*"|'[^']*'|[\w-]+)(\s*\.\s*("[^"]*"|'[^']*'|[\w-]+))*)\s*=""", re.ASCII)
_KEY_PART = re.compile(r""""([^"]*)"|'([^']*)'|([\w-]+)""", re.ASCII)
_PLACE = re.compile(r" \(at line (\d+), column \d+\)$| \(at end of document\)$")


class TextError(ValueError):
    """Fault in a text, with its line."""

    def __init__(self, text: str, line: int) -> None:
        """Keep both."""
        super().__init__(text)
        self.text = text
        self.line = line


def read_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raise TextError for any other text."""
    import tomllib  # late: needed for reading only

    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = _PLACE.search(message := str(error))
        line = int(place[1]) if place and place[1] else _last_line(text)
        raise TextError(f"is not TOML: {_PLACE.sub('', message)}", line) from None
    except RecursionError:
        raise TextError("is nested too deeply", 1) from None
    except ValueError:  # such as an integer of thousands of digits, or the 31st of February
        raise TextError("is not TOML: it has a number or a date that cannot be", _bad_line(text)) from None


def line_of(text: str, path: Sequence[str]) -> int:
    """Return the number of the line in which the value at `path` is set, or else of the table that it is in."""
    best, found = 0, 1
    for number, keys in _keys(text):
        if len(keys) > best and tuple(keys) == tuple(path[: len(keys)]):
            best, found = len(keys), number
    return found


def toml_value(value: object) -> str:
    """Return `value` as TOML writes it: text, number, time, or a list of those."""
    if isinstance(value, str):
        return '"' + _UNUSUAL.sub(_escape_match, value) + '"'
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, datetime):
        return value.isoformat().replace("+00:00", "Z")
    return repr(value).removesuffix(".0")


def toml_lines(values: Mapping[str, object]) -> str:
    """Return the lines of a table, without its header."""
    return "".join(f"{key} = {toml_value(value)}\n" for key, value in values.items())


def _keys(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line and full name of each table and each value, as far as they begin a line."""
    table: list[str] = []
    in_text = False  # between three quotes, where lines only look like keys
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
    """Return the first line without which the text before it is fine; the last one if there is none such."""
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
