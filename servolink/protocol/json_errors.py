"""Errors in JSON values: path and reason, in the words of the author of the JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import msgspec
from msgspec import inspect

from servolink.errors import EncodeError, quote

_PART = re.compile(r"\.([^.\[]+)|\[(\d+)\]")
_AT = " - at `$"
_SURROGATE = re.compile("[\ud800-\udfff]")
_type_info = cache(inspect.type_info)  # reads the annotations of all nested classes, which takes milliseconds


def convert(value: Any, expected: Any) -> Any:
    """Return `value`, as read by `json`, converted to the type `expected`.

    Raise EncodeError with `path` (the place in `value`) and `text` (the reason). Only `convert` translates errors of
    msgspec.
    """
    try:
        return msgspec.convert(value, expected, builtin_types=[bytes])
    except msgspec.ValidationError as error:
        path, text = _explain(str(error), value, expected)
        raise EncodeError(text, path) from None
    except UnicodeEncodeError as error:
        if (encodable := _without_surrogates(value)) == value:
            raise EncodeError(f"{quote(error.object)} is not text") from None
        # Half a character in a field name or a type: msgspec fails before the place is known. With any other wrong
        # character in the same place, msgspec names the place.
        return convert(encodable, expected)


def _without_surrogates(value: Any) -> Any:
    if isinstance(value, str):
        return _SURROGATE.sub("\ufffd", value)
    if isinstance(value, dict):
        return {_without_surrogates(key): _without_surrogates(one) for key, one in value.items()}
    return [_without_surrogates(one) for one in value] if isinstance(value, list) else value


def _explain(message: str, value: Any, expected: Any) -> tuple[str, str]:
    """Return the place in `value` and the reason why `expected` was not met; `message` is msgspec's."""
    opinion, _, where = message.rpartition(_AT)
    # An error in the whole value names no place; apparent places may be part of a field's name.
    is_placed = opinion and not (isinstance(value, dict) and any(_AT in key for key in value))
    path = (where.rstrip("`") if is_placed else "").partition("[...]")[0]  # msgspec leaves a key without a name
    info: Any = _type_info(expected)
    for found in _PART.finditer(path):
        key, number = found.groups()
        info, value = (_field(info, value, key), value[key]) if key else (_item(info, int(number)), value[int(number)])
    return path.removeprefix("."), _reason(info, value) or opinion or message


def _field(info: Any, value: dict[str, Any], key: str) -> Any:
    """Return the type of a field of `value`."""
    structs = _structs(_bare(info))
    if key == structs[0].tag_field:
        return inspect.LiteralType(tuple(struct.tag for struct in structs))
    (struct,) = (struct for struct in structs if struct.tag is None or struct.tag == value.get(struct.tag_field))
    field = next(field for field in struct.fields if field.encode_name == key)
    return _bare(field.type)


def _item(info: Any, number: int) -> Any:
    """Return the type of an item of a list."""
    members = info.types if isinstance(info, inspect.UnionType) else (info,)
    (info,) = (member for member in map(_bare, members) if isinstance(member, _LISTS))
    return _bare(info.item_types[number] if isinstance(info, inspect.TupleType) else info.item_type)


_LISTS = (inspect.ListType, inspect.VarTupleType, inspect.TupleType)


def _bare(info: Any) -> Any:
    return info.type if isinstance(info, inspect.Metadata) else info


def _structs(info: Any) -> tuple[Any, ...]:
    """Return the types of objects allowed by `info`."""
    members = info.types if isinstance(info, inspect.UnionType) else (info,)
    return tuple(member for member in members if isinstance(member, inspect.StructType))


def _reason(info: Any, value: Any) -> str:
    """Return the fault of `value` itself, apart from its contents; empty without a fault."""
    info = _bare(info)
    if structs := _structs(info):
        return _wrong_object(structs, value)
    if type(info) in _REASONS:
        return _REASONS[type(info)](info, value)
    return f"must be {_WORDS.get(type(info), 'something else')}, not {quote_json(value)}"


_WORDS: dict[type, str] = {
    inspect.IntType: "an integer",
    inspect.FloatType: "a number",
    inspect.StrType: "text",
    inspect.BoolType: "true or false",
    inspect.NoneType: "null",
    inspect.VarTupleType: "a list",
}
_TYPES: dict[type, tuple[type, ...]] = {
    inspect.IntType: (int,),
    inspect.FloatType: (int, float),
    inspect.StrType: (str,),
    inspect.LiteralType: (str, int),
    inspect.TupleType: (list, tuple),
    inspect.VarTupleType: (list, tuple),
}


