"""The outcome of a request in a recording says what is known of it, and no more."""

from __future__ import annotations

import asyncio

import pytest

from servolink.errors import ConnectionLost, DecodeError, EncodeError, OutcomeUnknown, RequestTimeout
from servolink.protocol import (
    AddActionResponse,
    DeleteActionRequest,
    Packet,
    QueryServoListRequest,
    QueryServoListResponse,
)
from servolink.recorder.packet_messages import command_done

QUERY, COMMAND = QueryServoListRequest(), DeleteActionRequest(1)


@pytest.mark.parametrize(
    ("packet", "outcome", "expected"),
    [
        (QUERY, QueryServoListResponse((1, 2)), "answered"),
        (COMMAND, AddActionResponse(1), "answered"),
        (COMMAND, AddActionResponse(0), "rejected"),
        (COMMAND, True, "sent"),
        (COMMAND, ConnectionLost("the board is gone"), "failed"),
        (COMMAND, OutcomeUnknown("no response"), "unknown"),
        (COMMAND, DecodeError("a damaged response"), "unknown"),
        (COMMAND, asyncio.CancelledError(), "unknown"),
        (QUERY, RequestTimeout("no response"), "unanswered"),
        (QUERY, DecodeError("a damaged response"), "unanswered"),
        (QUERY, asyncio.CancelledError(), "unanswered"),
        (COMMAND, EncodeError("out of range"), "refused"),
        (COMMAND, "another program has the lease", "refused"),
    ],
)
def test_an_outcome_is_one_word(packet: Packet, outcome: object, expected: str) -> None:
    done = command_done(packet, outcome, 0.25, who="studio")
    assert (done.packet, done.outcome, done.seconds, done.who) == (type(packet).__name__, expected, 0.25, "studio")
    assert done.reason == (str(outcome) if isinstance(outcome, (Exception, str)) else "")
