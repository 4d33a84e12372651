"""RepeatingSlots: the rules for boards that may answer each request twice.

An answered slot leaves a remainder in its place, for a second response. Both responses to a sending come before those
to whatever was sent later, so the remainder is over with the first response to a younger sending on another lane. Until
then nothing else is sent on its lane: a query that was, might get a response that is older than itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from servolink.connection.call import Content, Settled, Slot
from servolink.connection.slots import Obstacle, Slots, fits
from servolink.protocol import Command, Request


class RepeatingSlots(Slots):
    """All open slots of a connection to a board that may answer twice."""

    answer_twice = True

    def settle(self, response_id: int, content: Content) -> list[Settled] | None:
        """Return the slots that are over with this response, in order; None if no slot can be its origin.

        What is older than the oldest candidate is over. That one gets the response if it has none yet: a younger one
        never gets a response that may be older than its request.
        """
        lane = self.lanes.get(response_id)
        candidates = [slot for slot in lane.slots if fits(slot.request, content)] if lane is not None else []
        if lane is None or not candidates:
            return None
        if lane.stopped:
            return []
        oldest = candidates[0]
        settled: list[Settled] = []
        while self._order[0] is not oldest:
            slot = self._order.popleft()
            if slot.open:
                self._close(slot)
                if not slot.answered:
                    settled.append((slot, None))
        if oldest.answered or any(slot.request != oldest.request for slot in candidates):
            self.repeated += 1
            return settled
        self.unproved = self.unanswerable = 0
        self._leave_remainder(oldest)
        return [*settled, (oldest, content)]

    def _leave_remainder(self, slot: Slot) -> None:
        """Close an answered slot, and leave another in its place for a second response."""
        remainder = Slot(slot.request, slot.lane, None, slot.sent_at, answered=True)
        lane = slot.lane
        self._order[self._order.index(slot)] = remainder
        lane.slots[lane.slots.index(slot)] = remainder
        slot.open = False
        self._tidy()
        if slot.overdue:
            self.overdue -= 1
            lane.overdue -= 1
        if slot is self._exclusive:
            self._exclusive = None

    def obstacle(self, packet: Request[Any] | Command, granted: Sequence[Request[Any] | Command] = ()) -> Obstacle:
        """Return what stands in the way of `packet`: on its lane, any slot."""
        if isinstance(packet, Request) and (slots := self.lanes[packet.packet_id + 1].slots):
            return Obstacle.FENCE if all(slot.answered or slot.overdue for slot in slots) else Obstacle.WAIT
        return super().obstacle(packet, granted)
