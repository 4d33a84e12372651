"""Lanes: one per response id, with the one sending that waits for its answer there.

Answers carry no number, only their response id. So at most one sending waits on a lane, and a lane whose sending
ended unanswered is *dirty*: its answer is still owed and must not be taken for that of the next one.

The board answers in order. So an answer to one sending, in time or late, proves that whatever was sent before it
has been answered or never will be.
"""

from __future__ import annotations

from asyncio import Future
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from servolink.errors import DecodeError
from servolink.protocol.codec import PACKETS
from servolink.protocol.packet import Packet, Request, Response


class PendingRequest(Struct, eq=False):
    """One sending that waits for its answer."""

    request: Request[Any]
    number: int
    """Sendings are numbered in their order on the line."""
    sent_at: float
    deadline: float
    timeout: float
    answer: Future[Response | None]
    """The answer; None when none came in time; or what ended the link."""
    fault: DecodeError | None = None
    """Why the answer that came could not be used."""
    abandoned: bool = False
    """Nobody waits any more; the turn is given back when the sending is over."""
    borrowed: bool = False
    """It uses its lane within the turn of another sending: it is a fence."""
    ambiguous: bool = False
    """Its answer may be that to an earlier sending on its lane, and so proves nothing."""
    received: int = 0
    """Bytes of the answer that had come when the deadline was last moved."""
    pauses: int = 0
    """How often the deadline was moved because something else was arriving."""


@dataclass(slots=True, eq=False)
class Lane:
    """One response id."""

    response_id: int
    pending: PendingRequest | None = None
    """The sending that waits for its answer."""
    owed: PendingRequest | None = None
    """The sending that ended without one; its answer may still come."""
    late: Response | None = None
    """The latest answer that came late."""


@dataclass(slots=True)
class Lanes:
    """All lanes of a link."""

    by_response_id: dict[int, Lane] = field(
        default_factory=lambda: {
            packet_id + 1: Lane(packet_id + 1)
            for packet_id, declared in PACKETS.items()
            if issubclass(declared, Request)
        }
    )
    sent: int = 0
    """How many sendings there have been."""
    owing: set[Lane] = field(default_factory=set)
    """Those on which an answer is still owed."""
    fence_first: int = 0
    """Number of an unanswered sending that nothing may follow before it is known to be over; 0: none."""

    def of(self, request: Packet) -> Lane:
        """Return the lane on which `request` is answered."""
        return self.by_response_id[request.packet_id + 1]

    def next_number(self) -> int:
        """Return the number of the next sending."""
        self.sent += 1
        return self.sent

    def pending(self) -> Iterator[tuple[Lane, PendingRequest]]:
        """Yield each sending that waits for its answer."""
        for lane in self.by_response_id.values():
            if lane.pending is not None:
                yield lane, lane.pending

    def in_doubt(self, lane: Lane | None) -> bool:
        """Tell whether a fence must come before the next sending on `lane`."""
        return bool(self.fence_first) or (lane is not None and lane.owed is not None)

    def owe(self, lane: Lane, sending: PendingRequest) -> None:
        """Note that the answer to `sending` may still come."""
        lane.owed = sending
        self.owing.add(lane)

    def answered(self, number: int) -> None:
        """Note that sending `number` was answered, so that nothing sent up to it is owed any more."""
        if self.owing:
            for lane in [lane for lane in self.owing if lane.owed is not None and lane.owed.number <= number]:
                lane.owed = None
                self.owing.discard(lane)
        if self.fence_first <= number:
            self.fence_first = 0

    def inherit(self, before: Lanes, *, own: bool) -> None:
        """Owe what an earlier connection is owed (`own`: and did not inherit itself), with numbers below 1."""
        behind = before.sent + 1
        for response_id, lane in before.by_response_id.items():
            sending = lane.pending or lane.owed
            if sending is not None and (sending.number > 0 or not own):
                self.owe(self.by_response_id[response_id], replace(sending, number=sending.number - behind))
        if before.fence_first:
            self.fence_first = before.fence_first - behind
