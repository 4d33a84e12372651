"""Lanes: one per response id, with the one request that waits for it.

Answers carry no number, only their response id. So at most one request waits on a lane, and a lane whose
request ended unanswered is *dirty*: a late answer may still come and must not be taken for the next one.
"""

from __future__ import annotations

from asyncio import Future
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from servolink.errors import DecodeError
from servolink.protocol.packet import Packet, Request, Response
from servolink.protocol.registry import PACKETS


@dataclass(slots=True, eq=False)
class Pending:
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
    fence: bool = False
    received: int = 0
    """Bytes of the answer that had come when the deadline was last moved."""


@dataclass(slots=True, eq=False)
class Lane:
    """One response id."""

    response_id: int
    pending: Pending | None = None
    dirty: int = 0
    """Number of the sending whose answer may still come; 0: clean."""
    rescue: Future[Response | None] | None = None
    """Where a late answer is welcome, because the very same query is about to be repeated."""
    asked: Request[Any] | None = None
    """The query that `rescue` is for."""


@dataclass(slots=True)
class Lanes:
    """All lanes of a link."""

    by_response_id: dict[int, Lane] = field(
        default_factory=lambda: {
            packet_id + 1: Lane(packet_id + 1) for packet_id, declared in PACKETS.items() if issubclass(declared, Request)
        }
    )
    sent: int = 0
    """How many sendings there have been."""
    fence_first: int = 0
    """Number of a sending that nothing may follow before a fence; 0: none."""

    def of(self, request: Packet) -> Lane:
        """Return the lane on which `request` is answered."""
        return self.by_response_id[request.packet_id + 1]

    def next_number(self) -> int:
        """Return the number of the next sending."""
        self.sent += 1
        return self.sent

    def pending(self) -> Iterator[tuple[Lane, Pending]]:
        """Yield each sending that waits for its answer."""
        for lane in self.by_response_id.values():
            if lane.pending is not None:
                yield lane, lane.pending

    def settled_before(self, number: int) -> None:
        """Note that whatever was sent before sending `number` has been answered or never will be."""
        for lane in self.by_response_id.values():
            if lane.dirty < number:
                lane.dirty = 0
        if self.fence_first < number:
            self.fence_first = 0
