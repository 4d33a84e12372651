"""TOML edited by people: errors with line numbers."""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import Any

_MOST_DOTS = 1000
_LONGEST = 10  # lines of a value at most, for the number of its first line
_PLACE = re.compile(r" \(at line (\d+), column \d+\)$| \(at end of document\)$")


class TextError(ValueError):
    """Error in a text, with the line number."""

    def __init__(self, text: str, line: int) -> None:
        super().__init__(text)
        self.text = text
        self.line = line

    @classmethod
    def at(cls, path: Sequence[str], toml: str, text: str) -> TextError:
        """Return the error at the value `path` of a TOML text, or else at the nearest enclosing table."""
        return cls(text, _line_of(toml, path))


def read_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text. Raise TextError for any other text."""
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
    for number, line in enumerate(text.split("\n"), 1):
        if line.count(".") >= _MOST_DOTS and not line.lstrip().startswith("#"):
            raise TextError(f"has {_MOST_DOTS:,} dots or more in line {number}", number)
    return tomllib.loads(text)


def _line_of(text: str, path: Sequence[str]) -> int:
    """Return the number of the line where the value at `path` begins, or else the nearest table around it."""
    whole, lines = tomllib.loads(text), text.split("\n")
    while not _holds(whole, path):
        path = path[:-1]

    def is_in_first(count: int) -> bool:
        for end in range(count, min(count + _LONGEST, len(lines)) + 1):
            try:
                return _holds(tomllib.loads("\n".join([*lines[:end], ""])), path)
            except tomllib.TOMLDecodeError:  # the beginning of a value of several lines
                continue
        return False

    return max(1, bisect_left(range(len(lines) + 1), True, key=is_in_first))  # noqa: FBT003 - what is looked for


def _holds(table: object, path: Sequence[str]) -> bool:
    for name in path:
        if not isinstance(table, dict) or name not in table:
            return False
        table = table[name]
    return True


def changed_toml(text: str, tables: Mapping[str, object]) -> str:
    """Return `text` with the content of `tables`; comments, spacing and the form of other values stay.

    None means unknown: the line becomes a comment, `# name =`, and such a comment becomes a value again.
    """
    from servolink.boards.toml_changes import change_toml

    return change_toml(text, tables)


def _last_line(text: str) -> int:
    return text.rstrip("\n").count("\n") + 1


def _bad_line(text: str) -> int:
    """Return the number of the first line with an impossible number or date, or else of the last line."""
    lines = text.split("\n")
    for number, line in enumerate(lines, 1):
        try:
            tomllib.loads(line)
        except tomllib.TOMLDecodeError:
            continue
        except ValueError:
            return number
    return len(lines)
