"""Inputs that once failed; each fault is fixed and must stay fixed."""

from __future__ import annotations

from typing import NamedTuple


class Recorded(NamedTuple):
    """An input that failed."""

    target: str
    """The name of the target in `targets.TARGETS`."""
    data: bytes
    wrong: str


RECORDED = (
    Recorded(
        "object",
        b'{"id": 30110, "fields": {"servos": [{"servo_id": 1, "serv\x7f_caption": ""}]}}',
        "an error repeated the name of a field with a control character in it",
    ),
    Recorded(
        "object",
        b'{"id": 20050, "fields": {"steps": [{"servo_id": 1, "degree": 2, "interval": 3, "q - at `$.x": 1}]}}',
        "a field whose name looks like the end of an error ended in a KeyError",
    ),
    Recorded(
        "project",
        b'{"schema": 1, "x` - at `$.actions[9]": 1}',
        "a field whose name looks like the end of an error ended in a KeyError",
    ),
    Recorded(
        "parse",
        bytes.fromhex(
            "001700170300010203040501000000fc00000000000000000000000000000000000000000100ffa01d1501d8134c051d4e752b00"
            "00000080e5898de980b2000000000000000000000000000000000000cb000000000000000100ffa01d1501d8"
        ),
        "a frame found by rescanning was not searched itself, and had swallowed the frame behind the noise by chance",
    ),
    Recorded(
        "parse",
        bytes.fromhex(
            "00fffffffff7ffff00ffc8c8c8c8c8c8c8c8c824f0f0f0f0f0f0f0c8c8f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0"
            "f0f0f0f0f0f0f0f0f0f0f0f0f0f0f02df0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0f0"
            "f0f0f0f0f0f0f0f0f0c8c8c8c8c8c8c85cc8c8c8c8c8c8c8c8c8c8c8c8c8c840c8c8c8c8f7c8aaf0f0f0f0"
        ),
        "a frame found with the help of padding counted as ending later than it did, where the search had got to",
    ),
)
