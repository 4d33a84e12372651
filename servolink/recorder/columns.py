"""Columns and rows of tables with messages: a row for each message, or for each servo of a reading."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_type_hints

import msgspec

from servolink.recorder.channels import Message, ServosRead, ServoState

_FIRST = {"seconds": float, "time_ns": int}


def columns(kind: type) -> dict[str, Any]:
    """Return the columns of a table with messages of one kind: names, with the types of the values."""
    if kind is ServosRead:  # without captions, as in the file of `servolink watch`
        servo = {name: hint for name, hint in get_type_hints(ServoState).items() if name != "caption"}
        return _FIRST | servo | {"missed": int}
    hints = get_type_hints(kind)
    return _FIRST | {"took_seconds" if name in _FIRST else name: hint for name, hint in hints.items()}


def rows(seconds: float, time: int, message: Message) -> Iterator[tuple[Any, ...]]:
    """Yield the rows of a message, with a value for each column."""
    if isinstance(message, ServosRead):
        for servo in message.servos:
            values = (getattr(servo, name) for name in servo.__struct_fields__ if name != "caption")
            yield seconds, time, *values, message.missed
    else:
        yield seconds, time, *msgspec.structs.astuple(message)
