"""Explain: texts that name everything and are safe to show."""

from __future__ import annotations

import pytest

from servolink.client import connect
from servolink.connection.explain import lost, outcome_unknown, overtaken, timed_out
from servolink.connection.stats import Stats
from servolink.errors import ConnectionLost, Rejected
from servolink.protocol import Action, AddActionRequest, AddActionResponse, QueryProjectIDRequest
from tests.client.piped_board import PipedBoard, lie

HOSTILE = "\x1b[2J\u202eevil\n\udc80"


def assert_safe(text: str) -> None:
    assert text.isprintable()
    assert "\\x1b" in text or "\\\\x1b" in text


def test_a_packet_is_described_by_name_and_fields() -> None:
    assert QueryProjectIDRequest().described == "QueryProjectIDRequest()"


def test_a_description_is_never_long() -> None:
    text = AddActionRequest(1, "x" * 1000).described
    assert len(text) == 120
    assert text.endswith("...")


def test_hostile_captions_and_addresses_are_escaped_in_every_text() -> None:
    packet, url = AddActionRequest(1, HOSTILE), f"serial://{HOSTILE}"
    for error in (
        timed_out(packet, url, 1, 1.0, Stats()),
        outcome_unknown(packet, url, 1.0),
        overtaken(packet),
        lost(url, OSError(HOSTILE)),
        lost(url, OSError(HOSTILE)).copy(),
    ):
        assert_safe(str(error))


async def test_a_refusal_of_a_hostile_caption_is_escaped() -> None:
    fake = PipedBoard()
    fake.plan(AddActionRequest, lie(AddActionResponse(0)))
    async with connect(fake) as board:
        with pytest.raises(Rejected) as caught:
            await board.add_action(Action(1, "\u202egnihtemos"))
        assert str(caught.value).isprintable()
        assert "\\u202e" in str(caught.value)


def test_tries_are_counted_in_words_that_fit() -> None:
    texts = [str(timed_out(QueryProjectIDRequest(), "fake://", tries, 2.96, Stats())) for tries in (0, 1, 3)]
    assert "and not sent in 3.0 s:" in texts[0]
    assert "in 3.0 s (1 try):" in texts[1]
    assert "in 3.0 s (3 tries):" in texts[2]


def test_a_loss_without_words_is_named_by_its_kind() -> None:
    cause = ConnectionResetError()
    assert str(lost("fake://", cause)) == "the connection to fake:// is gone: ConnectionResetError"
    assert lost("fake://", cause).__cause__ is cause
    assert str(lost("fake://", None)).endswith("it was closed by this program")


def test_each_waiter_gets_a_twin_with_the_same_text_and_cause() -> None:
    error = lost("fake://", OSError("gone"))
    twin = error.copy()
    assert twin is not error
    assert type(twin) is ConnectionLost
    assert (str(twin), twin.__cause__) == (str(error), error.__cause__)
