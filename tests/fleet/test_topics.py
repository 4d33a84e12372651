"""The topics of a fleet and what is sent there."""

from __future__ import annotations

import json

import msgspec
import pytest

from servolink.errors import InvalidAddress
from servolink.fleet.topics import METHODS as OWN
from servolink.fleet.topics import BoardCommand, BoardResult, Topics, needs_pulse, schema, scope_of
from servolink.hub import METHODS


def test_a_board_has_topics_below_the_prefix() -> None:
    topics = Topics("school/room1")
    assert topics.board("rex", "state") == "school/room1/rex/state"
    assert topics.board("+", "available") == "school/room1/+/available"
    assert topics.fleet("stop") == "school/room1/_fleet/stop"
    assert topics.parse("school/room1/rex/state") == ("rex", "state")


@pytest.mark.parametrize("prefix", ["", "/", "a/", "/a", "a//b", "a+", "#", "$SYS", "a\nb", "\ud800", "x" * 201])
def test_a_prefix_of_something_else_is_refused(prefix: str) -> None:
    with pytest.raises(InvalidAddress, match="cannot be a prefix"):
        Topics(prefix)


@pytest.mark.parametrize("name", ["", "_fleet", "a/b", "a+", "#", "rex\n", "ré", "x" * 65])
def test_a_board_cannot_be_called_like_something_else(name: str) -> None:
    with pytest.raises(InvalidAddress, match="cannot be the name of a board"):
        Topics().board(name, "state")


def test_no_board_is_called_as_all_of_them_are() -> None:
    with pytest.raises(InvalidAddress, match="'all' means every board of a fleet: give the board another name"):
        Topics().board("all", "cmd")
    assert Topics().parse("servolink/all/available") is None


@pytest.mark.parametrize(
    "topic", ["other/rex/state", "servolink", "servolink/rex", "servolink/_fleet/stop", "servolink/rex/a/b"]
)
def test_a_topic_of_something_else_is_of_no_board(topic: str) -> None:
    assert Topics().parse(topic) is None


@pytest.mark.parametrize(
    ("topic", "is_allowed"),
    [
        ("servolink/rex/result/laptop-1", True),
        ("servolink/rex/result/the teacher/laptop-1", True),
        ("servolink/rex/result", False),
        ("servolink/rex/result/", False),
        ("servolink/rex/result/../fido\0", False),
        ("servolink/rex/result/" + "x" * 201, False),
        ("servolink/fido/result/servolink/rex/result/a", False),
        ("servolink/fido/result/laptop-1", False),
        ("servolink/_fleet/result/laptop-1", False),
        ("servolink/_fleet/reply/laptop-1", False),
        ("servolink/_fleet/stop", False),
        ("servolink/fido/cmd", False),
        ("servolink/fido/state", False),
        ("homeassistant/device/x/config", False),
        ("servolink/", False),
        ("servolink/#", False),
        ("servolink/+/result/laptop-1", False),
        ("servolink/rex/result/#", False),
        ("servolink/a\0b", False),
        ("servolink/" + "x" * 400, False),
    ],
)
def test_a_board_answers_below_its_own_result_only(topic: str, is_allowed: bool) -> None:
    assert Topics().may_answer("rex", topic) is is_allowed


def test_a_board_answers_below_a_prefix_like_a_topic() -> None:
    topics = Topics("school/result/room1")
    assert topics.may_answer("rex", f"school/result/room1/rex/{topics.reader('teacher', 'w')}")
    assert not topics.may_answer("rex", "school/result/room1/fido/result/w")


def test_the_topic_of_a_result_says_whose_it_is() -> None:
    assert Topics().parse("servolink/rex/result/teacher/laptop-1") == ("rex", "result/teacher/laptop-1")
    assert Topics().parse("servolink/_fleet/result/teacher/laptop-1") is None


@pytest.mark.parametrize("user", [None, "", "a/b", "+", "#", "$SYS", "a\0", "x" * 200])
def test_a_user_whom_no_topic_can_carry_reads_with_all_of_these(user: str | None) -> None:
    assert Topics().reader(user, "w") == "result/-/w"
    assert Topics().reader("the teacher", "w") == "result/the teacher/w"


def test_a_result_has_only_the_fields_that_say_something() -> None:
    assert msgspec.json.encode(BoardResult(id="a", board="rex", ok=True, result={})) == (
        b'{"id":"a","board":"rex","ok":true,"result":{}}'
    )


@pytest.mark.parametrize("command_id", ["", "a b", "a\n", "x" * 65, "#"])
def test_an_id_is_a_short_word(command_id: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"id": command_id, "method": "status"}, BoardCommand)


FROM_AFAR = """
    battery board.facts board.state cancel move prepare project.apply project.backups project.export project.plan
    project.rollback records.delete records.get records.list records.put release run servo.set servos.list
    servos.parameters status stop
"""


def test_only_these_methods_come_from_afar() -> None:
    assert {name for name in {*METHODS, *OWN} if scope_of(name).from_afar} == set(FROM_AFAR.split())


def test_each_method_that_begins_a_motion_needs_an_expiry_from_afar() -> None:
    timed = {name for name, method in METHODS.items() if "until" in getattr(method.params, "__struct_fields__", ())}
    moving = {name for name, method in METHODS.items() if method.scope.moves and method.scope.from_afar}
    assert {name for name in timed if scope_of(name).from_afar} == {
        each for each in moving if not needs_pulse(METHODS[each].scope)
    }
    assert moving - timed == {"project.apply", "project.rollback"}
    assert scope_of("prepare").moves


def test_a_method_of_another_version_counts_as_one_that_moves_and_never_comes_from_afar() -> None:
    assert scope_of("servo.spin").moves
    assert not scope_of("servo.spin").from_afar


def test_the_schema_defines_all_that_it_refers_to() -> None:
    text = json.dumps(schema())
    assert {part.partition('"')[0] for part in text.split('"#/$defs/')[1:]} <= set(schema()["$defs"])
