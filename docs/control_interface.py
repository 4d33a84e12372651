"""docs/reference/control-interface.md and its JSON Schema, made from the declarations of the messages."""

from __future__ import annotations

import ast
import inspect
import json
import re
import textwrap
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect as types

from servolink.control.error_codes import KINDS, REMEDIES, ErrorData, ErrorObject
from servolink.control.greeting import VERSION, Greeting, Welcome
from servolink.control.notifications import NOTIFICATIONS
from servolink.control.peer import MOST_BEGUN, MOST_WAITING, Method
from servolink.hub import METHODS
from servolink.hub.method_messages import CREDIT

_FOLDER = Path(__file__).parent
_OWN = ("servolink.control.", "servolink.hub.")
PAGE = _FOLDER / "reference/control-interface.md"
SCHEMA = _FOLDER / "reference/control-interface.schema.json"
EXAMPLE = _FOLDER / "examples/control-interface/watch.mjs"

_INTRODUCTION = """\
# Control interface

Programs in any language use [a shared board](../how-to/share-a-board.md) through JSON-RPC 2.0: to see who is connected,
to move within the limits of the board, to watch servos and buttons, and to change what is stored. This page is made
from the declarations in `servolink/control/` and `servolink/hub/`, as is the
[JSON Schema](control-interface.schema.json) of all messages;
[The hub](../design/hub.md#the-control-interface) says why it is built so.

## Connecting

A hub named `rex` listens on the Unix socket `servolink/rex.sock` in the runtime folder of its user (`XDG_RUNTIME_DIR`,
usually `/run/user/1000`), which nobody else can open. On Windows the private file `rex.door` in that folder has the
`port` of 127.0.0.1 that takes the place of the socket, and a `token` for the greeting. Each message is one line: a JSON
object in UTF-8, at most 1 MiB. The first line of a program is its greeting:

{greeting}

The hub answers with its welcome, or with `{{"error": "..."}}` before it closes the connection:

{welcome}

Both have more fields, for programs that send packets. Then the program sends requests. This program in JavaScript is
all that it takes:

```js
{example}```

## Requests

A request is `{{"jsonrpc": "2.0", "id": 1, "method": "status", "params": {{}}}}`. Params are given by name, and unknown
ones are refused. Integers are written without a fraction: `1.0` is refused where the schema wants an integer. `id` is
text or an integer; a request without `id` is carried out and not answered, not even with an error. Batches are refused:
send the next request without waiting for the response to the one before.

Requests of one program that move or change something are carried out in their order, each when the one before is
answered. Others are carried out beside them, `stop` and `stream.send` at once. At most {waiting} requests of a program
wait; more are answered with `busy`. A stop is always carried out; a program that has {begun} under way is told `busy`
for more, not what came of them. A stop of any program also ends what waits and would move: that is answered with
MotionRefused. A program that sends requests and does not read its responses is disconnected.

A role includes those before it: watch, run, move, edit. The greeting asks for one.

Each method says what it touches: *session* is the connection of the program, *motion* the servos, *board* the content
and the settings of the board, *host* the computer of the hub. Pages that were opened through a link of the
[studio](../how-to/fleet-classroom.md#use-tablets-one-robot-many-pupils) touch nothing of the host. [From
afar](fleet.md#commands), through a broker, come only the methods that say so.

## Notifications

Notifications have `method` and `params`, and no `id`. They come from the first request of a program on, so call
`status` or `board.state` first, and then keep what it returned up to date. While a program does not read, up to 256 of
them are kept; `problem` then says how many were dropped.

Of `servos` a program gets at most {credit} that it has not acknowledged with `servos.ack`, and then the latest state:
acknowledge each one when it is drawn.

## Errors

An error has `code`, `message` and `data`:

{error}

| code | kind | what to do |
| --- | --- | --- |
{errors}

## Methods

| method | role | |
| --- | --- | --- |
{methods}
"""
_DRAFT = "https://json-schema.org/draft/2020-12/schema"


def schema_text() -> str:
    """Return the schema: `methods`, `notifications` and `errors` refer to the types in `$defs`."""
    return json.dumps(schema(), indent=2) + "\n"


