"""Slots: every sending in the order sent, and the rules by which responses settle them.

A response carries no number, only its id and sometimes the id of a servo or a record. Relied on is one thing: the board
handles requests in order and answers each at most once. So a response that can belong to one slot only proves that
every older slot is over: it was answered, or never will be. A timeout or a cancel proves nothing, so a slot stays in
the list until such a proof. `docs/design/matching.md` has the reasons for each rule, with counterexamples.

This file knows no clock, no event loop and no bytes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Any

from servolink.connection.call import Content, Lane, Settled, Slot
from servolink.errors import DecodeError
from servolink.protocol import PACKETS, Command, Request

FENCES_ONLY = 256
"""Overdue slots at which only fences are sent, until the first answered fence."""


class Obstacle(Enum):
    """What stands in the way of a request that has not been sent yet."""

    NONE = "none"
    WAIT = "slots whose response is expected: wait until they are over or overdue"
    FENCE = "overdue slots: a fence must be answered first"
    FENCE_BESIDE = "overdue slots: a fence must be sent first, its response need not be waited for"


class Slots:
    """All open slots of a connection."""

    answer_twice = False
    """Whether an answered slot stays open for a second response (see `RepeatingSlots`)."""

    def __init__(self) -> None:
        """Start without any slot."""
        self.lanes = {
            packet_id + 1: Lane(packet_id + 1)
            for packet_id, declared in PACKETS.items()
            if issubclass(declared, Request)
        }
        self.live: deque[Slot] = deque()
        """Slots in order, of which the first one is neither over nor overdue."""
        self.overdue = 0
        """How many open slots are overdue."""
        self.unmatched = 0
        """How many responses are unmatched."""
        self.repeated = 0
        """How many responses were second ones, or may have been."""
        self.unproved = 0
        """How many slots were opened since a response had one possible origin, or since a fence that may have it."""
        self.unanswerable = 0
        """How many packets without a response were sent since then; `RequestSender` counts them."""
        self._order: deque[Slot] = deque()  # may hold slots that are over
        self._exclusive: Slot | None = None  # the latest slot that allows no other beside it

    def open(self, slot: Slot) -> None:
        """Append a slot, before its first byte is sent."""
        lane, request = slot.lane, slot.request
        slots = lane.slots
        if not slots:
            lane.equal = request.repeatable
        elif lane.equal:
            lane.equal = request.repeatable and (slots[0].request is request or slots[0].request == request)
        self._order.append(slot)
        slots.append(slot)
        if slot.is_fence:
            self.unproved = self.unanswerable = 0
        self.unproved += 1
        if slot.overdue:
            self.overdue += 1
            lane.overdue += 1
        else:
            self.live.append(slot)
        if request.exclusive:
            self._exclusive = slot

    def open_stop(self, slot: Slot) -> None:
        """Append the slot of a stop, which overtakes whatever waits: responses on its lane prove nothing any more."""
        slot.overdue = True
        exclusive = self._exclusive
        self.open(slot)
        self._exclusive = exclusive  # a stop holds nothing back
        slot.lane.stopped = True
        self._drop_unmatched(slot.lane)

    def expire(self, slot: Slot) -> None:
        """Mark a live slot as overdue: it stays open, and no longer counts as under way."""
        slot.overdue = True
        slot.lane.overdue += 1
        self.overdue += 1
        self._tidy()

    def clear(self) -> list[Slot]:
        """Close all slots unanswered and return them: the connection was opened, or ended."""
        slots = [slot for slot in self._order if slot.open]
        for slot in slots:
            self._close(slot)
        self._order.clear()
        for lane in self.lanes.values():
            self._drop_unmatched(lane)
        return slots

    # --- responses ----------------------------------------------------------------------------------------------

    def only_origin(self, lane: Lane) -> Slot | None:
        """Return the oldest of all slots if a response on `lane` can belong to no other, and nothing else to a stop.

        That is the usual case. `settle` decides all others, and this one with the same result.
        """
        slots = lane.slots
        slot = slots[0]
        if slot is not self._order[0] or slot.overdue or self.unmatched or lane.stopped or self.answer_twice:
            return None
        return slot if lane.equal or len(slots) == 1 else None

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        """Return the slots that are over with this response, in order; None if no slot can be its origin."""
        lane = self.lanes.get(response_id)
        if lane is None or not (slots := lane.slots):
            return None
        if lane.stopped:
            return []
        oldest = slots[0]
        if lane.equal or len(slots) == 1:
            if not (isinstance(content, DecodeError) or oldest.request.accepts(content)):  # `fits`, on the way of all
                return None
            if oldest is self._order[0] and not self.unmatched:  # nothing older is open: the usual case
                self.close_oldest(oldest)
                return [(oldest, content)]
            return self._settle_exact(oldest, content) if len(slots) == 1 else self._settle_oldest(oldest, content)
        return self._settle_among(lane, content)

    def close_oldest(self, slot: Slot) -> None:
        """Close the oldest of all slots: the response on its lane belongs to no older slot."""
        if len(slot.lane.slots) == 1:
            self.unproved = self.unanswerable = 0
        self._order.popleft()
        self._close(slot)

    def close_only_origin(self, slot: Slot) -> None:
        """Close the slot from `only_origin`, in fewer steps than `close_oldest`."""
        slots, live = slot.lane.slots, self.live
        slots.popleft()
        self._order.popleft()
        live.popleft()  # the same slot: the oldest, and not overdue
        slot.open = False
        if not slots:
            self.unproved = self.unanswerable = 0
        if live and (live[0].overdue or not live[0].open):
            self._tidy()
        if slot is self._exclusive:
            self._exclusive = None

    def _settle_among(self, lane: Lane, content: Content) -> list[Settled] | None:
        """Several slots with different requests: the content tells which of them may be the origin."""
        slots = lane.slots
        candidates = [slot for slot in slots if fits(slot.request, content)]
        if not candidates:
            return None
        oldest = candidates[0]
        if len(candidates) == 1:
            return self._settle_exact(oldest, content)
        if oldest.request.repeatable and all(slot.request == oldest.request for slot in candidates):
            return self._settle_oldest(oldest, content)
        lane.unmatched.append(content)
        self.unmatched += 1
        return self._assign_unmatched(lane, slots) if len(lane.unmatched) == len(slots) else []

    def _settle_exact(self, slot: Slot, content: Content) -> list[Settled]:
        """`slot` is the only possible origin: whatever is older is over."""
        self.unproved = self.unanswerable = 0
        settled: list[Settled] = []
        if self._order[0] is not slot:
            older = self._take_older(slot)
            for lane in dict.fromkeys(each.lane for each in older):
                settled += self._assign_unmatched(lane, [each for each in older if each.lane is lane])
        self._order.popleft()
        self._close(slot)
        if self.unmatched:  # only on a line that breaks the order: they belong to nothing that is open
            for lane in self.lanes.values():
                self._drop_unmatched(lane)
        settled.append((slot, content))
        return settled

    def _take_older(self, slot: Slot) -> list[Slot]:
        older = []
        while self._order[0] is not slot:
            each = self._order.popleft()
            if each.open:
                older.append(each)
        return older

    def _settle_oldest(self, oldest: Slot, content: Content) -> list[Settled]:
        """Several slots with the same request: any of them may be the origin, but nothing older than the oldest.

        The oldest gets the response: it is younger than that question, whichever slot it belongs to.
        Unmatched responses on other lanes may belong to younger slots, so those lanes stay as they are.
        """
        settled: list[Settled] = []
        order = self._order
        if self.unmatched:
            self._drop_unmatched(oldest.lane)
        for slot in order:
            if slot is oldest:
                break
            if slot.open and not slot.lane.unmatched:
                self._close(slot)
                settled.append((slot, None))
        self._close(oldest)
        settled.append((oldest, content))
        while order and not order[0].open:
            order.popleft()
        return settled

    def _assign_unmatched(self, lane: Lane, slots: Iterable[Slot]) -> list[Settled]:
        """Close `slots`, which include each origin of the unmatched responses: with a response each, or with none."""
        closed = list(slots)
        is_complete = len(lane.unmatched) == len(closed)
        contents: list[Content] | list[None] = lane.unmatched if is_complete else [None] * len(closed)
        settled = list(zip(closed, contents, strict=True))
        self._drop_unmatched(lane)
        for slot in closed:
            self._close(slot)
        return settled

    def _drop_unmatched(self, lane: Lane) -> None:
        self.unmatched -= len(lane.unmatched)
        lane.unmatched = []

    def _tidy(self) -> None:
        """Keep the oldest live slot first in `live`."""
        live = self.live
        while live and (live[0].overdue or not live[0].open):
            live.popleft()

    def _close(self, slot: Slot) -> None:
        slot.open = False
        lane, live = slot.lane, self.live
        lane.slots.popleft()  # this one: the slots of a lane end in their order
        if not lane.slots:
            lane.stopped = False
        if slot.overdue:
            self.overdue -= 1
            lane.overdue -= 1
        elif live and slot is live[0]:
            live.popleft()
            if live and (live[0].overdue or not live[0].open):
                self._tidy()
        if slot is self._exclusive:
            self._exclusive = None

    # --- what may be sent beside open slots ---------------------------------------------------------------------

    def obstacle(self, packet: Request[Any] | Command, granted: Sequence[Request[Any] | Command] = ()) -> Obstacle:
        """Return what stands in the way of `packet`, which nobody has sent yet.

        `granted` are packets that will be sent before it, none in the way of another, and are not in the list yet.
        """
        if granted and not (packet.repeatable and not packet.exclusive and packet == granted[-1]):  # else like that one
            for other in granted:
                if _conflict(packet, other):
                    return Obstacle.WAIT
        if not self.overdue and not self.live:
            return Obstacle.NONE
        if self.overdue >= FENCES_ONLY:
            return Obstacle.FENCE
        if packet.exclusive or self._exclusive is not None:
            return Obstacle.WAIT if self.live else Obstacle.FENCE
        lane = self.lanes.get(packet.packet_id + 1)  # None for a command
        return Obstacle.NONE if lane is None or not lane.slots else self._obstacle_on_lane(packet, lane)

    def _obstacle_on_lane(self, request: Request[Any] | Command, lane: Lane) -> Obstacle:
        """A lane holds either equal queries or requests about different records; overdue ones hold back new calls."""
        slots = lane.slots
        if lane.equal and (slots[0].request is request or slots[0].request == request):
            return Obstacle.FENCE_BESIDE if lane.overdue else Obstacle.NONE
        # A request other than all open requests, or one of several different requests.
        if any(slot.request == request or _conflict(request, slot.request) for slot in slots):
            return Obstacle.WAIT if lane.overdue < len(slots) else Obstacle.FENCE
        return Obstacle.FENCE_BESIDE if lane.overdue and not request.repeatable else Obstacle.NONE


def fits(request: Request[Any], content: Content) -> bool:
    """Return whether a response, with the id of the lane of `request`, can answer it."""
    return isinstance(content, DecodeError) or request.accepts(content)


def _conflict(packet: Request[Any] | Command, other: Request[Any] | Command) -> bool:
    """Return whether the two must not be under way together."""
    if packet.exclusive or other.exclusive:
        return True
    if packet.packet_id != other.packet_id:
        return False
    if packet == other:
        return not packet.repeatable and isinstance(packet, Request)
    if isinstance(packet, Command) or isinstance(other, Command):
        return False
    return not (name := packet.echoed or packet.changes) or getattr(packet, name) == getattr(other, name)
