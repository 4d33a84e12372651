"""Errors of a connection: each names request, board, observation and remedy."""

from __future__ import annotations

from servolink.connection.stats import Stats
from servolink.errors import ConnectionLost, OpenError, OutcomeUnknown, RequestTimeout, escape
from servolink.protocol import Packet


def timed_out(
    packet: Packet,
    url: str,
    tries: int,
    waited: float,
    stats: Stats,
    *,
    answers_others: bool = False,
    through_hub: bool = False,
    excuse: str = "",
) -> RequestTimeout:
    """Return the error for an unanswered request, with the likely causes in order.

    `answers_others`: the board has answered what was sent after it. `through_hub`: a hub that reaches the board has
    repeated the request. `excuse`: why the board cannot answer now.
    """
    times = "1 try" if tries == 1 else f"{tries} tries"
    how = f"in {waited:.1f} s ({times})" if tries else f"and not sent in {waited:.1f} s"
    if excuse:
        causes = f"{escape(excuse)}; try again later"
    elif through_hub and tries:
        causes = (
            "the hub has sent it several times and got no response either: the board may not know it or what it asks "
            "about, or the line is bad"
        )
    elif answers_others and not stats.noise:
        causes = "the board answers other requests, so it may not know this one or what it asks about"
    elif stats.frames_received:
        causes = "the board has answered before, so it is busy or has lost power, or the line is bad"
    elif any(stats.skipped.values()):
        causes = "bytes come but no frame: the byte order or baud rate may be wrong, or this is another device"
    else:
        causes = (
            "nothing came at all: is the board on, is this its port, is it a data cable, are baud rate and byte order "
            "right? `servolink doctor` finds out"
        )
    if stats.noise:
        causes = f"{causes}; {stats.noise} received bytes were part of no frame"
    return RequestTimeout(f"{packet.described} was not answered by {escape(url)} {how}: {causes}", packet)


def outcome_unknown(packet: Packet, url: str, waited: float) -> OutcomeUnknown:
    """Return the error for an unanswered command, which is sent once only."""
    return OutcomeUnknown(
        f"{packet.described} was sent to {escape(url)} and was not answered in {waited:.1f} s: "
        "it may or may not have been done; read back before sending it again",
        packet,
    )


def different_answers(packet: Packet, url: str, waited: float) -> RequestTimeout | OutcomeUnknown:
    """Return the error for a request with different answers, none of which is certain."""
    text = (
        f"{packet.described} had different answers from {escape(url)}, and which of them is late was not certain "
        f"after {waited:.1f} s"
    )
    if packet.is_query:
        return RequestTimeout(f"{text}; try again, or run `servolink doctor`", packet)
    return OutcomeUnknown(f"{text}: read back before sending it again", packet)


def unproved(packet: Packet, url: str, error: Exception) -> RequestTimeout | OutcomeUnknown:
    """Return the error for a request whose answer may be a copy: the fence behind it failed with `error`."""
    kind = RequestTimeout if packet.is_query else OutcomeUnknown
    return kind(f"{packet.described}: whether the answer of {escape(url)} is a copy is not known: {error}", packet)


def overtaken(packet: Packet) -> OutcomeUnknown:
    """Return the error for a request whose response can no longer be told from the response to a stop."""
    return OutcomeUnknown(f"{packet.described} was overtaken by a stop before its answer came", packet)


def lost(url: str, cause: BaseException | None) -> ConnectionLost:
    """Return the error for the end of a connection; without a cause, this program has closed the connection."""
    if isinstance(cause, OpenError):
        return _caused(str(cause), cause)  # names the board already
    reason = "it was closed by this program" if cause is None else escape(str(cause) or type(cause).__name__)
    reason = reason.removeprefix(f"{escape(url)}: ").removeprefix("the connection was lost: ")  # said once
    return _caused(f"the connection to {escape(url)} is gone: {reason}", cause)


def other_loop(url: str, *, has_ended: bool) -> RuntimeError:
    """Return the error for use in another event loop, where the futures of the connection would wake no task."""
    advice = ", which has ended: " if has_ended else ": use it there, or "
    return RuntimeError(f"{escape(url)} was connected in another event loop{advice}connect again in this one")


def _caused(text: str, cause: BaseException | None) -> ConnectionLost:
    error = ConnectionLost(text)
    error.__cause__ = cause
    return error