def schema() -> dict[str, Any]:
    """Return the schema as an object."""
    types = [Greeting, ErrorObject, *NOTIFICATIONS.values()]
    for method in METHODS.values():
        types += [method.params, method.result]
    found, definitions = msgspec.json.schema_components(types, ref_template="#/$defs/{name}")
    for each in definitions.values():
        if "description" in each:  # a docstring, which Python leaves indented before 3.13
            each["description"] = inspect.cleandoc(each["description"])
    of = dict(zip(map(id, types), found, strict=True))
    return {
        "$schema": _DRAFT,
        "title": "servolink control interface",
        "version": VERSION,
        "greeting": of[id(Greeting)],
        "methods": {
            method.name: {
                "description": method.summary,
                "role": str(method.role),
                "touches": method.scope.words.split(", ") if method.scope.touches else [],
                "from_afar": method.scope.from_afar,
                "params": of[id(method.params)],
                "result": of[id(method.result)],
            }
            for method in METHODS.values()
        },
        "notifications": {name: of[id(params)] for name, params in NOTIFICATIONS.items()},
        "error": of[id(ErrorObject)],
        "errors": {
            **{code.name.lower(): {"code": int(code), "remedy": remedy} for code, remedy in REMEDIES.items()},
            **{kind.error.__name__: {"code": kind.code, "remedy": kind.remedy} for kind in KINDS},
        },
        "$defs": definitions,
    }


def control_interface() -> str:
    """Return the page, in MyST Markdown."""
    methods = "\n".join(
        f"| [`{method.name}`](#{_anchor(method.name)}) | {method.role} | {_first_sentence(method.summary)} |"
        for method in METHODS.values()
    )
    errors = [(int(code), code.name.lower(), remedy) for code, remedy in REMEDIES.items()]
    errors += [(kind.code, kind.error.__name__, kind.remedy) for kind in KINDS]
    introduction = _INTRODUCTION.format(
        greeting=_table(Greeting, without={"byte_order", "angle_unit"}),
        welcome=_table(Welcome, without={"patience", "profile", "lease", "hold"}),
        example=EXAMPLE.read_text(encoding="utf-8"),
        waiting=MOST_WAITING,
        begun=MOST_BEGUN,
        credit=CREDIT,
        error=_table(ErrorData),
        errors="\n".join(f"| {code} | {kind} | {remedy} |" for code, kind, remedy in errors),
        methods=methods,
    )
    parts = [introduction, *map(_method, METHODS.values()), "## Kinds of notifications\n"]
    parts += [section(name, params) for name, params in NOTIFICATIONS.items()]
    parts.append("## Types\n")
    parts += [section(declared.__name__, declared) for declared in _types()]
    return "\n".join(parts)


def section(name: str, declared: type) -> str:
    """Return what the reference says of a type."""
    return f"### {name}\n\n{inspect.cleandoc(declared.__doc__ or '')}\n\n{_table(declared)}\n"


def _anchor(name: str) -> str:
    return name.replace(".", "").replace("_", "").lower()


def anchor_of(name: str) -> str:
    """Return the anchor of a type, whose heading may differ from that of a method in nothing but dots and capitals."""
    is_second = name.lower() in map(_anchor, METHODS) and name in {each.__name__ for each in _types()}
    return f"{name.lower()}-1" if is_second else name.lower()


def _first_sentence(text: str) -> str:
    return " ".join(text.partition(".\n")[0].partition(". ")[0].split()).removesuffix(".")


def _method(method: Method[Any]) -> str:
    lines = [f"### {method.name}", "", method.summary, "", _rights(method), ""]
    params: Any = types.type_info(method.params)
    if isinstance(params, types.UnionType):
        lines += [f"Params: {_text(params)}.", ""]
    elif params.fields:
        lines += [_table(method.params), ""]
    return "\n".join([*lines, f"Result: {_text(types.type_info(method.result))}.", ""])


def _rights(method: Method[Any]) -> str:
    afar = " Comes from afar too." if method.scope.from_afar else ""
    return f"Role: {method.role}. Touches: {method.scope.words}.{afar}"


