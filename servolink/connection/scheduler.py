"""Permits: order and time of sending, and the room on the line for requests under way."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from msgspec import Struct

from servolink.connection.call import Call, Lane, Slot
from servolink.connection.climb import DepthClimb
from servolink.connection.slots import Obstacle, Slots
from servolink.connection.times import MOST_OWED, MOST_OWED_IN_BULK
from servolink.protocol import Command, Request

MOST_ASIDE = 8
"""Callers that may have stepped aside at the same time."""

_MEMORY = 64  # responses after which older ones count half in the pace
_UNMEASURED = 2  # requests at once until the pace of the line is known


class Window:
    """Room on a line: one depth for queries, found by trial, and another depth as soon as something is changed.

    A board that queues queries may still lose what comes while it writes its memory. So their depths are found apart,
    and while a change is under way, that for changes holds for queries too.
    """

    def __init__(
        self, depth: int = 1, write_depth: int = 1, *, learn: bool = True, bytes_per_second: float = 0.0
    ) -> None:
        """Allow at most `depth` requests, or `write_depth` beside a change.

        Without `learn` all of that from the first request on, however long their responses take. The line is known to
        carry `bytes_per_second`, or more.
        """
        self.queries = DepthClimb(depth)
        self.writes = DepthClimb(write_depth)
        self.learns = learn and max(depth, write_depth) > 1
        """Whether there is anything to learn."""
        if not learn:
            self.queries.depth, self.writes.depth = depth, write_depth
        self.least_pace = bytes_per_second
        """Known bytes per second of the line; 0 for an unknown line."""
        self.pace = bytes_per_second
        """Bytes per second of the line, as known or measured; 0 before the first measurement."""
        self._bytes = self._seconds = 0.0  # of consecutive responses
        self._responses = 0
        self._bulks = 0
        self._limit_owed()

    @property
    def depth(self) -> int:
        """How many requests may be under way now, at most."""
        queries, writes = self.queries.depth, self.writes.depth
        return max(writes, queries)

    @contextmanager
    def bulk(self) -> Iterator[None]:
        """Allow more time for owed responses, and try the bounds at once, during a large transfer."""
        self._bulks += 1
        self._limit_owed()
        if self.learns:
            self.queries.leap()
            self.writes.leap()
        try:
            yield
        finally:
            self._bulks -= 1
            self._limit_owed()

    def climb(self, packet: Request[Any] | Command, writes: int) -> DepthClimb:
        """Return whose depth holds for `packet` beside `writes` changes."""
        return self.queries if not writes and packet.is_query else self.writes

    def fits(self, owed: int, under_way: int) -> bool:
        """Return whether a stop may wait for `owed` bytes, of `under_way` requests and one more."""
        return owed <= self._most_owed if self._most_owed else under_way < _UNMEASURED

    def _limit_owed(self) -> None:
        self._most_owed = self.pace * (MOST_OWED_IN_BULK if self._bulks else MOST_OWED)

    def heard(self, size: int, seconds: float, responses: int = 1) -> None:
        """Count responses of `size` bytes, received together `seconds` after another one while already due."""
        self._responses += responses
        if self._responses >= _MEMORY:
            self._responses, self._bytes, self._seconds = _MEMORY // 2, self._bytes / 2, self._seconds / 2
        self._bytes += size
        self._seconds += seconds
        pace = self._bytes / (self._seconds or 1e-9)
        self.pace = max(self.least_pace, pace)
        self._limit_owed()


class Load(Struct):
    """How far the window is used when a chunk comes, and the responses of the chunk."""

    climb: DepthClimb
    """Depth in force for the requests under way."""
    is_full: bool
    has_backlog: bool
    """Whether somebody waits because of the depth."""
    responses: int = 0
    """Number of responses, except to fences."""
    due: int = 0
    """Number of responses that were already due when an earlier response came."""
    size: int = 0
    """Bytes of the responses that were due."""
    seconds: float = 0.0
    """Seconds since the earlier response."""


class RequestScheduler:
    """Grants as many permits as there is room for, strictly in order of arrival; a stop's read-back comes first.

    Only the first in the queue is ever looked at, so the cost does not grow with their number.
    """

    def __init__(self, window: Window, slots: Slots) -> None:
        """Allow as many requests as fit into `window` beside the open `slots`."""
        self.window = window
        self.learns = window.learns
        self._slots = slots
        self._loop = asyncio.get_running_loop()
        self._permits = 0
        self._changes = 0  # permits of changes
        self._owed = 0  # bytes of responses to requests with a permit
        self._paused = False
        self.waiting: deque[Call] = deque()
        """Queue of calls that wait for permits."""
        self.aside = 0
        """Number of callers who have given their permit back for a pause."""
        self.on_aside: Callable[[], None] = lambda: None
        """Called when a caller steps aside: another one may send."""
        self._granted: list[Request[Any] | Command] = []  # with a permit, but not in `slots` yet
        self._is_held = False
        self.later: deque[Callable[[], None]] = deque()
        """Functions to call when `hold` is over: sending needs slots in their final state."""

    def acquire_at_once(self, packet: Request[Any] | Command) -> bool:
        """Take a permit if nothing stands in the way of `packet`, to be sent at once. `release` must follow."""
        if self.waiting or self._paused or self._granted:
            return False
        slots = self._slots
        lane = slots.lanes.get(packet.packet_id + 1)
        if self._permits and not self._has_room(packet, lane):
            return False
        if (slots.live or slots.overdue or slots.answer_twice) and slots.obstacle(packet) is not Obstacle.NONE:
            return False
        self._take(packet, lane)
        return True

    async def acquire(self, call: Call, *, first: bool = False) -> None:
        """Wait for a permit, with `first` ahead of all waiting callers. `sent` must follow, then `release`."""
        self.enqueue(call, first=first)
        try:
            await self.let_others_send(call)
            await call.granted
        except asyncio.CancelledError:
            self.withdraw(call)
            raise

    async def let_others_send(self, call: Call) -> None:
        """Pause if other callers wake up first, and send first: their permits were granted earlier."""
        if self._granted and call.granted.done() and self._granted[0] is not call.packet:
            await asyncio.sleep(0)

    def enqueue(self, call: Call, *, first: bool) -> None:
        """Put a call into the queue; `call.granted` is done with the permit. `withdraw` must be called to leave."""
        queue = self.waiting
        call.granted = self._loop.create_future()
        if first:
            queue.appendleft(call)
        else:
            queue.append(call)
        if queue[0] is call:  # else the whole queue waits for the head
            self.grant()

    def withdraw(self, call: Call) -> None:
        """Leave the queue, and give a granted permit back."""
        granted = call.granted
        if not granted.cancel() and not granted.cancelled() and granted.exception() is None:
            self.sent(call.packet)
            self.release(call.packet)
        elif self.waiting and self.waiting[0] is call:
            self.grant()  # the head of the queue held back the rest

    def sent(self, packet: Request[Any] | Command) -> None:
        """Note that `packet` has a slot, or will not be sent: the next packets may follow."""
        self._granted.remove(packet)  # or an equal packet, just as good
        if self.waiting:
            self.grant()

    def release(self, packet: Request[Any] | Command) -> None:
        """Give the permit of `packet` back."""
        self._permits -= 1
        if not packet.is_query:
            self._changes -= 1
        if self.learns and (lane := self._slots.lanes.get(packet.packet_id + 1)) is not None:
            owed = lane.owed // lane.permits
            lane.permits -= 1
            lane.owed -= owed
            self._owed -= owed
        if self.waiting:
            self.grant()

    def release_held(self, slot: Slot) -> None:
        """Give the permit back that a slot holds of an ended call, if any."""
        packet, slot.holds_permit_of = slot.holds_permit_of, None
        if packet is not None:
            self.release(packet)

    def step_aside(self, packet: Request[Any] | Command) -> None:
        """Give the permit of `packet` back until the caller acquires another. `step_back` must follow."""
        self.aside += 1
        self.release(packet)
        self.on_aside()

    def step_back(self) -> None:
        """Count a caller as aside no longer: the caller has a permit again, or has ended."""
        self.aside -= 1

    def take_extra(self) -> None:
        """Take a permit at once, beyond the depth; further permits wait until there is room again."""
        self._permits += 1

    def give_back_extra(self) -> None:
        """Give such a permit back."""
        self._permits -= 1
        if self.waiting:
            self.grant()

    def hold(self) -> None:
        """Grant nothing until `go_on`, in the same turn of the loop: slots change, and what is granted may be sent."""
        self._is_held = True

    def go_on(self) -> None:
        """Grant permits again after `hold`, then call what waits for that."""
        self._is_held = False
        if self.waiting:
            self.grant()
        while self.later:
            self.later.popleft()()

    def pause(self) -> None:
        """Grant nothing until `resume`: the connection is being opened."""
        self._paused = True

    def resume(self) -> None:
        """Grant permits again after a pause."""
        self._paused = False
        self.grant()

    def refuse_all(self, error: Callable[[], Exception]) -> None:
        """Fail all waiting callers, each with a separate error."""
        waiting, self.waiting = self.waiting, deque()
        for each in waiting:
            if not each.granted.done():
                each.granted.set_exception(error())

    def grant(self) -> None:
        """Grant permits at the head of the queue, as many as may be sent now."""
        while self.waiting and not self._is_held:
            head = self.waiting[0]
            if head.granted.done():  # cancelled
                self.waiting.popleft()
                continue
            packet = head.packet
            lane = self._slots.lanes.get(packet.packet_id + 1)
            if self._paused or not self._has_room(packet, lane):
                return
            if self._slots.obstacle(packet, self._granted) is Obstacle.WAIT:
                return
            self.waiting.popleft()
            self._take(packet, lane)
            self._granted.append(packet)
            head.granted.set_result(None)

    def _has_room(self, packet: Request[Any] | Command, lane: Lane | None) -> bool:
        """Return whether the depth allows another request without delaying a stop; an idle line always has room."""
        # The board is done with a request whose response is unmatched.
        under_way = self._permits - self._slots.unmatched
        if under_way <= 0:
            return True
        window = self.window
        climb = window.queries if packet.is_query and not self._changes else window.writes
        if under_way >= climb.depth:
            return False
        return not self.learns or window.fits(self._owed if lane is None else self._owed + lane.size, under_way)

    def _take(self, packet: Request[Any] | Command, lane: Lane | None) -> None:
        self._permits += 1
        if not packet.is_query:
            self._changes += 1
        if self.learns and lane is not None:
            # By permits, not by slots: a caller whose slot is overdue sends again without asking.
            lane.permits += 1
            lane.owed += lane.size
            self._owed += lane.size

    def learn(self, load: Load, now: float) -> None:
        """Learn depth and pace from a chunk that came at `now`, in seconds. `go_on` must follow."""
        if load.responses:
            load.climb.answered(now, load.responses, full=load.is_full, has_backlog=load.has_backlog)
        if load.due:
            self.window.heard(load.size, load.seconds, load.due)

    def load(self) -> Load:
        """Return the present load of the window."""
        under_way = self._permits - self._slots.unmatched
        for waiting in self.waiting:
            if not waiting.granted.done():
                packet = waiting.packet
                climb = self.window.climb(packet, self._changes)
                has_room = self._has_room(packet, self._slots.lanes.get(packet.packet_id + 1))
                return Load(climb, not has_room, has_backlog=under_way >= climb.depth)
        climb = self.window.writes if self._changes else self.window.queries
        return Load(climb, under_way >= climb.depth, has_backlog=False)
