"""Errors: safe to print whatever boards and files contain, on one side or the other, with a reason for programs.

Module: servolink.errors.
"""

from __future__ import annotations

import ast
import errno
import inspect
import pickle
import re
import traceback
from pathlib import Path

import pytest

from servolink import errors
from servolink.control import KINDS, ErrorData, ErrorObject
from servolink.errors import (
    ConnectionLost,
    DecodeError,
    EncodeError,
    LocalError,
    MotionRefused,
    OpenError,
    OutcomeUnknown,
    ProjectError,
    Reason,
    RemoteError,
    RequestRefused,
    RequestTimeout,
    ServolinkError,
    SeveralBoards,
    TargetNotReached,
    escape,
    quote,
)
from servolink.protocol import AddActionRequest, AddServoParameterRequest, Codec, ServoParameter, Step
from tests.syntax import tree_of

PACKAGE = Path(errors.__file__).parent
CLASSES = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, ServolinkError)]
BASES = {"ServolinkError", "TransportError", "PacketError", "RequestError"}
ON_NEITHER_SIDE = {
    "TransportUnavailable": "a library or a plug-in is missing",
    "ProfileError": "a file",
    "OpenError": "a port, or the network; `reason` says more",
    "ConnectionLost": "a cable, or the network",
    "ProjectError": "a file, or the content of a board",
    "RecordingError": "a file",
    "TwinError": "a file, or a library is missing",
}
"""Errors whose cause is neither the program nor the board alone."""

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


@pytest.mark.parametrize(
    ("text", "quoted"),
    [
        ("b\udcff", r"'b\xff'"),
        ("\\\udc80", r"'\\\x80'"),
        (r"\udcff", r"'\\udcff'"),
        ("\ud800", r"'\ud800'"),
        ("\udc8f" * 99, "'" + r"\x8f" * 19 + "..."),
    ],
)
def test_an_undecodable_byte_is_quoted_as_it_is_escaped(text: str, quoted: str) -> None:
    assert quote(text) == quoted


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


def test_each_error_is_on_one_side_at_most() -> None:
    sides = {kind.__name__: (issubclass(kind, LocalError), issubclass(kind, RemoteError)) for kind in CLASSES}
    assert not [name for name, both in sides.items() if all(both)]
    assert {name for name, either in sides.items() if not any(either)} == BASES | ON_NEITHER_SIDE.keys()


def test_each_error_has_a_code_in_the_control_interface() -> None:
    never_sent = {LocalError, RemoteError, SeveralBoards}
    assert {kind.error for kind in KINDS} == set(CLASSES) - never_sent


def test_no_error_says_only_that_a_request_failed() -> None:
    vague = {"TransportError", "PacketError", "RequestError", "LocalError", "RemoteError"}
    found = [
        f"{module.relative_to(PACKAGE)}:{node.lineno}"
        for module in PACKAGE.rglob("*.py")
        if re.search(rf"raise ({'|'.join(vague)})\b", module.read_text(encoding="utf-8"))
        for node in ast.walk(tree_of(module))
        if isinstance(node, ast.Raise)
        and isinstance(node.exc, ast.Call)
        and isinstance(node.exc.func, ast.Name)
        and node.exc.func.id in vague
    ]
    assert found == []


@pytest.mark.parametrize("kind", CLASSES)
def test_a_reason_reaches_programs_through_a_hub_and_survives_pickling(kind: type[ServolinkError]) -> None:
    error = kind("text", reason=Reason.STOP)
    told = ErrorObject.of(pickle.loads(pickle.dumps(error)))  # noqa: S301 - made here
    assert (told.message, told.data.reason) == ("text", "stop")
    assert told.as_error().reason is Reason.STOP
    assert kind("text").reason is Reason.OTHER


def test_a_reason_of_a_newer_hub_is_another_one() -> None:
    data = ErrorData("MotionRefused", "", reason="full moon")
    assert ErrorObject(202, "text", data).as_error().reason is Reason.OTHER


@pytest.mark.parametrize(
    ("cause", "reason"),
    [
        (FileNotFoundError(errno.ENOENT, "none"), Reason.NOT_FOUND),
        (OSError(errno.EBUSY, "busy"), Reason.IN_USE),
        (PermissionError(errno.EACCES, "denied"), Reason.NO_PERMISSION),
        (ValueError("no number"), Reason.OTHER),
        (RequestRefused("a stop came first", reason=Reason.STOP), Reason.STOP),
    ],
)
def test_the_reason_is_that_of_the_cause_unless_one_is_given(cause: Exception, reason: Reason) -> None:
    with pytest.raises(OpenError) as found:
        raise OpenError("not opened") from cause
    assert found.value.reason is reason
    with pytest.raises(MotionRefused) as found_other:
        raise MotionRefused("refused", reason=Reason.LEASE) from cause
    assert found_other.value.reason is Reason.LEASE
