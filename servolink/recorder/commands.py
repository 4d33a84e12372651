"""The message about a command, from what became of it."""

from __future__ import annotations

import asyncio

from servolink.errors import ConnectionLost, DecodeError, OutcomeUnknown, RequestTimeout
from servolink.protocol.packet import Packet, Query, Result
from servolink.recorder.channels import CommandDone, Outcome
from servolink.recorder.packet_stream import fields_of

_LONGEST = 300  # characters of a reason


def command_done(
    packet: Packet, outcome: object, seconds: float, *, who: str = "", session: str = "", lease: str = ""
) -> CommandDone:
    """Return the message about a request that is over.

    `outcome` is its response, True if it was sent and boards do not answer it, False if it was not sent, a text that
    says why not, or an error.
    """
    word = outcome_of(packet, outcome)
    reason = str(outcome)[:_LONGEST] if isinstance(outcome, Exception | str) else ""
    return CommandDone(
        type(packet).__name__,
        fields_of(packet),
        word,
        max(seconds, 0.0),
        who=who,
        session=session,
        lease=lease,
        reason=reason,
    )


def outcome_of(packet: Packet, outcome: object) -> Outcome:
    """Return in a word what became of a request."""
    match outcome:
        case Result():
            return "answered" if outcome.result else "rejected"
        case Packet():
            return "answered"
        case True:
            return "sent"
        case ConnectionLost():
            return "failed"
        case OutcomeUnknown():
            return "unknown"
        case RequestTimeout() | DecodeError():
            return "unanswered" if isinstance(packet, Query) else "unknown"
        case asyncio.CancelledError():
            return "unanswered" if isinstance(packet, Query) else "unknown"
        case _:
            return "refused"
