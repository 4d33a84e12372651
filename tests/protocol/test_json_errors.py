"""Errors in JSON values of any declared type, in the words of their author."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, Struct

from servolink.errors import EncodeError
from servolink.protocol.json_errors import convert


class Inner(Struct, frozen=True, forbid_unknown_fields=True):
    flag: bool = False


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
        ({"kinds": 1}, "'kinds' is not a field; the fields are speed, small"),
    ],
)
def test_the_error_says_where_and_why(value: Any, text: str) -> None:
    with pytest.raises(EncodeError) as caught:
        convert(value, Outer)
    assert str(caught.value).startswith(text)
