"""The JSON Schema of the control interface, made from the declarations of its messages."""

from __future__ import annotations

import json
from typing import Any

import msgspec

from servolink.control.faults import KINDS, REMEDIES, ErrorObject
from servolink.control.greeting import VERSION, Greeting
from servolink.control.notifications import NOTIFICATIONS
from servolink.hub.methods.session import METHODS

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
