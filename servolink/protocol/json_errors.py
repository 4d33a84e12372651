"""What is wrong in a project file, in the words of whoever wrote it."""

from __future__ import annotations

import json
import re
from typing import Any

from msgspec import inspect

from servolink.escaping import escape, quote
from servolink.protocol.json_form import SCHEMA

_PART = re.compile(r"\.([^.\[]+)|\[(\d+)\]")
_AT = " - at `$"


def version_fault(said: Any) -> str:
    """Say why `said` is in no format that this library reads; empty if it is."""
    if not isinstance(said, dict):
        return f"{_written(said)} is no project, which is an object"
    if "schema" not in said:
        return f'"schema" is missing; a project file begins with "schema": {SCHEMA}'
    version = said["schema"]
    if type(version) is not int or version < SCHEMA:
        return f"schema: {_written(version)} is no version of the format; {SCHEMA} is"
    if version > SCHEMA:
        return f"schema: {_written(version)} is newer than {SCHEMA}, which this servolink reads; use a newer one"
    return ""


def fault(message: str, said: Any, file_type: Any) -> tuple[str, str]:
    """Return where in `said` and why it is no `file_type`; `message` is what msgspec says of it."""
    opinion, _, where = message.rpartition(_AT)
    # What is wrong with the whole is said without a place, so what looks like one may be in the name of a field.
    path = where.rstrip("`") if opinion and not any(_AT in key for key in said) else ""
    info, value = inspect.type_info(file_type), said
    for found in _PART.finditer(path):
        key, number = found.groups()
        info, value = (_field(info, value, key), value[key]) if key else (_item(info), value[int(number)])
    return path.removeprefix("."), _reason(info, value) or escape(opinion or message)


def _item(info: Any) -> Any:
    return info.item_type


def _field(info: Any, value: dict[str, Any], key: str) -> Any:
    """Return the type of a field of `value`."""
    kinds = _kinds(info)
    if key == "type":
        return inspect.LiteralType(tuple(kind.tag for kind in kinds))
    (kind,) = (kind for kind in kinds if kind.tag is None or kind.tag == value.get("type"))
    field = next(field for field in kind.fields if field.encode_name == key)
    return field.type.type if isinstance(field.type, inspect.Metadata) else field.type


def _kinds(info: Any) -> tuple[Any, ...]:
    """Return the types of objects that `info` admits."""
    members = info.types if isinstance(info, inspect.UnionType) else (info,)
    return tuple(member for member in members if isinstance(member, inspect.StructType))


def _reason(info: Any, value: Any) -> str:
    """Say what is wrong with `value` itself, whatever is in it; empty if nothing is."""
    if isinstance(info, inspect.IntType):
        return _no_number(info, value)
    if isinstance(info, inspect.StrType):
        return _no_caption(info, value)
    if isinstance(info, inspect.LiteralType):
        return f"{_written(value)} is none of {', '.join(map(str, info.values))}"
    if isinstance(info, inspect.VarTupleType):
        return "" if isinstance(value, list) else f"{_written(value)} is no list"
    if kinds := _kinds(info):
        return _no_object(kinds, value)
    if isinstance(info, inspect.UnionType) and type(value) is int:
        return next(_no_number(member, value) for member in info.types if isinstance(member, inspect.IntType))
    return f"{_written(value)} is neither an integer nor null"


def _no_number(info: inspect.IntType, value: Any) -> str:
    if type(value) is not int:
        return f"{_written(value)} is no integer"
    if info.multiple_of and value % info.multiple_of:
        return f"{_written(value)} is no multiple of {info.multiple_of}, in which boards count"
    return f"{_written(value)} is outside {info.ge}..{info.le}"


def _no_caption(info: inspect.StrType, value: Any) -> str:
    if not isinstance(value, str):
        return f"{_written(value)} is no text"
    if info.max_length is not None and len(value) > info.max_length:
        return f"{_written(value)} has {len(value)} characters; a caption has at most {info.max_length} bytes"
    return f"{_written(value)} holds control characters; captions are plain text"


def _no_object(kinds: tuple[Any, ...], value: Any) -> str:
    if not isinstance(value, dict):
        return f"{_written(value)} is no object"
    if kinds[0].tag is not None and "type" not in value:
        return f'"type" is missing; it is one of {", ".join(kind.tag for kind in kinds)}'
    (kind,) = (kind for kind in kinds if kind.tag is None or kind.tag == value["type"])
    names = [*(["type"] if kind.tag is not None else []), *(field.encode_name for field in kind.fields)]
    if unknown := [key for key in value if key not in names]:
        return f"{_written(unknown[0])} is no field; there are {', '.join(names)}"
    missing = [field.encode_name for field in kind.fields if field.required and field.encode_name not in value]
    return f"{', '.join(map(_written, missing))} {'is' if len(missing) == 1 else 'are'} missing" if missing else ""


def _written(value: Any) -> str:
    """Return `value` as it is written in the file, safe to show and not long."""
    return (
        quote(value) if isinstance(value, (int, str, list, dict)) and not isinstance(value, bool) else json.dumps(value)
    )
