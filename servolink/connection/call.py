"""Calls and their sendings: a call is one request of one caller, a slot one sending of the request, a lane one id."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from msgspec import Struct

from servolink.errors import DecodeError, ServolinkError
from servolink.protocol import Command, Request, Response

Content: TypeAlias = "Response | DecodeError"
"""A response, or why the content of an intact frame could not be read."""


UNKNOWN_SIZE = 1 << 40
"""Bytes of a response of a kind that was never heard: a list can be long, so nothing is sent beside the first one."""


class Lane:
    """One response id with its open slots in the order sent, and the unmatched responses."""

    def __init__(self, response_id: int) -> None:
        """Start without slots."""
        self.response_id = response_id
        self.slots: deque[Slot] = deque()
        self.equal = True
        """Whether all slots have the same repeatable request: the usual case, without a search."""
        self.overdue = 0
        """Number of slots whose response is overdue."""
        self.unmatched: list[Content] = []
        """Responses with several possible slots, in order of arrival."""
        self.stopped = False
        """Whether a stop on this lane is not settled: no response on the lane can be assigned to a slot."""
        self.permits = 0
        """Permits of requests on this lane, counted while the depth is learnt."""
        self.owed = 0
        """Bytes of responses to requests with a permit, as expected when the permits were taken."""
        self.size = UNKNOWN_SIZE
        """Bytes of a request or of its response, whichever has more."""
        self.response_size = UNKNOWN_SIZE
        """Bytes of a recent long response."""
        self.request_size = 0
        """Bytes of the latest request."""

    def sent(self, size: int) -> None:
        """Learn from a frame of `size` bytes on its way to the board."""
        self.request_size = size
        self.size = max(self.response_size, size)

    def heard(self, size: int) -> None:
        """Learn from a frame of `size` bytes from the board."""
        former = self.response_size
        if size != former:
            size = size if size > former or former == UNKNOWN_SIZE else former - (former - size) // 8
            self.response_size = size
            self.size = max(self.request_size, size)

    def hand_down(self, call: Call) -> Call:
        """Give the oldest awaited slot to `call`, whose slots are all over, and return the next call to send.

        The next is the call with the youngest slot: each caller who loses a slot gets the following one. The oldest
        slot is answered first, so a call that repeats behind all others would again miss its response. An open slot is
        younger than all that are over: its response was asked for after the first sending of `call`.
        """
        if self.equal and not self.stopped and self.slots and self.slots[0].request == call.packet:
            for slot in self.slots:
                owner = slot.call
                if owner is None or slot.is_fence or slot.overdue:  # an overdue slot wakes no caller
                    continue
                slot.call, call.latest = call, slot
                call.open_slots += 1
                owner.open_slots -= 1
                if owner.is_over:
                    break
                call = owner
        return call


class Slot(Struct, eq=False):
    """Sending of a request."""

    request: Request[Any]
    lane: Lane
    call: Call | None
    """Call waiting for the response; None if no call waits."""
    sent_at: float = 0.0
    timeout: float = 0.0
    """Seconds until the slot is overdue, counted from when no older slot delays the response."""
    is_fence: bool = False
    """Whether the purpose is to settle older slots, not the response."""
    open: bool = True
    """Whether the response may still come."""
    overdue: bool = False
    answered: bool = False
    """Whether the response has come, and a second one may follow: see `RepeatingSlots`."""
    holds_permit_of: Request[Any] | Command | None = None
    """Packet of an ended call, counted as under way until this slot is over or overdue."""

    @property
    def is_expected(self) -> bool:
        """Whether the response may still come and is not overdue."""
        return self.open and not self.overdue


Settled: TypeAlias = "tuple[Slot, Content | None]"
"""A slot that is over, with its response; None if there is none."""


class Call(Struct, eq=False):
    """State of one request. The request may be sent several times; the first response counts."""

    packet: Request[Any] | Command
    patience: float
    """Seconds until the request is given up, counted from when no older slot delays the response."""
    begun_at: float
    response: Response | None = None
    fault: DecodeError | None = None
    """Why the response could not be read."""
    error: ServolinkError | None = None
    """Cause of an end from outside: a stop, or the caller's time limit."""
    granted: asyncio.Future[None] = None  # type: ignore[assignment]  # set by the queue for permits
    """Done when the permit is granted; fails if the connection ends."""
    queued: bool = False
    """Whether the call waited for a permit: then the scheduler must be notified when the packet is sent."""
    is_aside: bool = False
    """Whether the call has given its permit back for a pause."""
    is_over: bool = False
    """Whether the caller has a result or is gone: a later response is dropped."""
    since: float | None = None
    """Time when the first slot became the oldest of the connection; None before."""
    tries: int = 0
    fences: int = 0
    """Fences sent for the call since the latest frame."""
    unanswered: int = 0
    """Slots proved to be over without a response."""
    open_slots: int = 0
    """Slots open for a response, fences excluded."""
    latest: Slot | None = None
    """Latest slot of the call, fences included."""
    woken: asyncio.Future[None] | None = None
    on_wake: Callable[[Call], None] | None = None
    """Called in place of waking a task, while none waits."""
    content: bytes | None = None
    """Content of the frame with the response, if `on_wake` was set on arrival."""

    def wake(self) -> None:
        """Wake the caller to look at the new state."""
        if self.on_wake is not None:
            self.on_wake(self)
        elif self.woken is not None and not self.woken.done():
            self.woken.set_result(None)