def _wrong_values(info: inspect.DictType, value: Any) -> str:
    """Return the faulty value of an object with free keys, and the fault; empty if all values are right."""
    if not isinstance(value, dict):
        return f"must be an object, not {quote_json(value)}"
    expected = _bare(info.value_type)
    for key, one in value.items():
        if isinstance(expected, inspect.DictType):
            if wrong := _wrong_values(expected, one):
                return f"{quote(key)}: {wrong}"
        elif type(one) not in _TYPES.get(type(expected), ()):
            return f"{quote(key)} {_reason(expected, one)}"
    if info.max_length is not None and len(value) > info.max_length:
        return f"has {len(value)} items; at most {info.max_length}"
    return ""


def _wrong_choice(info: inspect.UnionType, value: Any) -> str:
    """Return why `value` has none of several types: the reason of the nearest type."""
    members: list[Any] = [_bare(one) for one in info.types]
    for member in members:
        if type(value) in _TYPES.get(type(member), ()):
            return _reason(member, value)
    words = [_WORDS.get(type(member)) or ", ".join(map(str, member.values)) for member in members]
    return f"must be {' or '.join(words)}, not {quote_json(value)}"


def _wrong_number(info: inspect.FloatType, value: Any) -> str:
    if type(value) not in {int, float}:
        return f"must be a number, not {quote_json(value)}"
    low = f"above {info.gt:g}" if info.gt is not None else "" if info.ge is None else f"at least {info.ge:g}"
    high = f"below {info.lt:g}" if info.lt is not None else "" if info.le is None else f"at most {info.le:g}"
    return f"must be {' and '.join(filter(None, (low, high))) or 'a smaller number'}, not {quote_json(value)}"


def _wrong_integer(info: inspect.IntType, value: Any) -> str:
    if type(value) is not int:
        return f"must be an integer, not {quote_json(value)}"
    if info.multiple_of and value % info.multiple_of:
        return f"must be a multiple of {info.multiple_of}, the unit in which boards count, not {quote_json(value)}"
    return f"{quote_json(value)} is outside {info.ge}..{info.le}"


def _wrong_literal(info: inspect.LiteralType, value: Any) -> str:
    return f"must be one of {', '.join(map(str, info.values))}, not {quote_json(value)}"


def _wrong_list(info: inspect.VarTupleType, value: Any) -> str:
    if not isinstance(value, (list, tuple)):
        return f"must be a list, not {quote_json(value)}"
    return f"has {len(value)} items; at most {info.max_length}"


def _wrong_tuple(info: inspect.TupleType, value: Any) -> str:
    return f"must be a list of {len(info.item_types)} items, not {quote_json(value)}"


def _wrong_text(info: inspect.StrType, value: Any) -> str:
    if not isinstance(value, str):
        return f"must be text, not {quote_json(value)}"
    if info.max_length is not None and len(value) > info.max_length:
        most = (
            f"at most {info.max_length}" if info.pattern is None else f"a caption has at most {info.max_length} bytes"
        )
        return f"{quote_json(value)} has {len(value)} characters; {most}"
    return f"{quote_json(value)} holds control characters; captions are plain text"


def _wrong_object(structs: tuple[Any, ...], value: Any) -> str:
    if not isinstance(value, dict):
        return f"must be an object, not {quote_json(value)}"
    tag_field = structs[0].tag_field
    if tag_field is not None and tag_field not in value:
        return f'"{tag_field}" is missing; it must be one of {", ".join(struct.tag for struct in structs)}'
    (struct,) = (struct for struct in structs if tag_field is None or struct.tag == value[tag_field])
    names = [*([tag_field] if tag_field is not None else []), *(field.encode_name for field in struct.fields)]
    if unknown := [key for key in value if key not in names]:
        return f"{quote_json(unknown[0])} is not a field; the fields are {', '.join(names)}"
    missing = [field.encode_name for field in struct.fields if field.required and field.encode_name not in value]
    return f"{', '.join(map(quote_json, missing))} {'is' if len(missing) == 1 else 'are'} missing" if missing else ""


_REASONS: dict[type, Callable[[Any, Any], str]] = {
    inspect.IntType: _wrong_integer,
    inspect.FloatType: _wrong_number,
    inspect.StrType: _wrong_text,
    inspect.LiteralType: _wrong_literal,
    inspect.VarTupleType: _wrong_list,
    inspect.TupleType: _wrong_tuple,
    inspect.DictType: _wrong_values,
    inspect.UnionType: _wrong_choice,
}


def quote_json(value: Any) -> str:
    """Return `value` in JSON notation, escaped and shortened."""
    is_own_word = value is None or isinstance(value, (bool, float))  # null, true, NaN
    return json.dumps(value) if is_own_word else quote(value)
