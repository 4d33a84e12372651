"""Calls and their sendings: a call is one request of one caller, a slot one sending of it, a lane one response id."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from msgspec import Struct

from servolink.errors import DecodeError, ServolinkError
from servolink.protocol.packet import Command, Request, Response

Content: TypeAlias = "Response | DecodeError"
"""A response, or why the content of an intact frame could not be read."""


UNKNOWN_SIZE = 1 << 40
"""Bytes of a response of a kind that was never heard: a list can be long, so nothing is sent beside the first one."""


class Lane:
    """One response id: its open slots in the order sent, and the responses that are kept."""

    def __init__(self, response_id: int) -> None:
        """Start without slots."""
        self.response_id = response_id
        self.slots: deque[Slot] = deque()
        self.equal = True
        """All its slots have the same repeatable request: the usual case, in which nothing has to be searched."""
        self.overdue = 0
        """How many of its slots are overdue."""
        self.kept: list[Content] = []
        """Responses that may belong to several slots, in their order."""
        self.stopped = False
        """A stop was sent on this lane and is not settled: no response on the lane can be assigned to a slot."""
        self.request_size = 0
        """Bytes of the latest frame that was sent."""
        self.response_size = UNKNOWN_SIZE
        """Bytes that a response may have: those of a recent long one."""

    @property
    def size(self) -> int:
        """Bytes that a request takes on the line, in the direction in which it takes more."""
        return max(self.request_size, self.response_size)

    def heard(self, size: int) -> None:
        """Learn from a frame of `size` bytes."""
        known = self.response_size
        self.response_size = size if size > known or known == UNKNOWN_SIZE else known - (known - size) // 8

    def hand_down(self, call: Call) -> Call:
        """Give the oldest awaited slot to `call`, all of whose slots are over, and return whose turn it is to send.

        That is who had the youngest slot: each caller who loses a slot gets the next one. The oldest slot is answered
        first, so a call that repeats behind all others would again be the one whose response is missing. An open slot
        is younger than all that are over: its response was asked for after the first sending of `call`.
        """
        if self.equal and not self.stopped and self.slots and self.slots[0].request == call.packet:
            for slot in self.slots:
                owner = slot.call
                if owner is None or slot.is_fence or slot.overdue:  # an overdue one wakes nobody any more
                    continue
                slot.call, call.latest = call, slot
                call.open_slots += 1
                owner.open_slots -= 1
                if owner.is_over:
                    break
                call = owner
        return call


class Slot(Struct, eq=False):
    """One sending of one request."""

    request: Request[Any]
    lane: Lane
    call: Call | None
    """The request it was sent for; None if nobody waits for this response."""
    sent_at: float = 0.0
    timeout: float = 0.0
    """Seconds after which it is overdue, counted from the moment when no older slot delays its response."""
    is_fence: bool = False
    """It was sent to settle older slots, not for its response."""
    open: bool = True
    """Its response may still come."""
    overdue: bool = False
    holds_permit_of: Request[Any] | Command | None = None
    """The packet of a call that has ended, and still counts as under way until this slot is over or overdue."""

    @property
    def is_expected(self) -> bool:
        """Whether its response may still come, and is not overdue."""
        return self.open and not self.overdue


Settled: TypeAlias = "tuple[Slot, Content | None]"
"""A slot that is over, with its response; None if there is none."""


class Call(Struct, eq=False):
    """What has happened to one request so far. It may be sent several times; its first response counts."""

    packet: Request[Any] | Command
    patience: float
    """Seconds until it is given up, from the moment when no older slot delays its response."""
    begun_at: float
    response: Response | None = None
    fault: DecodeError | None = None
    """Why the response could not be read."""
    error: ServolinkError | None = None
    """What ended the call from outside: a stop, or its own time limit."""
    queued: bool = False
    """It has waited for its permit, and the scheduler is to be told when its packet is sent."""
    is_aside: bool = False
    """It has given its permit back while it pauses."""
    is_over: bool = False
    """The caller has its result or is gone: a later response is for nobody."""
    since: float | None = None
    """When its first slot was the oldest one, None as long as that may still change."""
    tries: int = 0
    fences: int = 0
    """Fences sent for it since anything was heard."""
    unanswered: int = 0
    """How many of its slots are proved to be over without a response."""
    open_slots: int = 0
    """How many of its slots, fences excluded, may still be answered."""
    latest: Slot | None = None
    """Its latest slot, fences included."""
    woken: asyncio.Future[None] | None = None
    on_wake: Callable[[Call], None] | None = None
    """Called in place of waking a task, while none waits."""
    content: bytes | None = None
    """The content of the frame with the response, if it came while `on_wake` was there."""

    def wake(self) -> None:
        """Wake the caller, which looks at what has changed."""
        if self.on_wake is not None:
            self.on_wake(self)
        elif self.woken is not None and not self.woken.done():
            self.woken.set_result(None)
