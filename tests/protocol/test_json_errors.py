"""Errors in JSON values of any declared type, in the words of their author."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, Struct

from servolink.errors import EncodeError
from servolink.protocol.json_errors import convert


class Inner(Struct, frozen=True, forbid_unknown_fields=True):
    flag: bool = False


class Turn(Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="turn"):
    servo: int


class Wait(Struct, frozen=True, forbid_unknown_fields=True, tag_field="type", tag="wait"):
    ms: Annotated[int, Meta(ge=0, le=990, multiple_of=10)]


class Outer(Struct, forbid_unknown_fields=True):
    speed: Annotated[float, Meta(gt=0, le=5)] = 1.0
    small: Annotated[float, Meta(ge=-1, lt=1)] = 0.0
    number: float = 0.0
    targets: dict[str, float] = {}
    pause: float | None = None
    which: Annotated[int | str, Meta(description="an id, or a caption")] = 1
    kind: Literal["action", "macro"] | None = None
    inner: Inner = Inner()
    reason: Annotated[str, Meta(max_length=5)] = ""
    caption: Annotated[str, Meta(max_length=5, pattern=r"^[^\x00-\x1f]*$")] = ""
    sides: dict[str, dict[str, int]] = {}
    steps: Annotated[tuple[Turn | Wait, ...], Meta(max_length=2)] = ()
    pair: tuple[int, int] = (0, 0)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"speed": "x"}, "speed: must be a number, not 'x'"),
        ({"speed": True}, "speed: must be a number, not true"),
        ({"speed": 7}, "speed: must be above 0 and at most 5, not 7"),
        ({"small": 1}, "small: must be at least -1 and below 1, not 1"),
        ({"number": 10**400}, "number: must be a smaller number, not 1000"),
        ({"inner": {"flag": 1}}, "inner.flag: must be true or false, not 1"),
        ({"inner": []}, "inner: must be an object, not []"),
        ({"targets": []}, "targets: must be an object, not []"),
        ({"targets": {"hip": 1, "\u202e": "2"}}, r"targets: '\u202e' must be a number, not '2'"),
        ({"targets": {"hip": 10**400}}, "targets: Number out of range"),
        ({"pause": "s"}, "pause: must be a number or null, not 's'"),
        ({"which": 1.5}, "which: must be an integer or text, not 1.5"),
        ({"which": None}, "which: must be an integer or text, not null"),
        ({"kind": "table"}, "kind: must be one of action, macro, not 'table'"),
        ({"kind": []}, "kind: must be action, macro or null, not []"),
        ({"reason": "too long"}, "reason: 'too long' has 8 characters; at most 5"),
        ({"reason": 5}, "reason: must be text, not 5"),
        ({"caption": "too long"}, "caption: 'too long' has 8 characters; a caption has at most 5 bytes"),
        ({"caption": "\a"}, "caption: '\\x07' holds control characters; captions are plain text"),
        ({"sides": {"left": []}}, "sides: 'left': must be an object, not []"),
        ({"sides": {"right": {}, "left": {"hip": "1"}}}, "sides: 'left': 'hip' must be an integer, not '1'"),
        ({"steps": 1}, "steps: must be a list, not 1"),
        ({"steps": [{}, {}, {}]}, "steps: has 3 items; at most 2"),
        ({"steps": [{}]}, 'steps[0]: "type" is missing; it must be one of turn, wait'),
        ({"steps": [{"type": "turn"}]}, "steps[0]: 'servo' is missing"),
        ({"steps": [{"type": "wait", "ms": "x"}]}, "steps[0].ms: must be an integer, not 'x'"),
        ({"steps": [{"type": "wait", "ms": 15}]}, "steps[0].ms: must be a multiple of 10, the unit in which boards"),
        ({"steps": [{"type": "wait", "ms": 1000}]}, "steps[0].ms: 1000 is outside 0..990"),
        ({"pair": 1}, "pair: must be a list of 2 items, not 1"),
        ({"pair": [1]}, "pair: must be a list of 2 items, not [1]"),
        ({"kinds": 1}, "'kinds' is not a field; the fields are speed, small"),
    ],
)
def test_the_error_says_where_and_why(value: Any, text: str) -> None:
    with pytest.raises(EncodeError) as caught:
        convert(value, Outer)
    assert str(caught.value).startswith(text)
