"""Errors quote what boards and files contain, and are safe to print."""

from __future__ import annotations

import pickle
import traceback

import pytest

from servolink.errors import (
    ConnectionLost,
    DecodeError,
    EncodeError,
    OpenError,
    OutcomeUnknown,
    ProjectError,
    RequestTimeout,
    ServolinkError,
    TargetNotReached,
)
from servolink.escaping import escape, quote
from servolink.protocol.codec import Codec
from servolink.protocol.editing import AddActionRequest, AddServoParameterRequest
from servolink.protocol.records import ServoParameter, Step

HOSTILE = "a\x1b[2J\n\u202eb\udcff"
ESCAPED = r"a\x1b[2J\x0a\u202eb\xff"

ERRORS = [
    ServolinkError,
    OpenError,
    ConnectionLost,
    EncodeError,
    DecodeError,
    RequestTimeout,
    OutcomeUnknown,
    TargetNotReached,
    ProjectError,
]


@pytest.mark.parametrize("kind", ERRORS)
def test_the_text_of_an_error_is_escaped(kind: type[ServolinkError]) -> None:
    error = kind(HOSTILE)
    assert str(error) == f"{error}" == ESCAPED
    assert error.args == (HOSTILE,)
    assert ESCAPED in "".join(traceback.format_exception(error))
    assert "\x1b" not in repr(error)


def test_escaping_twice_changes_nothing() -> None:
    assert str(ProjectError(str(ProjectError(HOSTILE)))) == escape(ESCAPED) == ESCAPED
    assert str(ProjectError(quote(HOSTILE))) == quote(HOSTILE)


def test_an_encode_error_names_the_place_inside_the_packet() -> None:
    with pytest.raises(EncodeError) as refused:
        Codec().encode(AddActionRequest(1, "", (Step(1, 2, 3), Step(1, 40_000, 3))))
    error = refused.value
    assert (error.packet, error.path) == ("AddActionRequest", "steps[1].degree")
    assert error.text == "40000 is outside -32768..32767"
    assert str(error) == f"AddActionRequest.steps[1].degree: {error.text}"


def test_the_parts_of_an_encode_error_are_escaped_as_well() -> None:
    with pytest.raises(EncodeError) as refused:
        Codec().encode(AddServoParameterRequest((ServoParameter(1, 0, HOSTILE),)))
    assert refused.value.path == "servos[0].servo_caption"
    assert refused.value.text == f"'{ESCAPED}' holds control characters; captions are plain text"


def test_errors_survive_pickling() -> None:
    error = pickle.loads(pickle.dumps(EncodeError("\x1b", "steps[1]", "Packet")))  # noqa: S301 - made here
    assert (error.path, error.packet, str(error)) == ("steps[1]", "Packet", r"Packet.steps[1]: \x1b")
