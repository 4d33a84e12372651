"""The topics of a fleet and what is sent there."""

from __future__ import annotations

import json

import msgspec
import pytest

from servolink.errors import InvalidAddress
from servolink.fleet.topics import MOTION, SESSION_METHODS, Command, Result, Topics, schema
from servolink.hub.methods.control_session import METHODS


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
        ("servolink/rex/result", True),
        (Topics().reply("laptop-1"), True),
        ("servolink/_fleet/stop", False),
        ("servolink/_fleet/reply/", False),
        ("servolink/fido/cmd", False),
        ("servolink/fido/state", False),
        ("homeassistant/device/x/config", False),
        ("servolink/", False),
        ("servolink/#", False),
        ("servolink/+/result", False),
        ("servolink/a\0b", False),
        ("servolink/" + "x" * 400, False),
    ],
)
def test_results_are_sent_only_where_they_are_heard(topic: str, is_allowed: bool) -> None:
    assert Topics().may_answer(topic) is is_allowed


def test_a_result_has_only_the_fields_that_say_something() -> None:
    assert msgspec.json.encode(Result(id="a", board="rex", ok=True, result={})) == (
        b'{"id":"a","board":"rex","ok":true,"result":{}}'
    )


@pytest.mark.parametrize("command_id", ["", "a b", "a\n", "x" * 65, "#"])
def test_an_id_is_a_short_word(command_id: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"id": command_id, "method": "status"}, Command)


def test_the_methods_of_a_fleet_are_those_of_the_control_interface() -> None:
    assert set(METHODS) >= SESSION_METHODS


def test_each_method_that_begins_a_motion_needs_an_expiry_from_afar() -> None:
    timed = {name for name, method in METHODS.items() if "until" in getattr(method.params, "__struct_fields__", ())}
    assert timed - SESSION_METHODS == MOTION - {"prepare"}


def test_the_schema_defines_all_that_it_refers_to() -> None:
    text = json.dumps(schema())
    assert {part.partition('"')[0] for part in text.split('"#/$defs/')[1:]} <= set(schema()["$defs"])
