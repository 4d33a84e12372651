"""The text of a project file: JSON that is safe to show, with one record of numbers a line."""

from __future__ import annotations

import json
import re
from collections import Counter
from typing import Any, NoReturn

from servolink.errors import ProjectError
from servolink.escaping import escape, quote

MAX_SIZE = 16 * 1024 * 1024
"""Bytes of the largest file, ten times what fills a megabyte on a board and still read in a second or two."""
_ENCODER = json.JSONEncoder(ensure_ascii=False)
_PERHAPS_HIDDEN = re.compile(r"[^\n -~]")


class _Doubled:
    """Stands for an object that has a key twice."""

    def __init__(self, key: str) -> None:
        self.key = key


def read_text(text: str | bytes) -> Any:
    """Return what JSON `text` says; ProjectError if it is none, or says something twice."""
    if len(text) > MAX_SIZE:
        raise ProjectError(f"is larger than the {MAX_SIZE >> 20} MiB that a project file may have")
    try:
        plain = text if isinstance(text, str) else text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ProjectError(f"is no text in UTF-8 (byte {error.start}); save it as UTF-8") from error
    doubled: list[_Doubled] = []

    def once(pairs: list[tuple[str, Any]]) -> Any:
        found = dict(pairs)
        if len(found) == len(pairs):
            return found
        [(key, _)] = Counter(key for key, _ in pairs).most_common(1)
        doubled.append(_Doubled(key))
        return doubled[-1]

    try:
        said = json.loads(plain, object_pairs_hook=once, parse_constant=_no_number)
    except json.JSONDecodeError as error:
        raise ProjectError(
            f"is no JSON: {error.msg} in line {error.lineno}, column {error.colno}; correct it there"
        ) from error
    except ValueError as error:
        raise ProjectError("holds a number that is none, or one of thousands of digits; a board has neither") from error
    except RecursionError as error:
        raise ProjectError("holds lists in lists without end; a project has a few levels") from error
    if doubled:
        outermost = doubled[-1]  # the last to end is in no other
        where = place(said, outermost)
        raise ProjectError(f"{where}{': ' if where else ''}{quote(outermost.key)} is there twice; keep one of them")
    return said


def write_text(value: Any) -> str:
    """Return `value` as JSON that a terminal can show: objects of nothing but numbers and texts take a line each."""
    return _PERHAPS_HIDDEN.sub(_escaped, _lines(value, "\n")) + "\n"


def _lines(value: Any, margin: str) -> str:
    inner = margin + "  "
    if isinstance(value, list) and value:
        return f"[{','.join(inner + _lines(one, inner) for one in value)}{margin}]"
    if isinstance(value, dict) and any(isinstance(one, list) for one in value.values()):
        return (
            f"{{{','.join(f'{inner}{json.dumps(key)}: {_lines(one, inner)}' for key, one in value.items())}{margin}}}"
        )
    return _ENCODER.encode(value)


def _escaped(found: re.Match[str]) -> str:
    character = found[0]
    return character if escape(character) == character else json.dumps(character)[1:-1]


def _no_number(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def place(said: Any, sought: object) -> str:
    """Return where in `said` an object, or a text as value or key, stands, such as `actions[3].steps[7]`."""
    waiting = [("", said)]
    while waiting:
        path, value = waiting.pop()
        if value is sought or (isinstance(value, dict) and any(key is sought for key in value)):
            return escape(path.removeprefix("."))
        if isinstance(value, dict):
            waiting += [(f"{path}.{key}", one) for key, one in value.items() if not isinstance(one, int)]
        elif isinstance(value, list):
            waiting += [(f"{path}[{at}]", one) for at, one in enumerate(value) if not isinstance(one, int)]
    return ""
