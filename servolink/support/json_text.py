"""JSON text, read strictly and written readably: the text of project files."""

from __future__ import annotations

import json
import re
import sys
from codecs import BOM_UTF8
from collections import Counter
from itertools import accumulate
from typing import Any, NamedTuple, NoReturn

from servolink.errors import escape, quote
from servolink.support.files import reason

MAX_SIZE = 16 * 1024 * 1024
"""Most bytes of a text: ten times a board's megabyte in JSON, still read in one or two seconds."""
_LONGEST_PATH = 200
_ENCODER = json.JSONEncoder(ensure_ascii=False)
_MOST_LEVELS = 1000  # in Pyodide, where some thousand overflow the stack of JavaScript, which ends Python
_TEXT_OR_BRACKET = re.compile(r'"(?:[^"\\]|\\.)*"|[][{}]', re.DOTALL)
_PERHAPS_HIDDEN = re.compile(r"[^\n -~]")


def read_json(text: str | bytes) -> Any:
    """Return the value of a JSON text. Raise ValueError with place and reason.

    Stricter than `json`: no name twice in an object, no NaN or infinity.
    """
    if len(text) > MAX_SIZE:
        raise ValueError(f"is larger than {MAX_SIZE >> 20} MiB, the limit")
    try:
        # Not by "utf-8-sig": Python reads a file for that codec, and a full process could not hear a stop.
        plain = text if isinstance(text, str) else text.removeprefix(BOM_UTF8).decode()
    except UnicodeDecodeError as error:
        raise ValueError(reason(error)) from error
    repeated: list[_Repeated] = []

    def read_object(pairs: list[tuple[str, Any]]) -> Any:
        value = dict(pairs)
        if len(value) == len(pairs):
            return value
        [(key, _)] = Counter(key for key, _ in pairs).most_common(1)
        repeated.append(_Repeated(key))
        return repeated[-1]

    try:
        _refuse_depth(plain)
        value = json.loads(plain, object_pairs_hook=read_object, parse_constant=_refuse_constant)
    except json.JSONDecodeError as error:
        raise ValueError(
            f"is not JSON: {error.msg} in line {error.lineno}, column {error.colno}; correct the text there"
        ) from error
    except RecursionError as error:
        raise ValueError("is nested too deeply") from error
    except _NotJSON:
        raise
    except ValueError as error:  # Python's limit
        raise ValueError("contains an integer of thousands of digits") from error
    if repeated:
        outermost = repeated[-1]  # the object to end last contains the others
        path = _path_to(value, outermost)
        raise ValueError(f"{path}{': ' if path else ''}{quote(outermost.key)} is a duplicate key; keep one entry")
    return value


def _refuse_depth(text: str) -> None:
    """Raise RecursionError in Pyodide if too many lists and objects are open at one place of a JSON text."""
    if sys.platform == "emscripten":
        levels = accumulate((each in "[{") - (each in "]}") for each in _TEXT_OR_BRACKET.findall(text))
        if max(levels, default=0) > _MOST_LEVELS:
            raise RecursionError


def write_json(value: Any) -> str:
    """Return `value` as printable JSON, each object or list of numbers and texts in one line."""
    return _PERHAPS_HIDDEN.sub(_escape_match, _lines(value, "\n")) + "\n"


class _NotJSON(ValueError):
    """Error for values accepted by Python's `json` and absent from JSON, such as NaN."""


class _Repeated:
    """Placeholder for an object with a duplicate key."""

    def __init__(self, key: str) -> None:
        self.key = key


def _lines(value: Any, margin: str) -> str:
    inner = margin + "  "
    if value and _has_lines(value):
        return f"[{','.join(inner + _lines(one, inner) for one in value)}{margin}]"
    if isinstance(value, dict) and any(map(_has_lines, value.values())):
        return (
            f"{{{','.join(f'{inner}{json.dumps(key)}: {_lines(one, inner)}' for key, one in value.items())}{margin}}}"
        )
    return _ENCODER.encode(value)


def _has_lines(value: Any) -> bool:
    """Return whether `value` is written over several lines: a list of objects or lists, or an empty list to fill."""
    return isinstance(value, list) and (not value or any(isinstance(one, (list, dict)) for one in value))


def _escape_match(found: re.Match[str]) -> str:
    character = found[0]
    return character if escape(character) == character else json.dumps(character)[1:-1]


def _refuse_constant(name: str) -> NoReturn:
    raise _NotJSON(f"is not JSON: {name} is not a number")


def _path_to(value: Any, sought: object) -> str:
    """Return the path of an object in `value`, such as `actions[3].steps[7]`; a long path is cut."""
    # Places are linked from the inside out: a full path each would repeat long names for every object inside.
    waiting: list[_Place] = [_Place(value, None, "")]
    while waiting:
        place = waiting.pop()
        inner = place.value
        if inner is sought:
            path = _path_of(place)
            return path if len(path) <= _LONGEST_PATH else f"{path[: _LONGEST_PATH - 3]}..."
        if isinstance(inner, dict):
            waiting += [_Place(one, place, key) for key, one in inner.items() if isinstance(one, _CONTAINERS)]
        elif isinstance(inner, list):
            waiting += [_Place(one, place, at) for at, one in enumerate(inner) if isinstance(one, _CONTAINERS)]
    return ""


class _Place(NamedTuple):
    """Place of a value inside a larger value."""

    value: Any
    around: _Place | None
    """Place of the object or list around the value; None for the whole text."""
    key: str | int


def _path_of(place: _Place) -> str:
    parts: list[str] = []
    while place.around is not None:
        parts.append(f".{place.key}" if isinstance(place.key, str) else f"[{place.key}]")
        place = place.around
    return "".join(reversed(parts)).removeprefix(".")


_CONTAINERS = (dict, list, _Repeated)