def _types() -> list[type]:
    """Return each type of the hub that is not shown where it is used, by name."""
    used_once = {*NOTIFICATIONS.values(), *(method.params for method in METHODS.values())}
    found = dict[str, type]()
    walked = set[type]()  # blocks can hold blocks
    waiting: list[Any] = [*used_once, *(method.result for method in METHODS.values())]
    while waiting:
        for struct in _structs(types.type_info(waiting.pop())):
            walked.add(struct.cls)
            for field in struct.fields:
                inside = [inner.cls for inner in _structs(field.type)]
                waiting += [cls for cls in inside if cls not in walked]
                found |= {cls.__name__: cls for cls in inside if cls in used_once}
            if struct.cls.__module__.startswith(_OWN) and struct.cls not in used_once:
                found[struct.cls.__name__] = struct.cls
    return [found[name] for name in sorted(found)]


def _structs(info: Any) -> Iterator[types.StructType]:
    """Yield the types of objects in a type, but not those in them."""
    match info:
        case types.Metadata():
            yield from _structs(info.type)
        case types.StructType():
            yield info
        case types.UnionType():
            for member in info.types:
                yield from _structs(member)
        case types.VarTupleType():
            yield from _structs(info.item_type)
        case _:
            pass


def _table(declared: type, without: Collection[str] = ()) -> str:
    """Return a table of the fields of a type."""
    info: Any = types.type_info(declared)
    if not info.fields:
        return "No fields."
    notes = _notes(declared)
    rows = ["| field | type | meaning |", "| --- | --- | --- |"]
    if info.tag is not None:
        rows.append(f"| `{info.tag_field}` | `{info.tag}` |  |")
    for field in info.fields:
        if field.name not in without:
            meaning = "; ".join(filter(None, (_meaning(field.type) or notes.get(field.name, ""), _default(field))))
            rows.append(f"| `{field.encode_name}` | {_text(field.type)} | {meaning} |")
    return "\n".join(rows)


def _meaning(info: Any) -> str:
    """Return the description in the annotation of a field."""
    if isinstance(info, types.Metadata):
        return str((info.extra_json_schema or {}).get("description", "")) or _meaning(info.type)
    return ""


def _notes(declared: type) -> dict[str, str]:
    """Return the strings behind the fields in the source of a type, by the name of the field."""
    try:
        tree: Any = ast.parse(textwrap.dedent(inspect.getsource(declared))).body[0]
    except (OSError, TypeError):  # a type that was not written as a class
        return {}
    found = {}
    for node, after in zip(tree.body, tree.body[1:], strict=False):
        if isinstance(node, ast.AnnAssign) and isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            found[ast.unparse(node.target)] = (
                " ".join(str(after.value.value).split()).removesuffix(".").replace("None", "null")
            )
    return found


def _default(field: types.Field) -> str:
    """Return the default of a field, if it has one that says something."""
    default = field.default
    if isinstance(default, bool):
        return f"default {str(default).lower()}"
    if isinstance(default, (int, float)):
        return f"default {default:g}"
    return f'default "{default}"' if isinstance(default, str) and default else ""


def _text(info: Any) -> str:
    """Return a type in words, with links to other types."""
    while isinstance(info, types.Metadata):
        info = info.type
    match info:
        case types.IntType() | types.FloatType():
            return ("integer" if isinstance(info, types.IntType) else "number") + _range(info)
        case types.LiteralType():
            return ", ".join(f"`{value}`" for value in info.values)
        case types.UnionType():
            return " or ".join(map(_text, info.types))
        case types.VarTupleType():
            return f"list of {_plural(info.item_type)}"
        case types.TupleType():
            return f"[{', '.join(map(_text, info.item_types))}]"
        case types.DictType():
            return f"object of {_plural(info.value_type)}".removesuffix(" of anything")
        case types.StructType():
            name, is_own = info.cls.__name__, info.cls.__module__.startswith(_OWN)
            return f"[{name}]({f'#{anchor_of(name)}' if is_own else 'project-file.md'})"
        case _:
            return _WORDS.get(type(info), "anything")


def _plural(info: Any) -> str:
    """Return the type of the values in a list or an object, in words."""
    return re.sub(r"^(integer|number)", r"\1s", _text(info))


_WORDS: dict[Any, str] = {types.StrType: "text", types.BoolType: "true or false", types.NoneType: "null"}


def _range(info: types.IntType | types.FloatType) -> str:
    low = f"above {info.gt:g}" if info.gt is not None else "" if info.ge is None else f"at least {info.ge:g}"
    high = "" if info.le is None else f"at most {info.le:g}"
    return "".join(f", {bound}" for bound in (low, high) if bound)
