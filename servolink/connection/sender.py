"""Sending: packets of calls, and fences where needed, until each call has a result, with a waiting task or without."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, TypeAlias

from servolink.connection.call import Call, Slot
from servolink.connection.core import ConnectionCore
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.explain import outcome_unknown, timed_out
from servolink.connection.fences import FenceChoice
from servolink.connection.frame_writer import FrameWriter
from servolink.connection.scheduler import MOST_ASIDE, RequestScheduler
from servolink.connection.slots import FENCES_ONLY, Obstacle
from servolink.connection.times import ROUNDING
from servolink.errors import ConnectionLost, ServolinkError
from servolink.protocol import Packet, Query, Request, Response, SetAngleUnitRequest
from servolink.support import Tasks

Done: TypeAlias = Callable[["Response | ServolinkError", "bytes | None"], None]
"""Called with the response to a query, and its content as it came if that is known; or with an error."""

_AT_ONCE = 3  # repeats of a lost query without a pause
_FENCE_AFTER = 3  # sendings without a response
_MARK_EVERY = 16  # slots: equal queries in a row show no gap, so a fence is sent between them
_MARK_GOOD_LINE_EVERY = 128  # slots, if as many were answered since the latest loss
_MOST_UNANSWERABLE = 4  # packets without a response until the board must answer a fence


class RequestSender:
    """Sending half of a connection. The caller has a permit for each call."""

    def __init__(self, core: ConnectionCore, writer: FrameWriter, answers: ResponseDispatcher) -> None:
        """Send the requests of `core` through `writer`; `answers` receives the responses."""
        self.units_sent = 0
        """Number of angle units sent; an angle has another meaning after a new unit."""
        self.fences = FenceChoice(core.slots.lanes, core.stats)
        """Fences that are sent, one after the other."""
        self._core = core
        self._codec = core.codec
        self._lifecycle = core.lifecycle
        self._slots = core.slots
        self._scheduler = core.scheduler
        self._times = core.times
        self._stats = core.stats
        self._loop = core.loop
        self._writer = writer
        self._answers = answers
        self._watchdog = answers.watchdog
        self._wrote = False  # whether the latest request is sent only once

    # --- one call -----------------------------------------------------------------------------------------------

    def start(self, call: Call, packet: Request[Any], frame: bytes, now: float) -> Awaitable[None]:
        """Send the request of a call for the first time, `now`; return the awaitable until the call is woken.

        Nothing may stand in the way (see `clear_way`). The usual case takes no coroutine. Raise ConnectionLost.
        """
        self.open_request(call, packet, now)
        call.woken = woken = self._loop.create_future()
        sending = self._writer.take(frame, may_join=packet.is_query)
        if call.queued:
            self.leave_queue(call)  # not earlier: the next packet may be sent at once
        slots = self._slots
        if sending is None and ((slots.unproved < _MARK_EVERY and not slots.unmatched) or not self.needs_mark(call)):
            return woken  # most requests
        return self._go_on_sending(call, sending, woken)

    async def _go_on_sending(self, call: Call, sending: Awaitable[None] | None, woken: asyncio.Future[None]) -> None:
        if sending is not None:
            await self._writer.accepted(sending)
        if self.needs_mark(call):
            await self.send_fence(call.packet)
        await woken

    async def converse(self, call: Call, packet: Request[Any], frame: bytes) -> Response:
        """Send repeats where allowed, and fences, until a call that was woken has a response or an error."""
        while call.response is None:
            await self.until_next(call, packet)
            if call.response is None:
                woken, data = self._open_next(call, packet, frame)
                sending = self._writer.take(data)
                if call.queued:
                    self.leave_queue(call)
                await self._go_on_sending(call, sending, woken)
        return call.response

    async def until_next(self, call: Call, packet: Request[Any]) -> None:
        """Wait until a woken call has a response, or more can be sent. Raise the error of an ended call."""
        await self._end_latest(call)
        if call.response is None:
            await self._go_on(call)
        if call.response is None and not call.open_slots and self._seems_unknown(call):
            gives_way = isinstance(packet, Query) and self._scheduler.aside < MOST_ASIDE
            await (self._give_way(call) if gives_way else self._pause(call))

    def _open_next(self, call: Call, packet: Request[Any], frame: bytes) -> tuple[asyncio.Future[None], bytes]:
        """Open a slot for the next packet of a call; return the future to await and the frame to write now."""
        if self._must_fence(call):
            frame = self._open_fence(call)
        else:
            self._open_repeat(call, packet)
        call.woken = woken = self._loop.create_future()
        return woken, frame

    async def _end_latest(self, call: Call) -> None:
        """Wait until the latest slot of a call is over or overdue, whatever comes for older slots."""
        while call.response is None and call.error is None and (latest := call.latest):
            if not latest.is_expected:
                return
            call.woken = self._loop.create_future()
            await call.woken

    async def _go_on(self, call: Call) -> None:
        """Return if more can be sent for a call without a response, else raise the error of the call."""
        await self._check(call)
        if call.since is None:
            call.since = call.begun_at if call.latest is None else call.latest.sent_at
        if self._core.through_hub or (not call.packet.repeatable and not call.open_slots):
            raise self.given_up(call, self._loop.time())
        self._give_up_if_late(call, call.since)

    def _seems_unknown(self, call: Call) -> bool:
        """Return whether an idle request is lost each time, while others are answered."""
        fenced = call.latest is not None and call.latest.is_fence
        return call.unanswered > (1 if fenced else _AT_ONCE)

    async def _pause(self, call: Call) -> None:
        """Pause before repeating a request lost each time; end early if something happens to the call."""
        assert isinstance(call.packet, Request)  # noqa: S101 - narrows the type
        seconds = self._times.timeout(call.packet, call.tries - _AT_ONCE, after_write=False)
        call.woken = self._loop.create_future()
        ends = call.woken, self._answers.over
        await asyncio.wait(ends, timeout=min(seconds, self._remaining(call)), return_when=asyncio.FIRST_COMPLETED)
        await self._go_on(call)

    def _remaining(self, call: Call) -> float:
        """Return the seconds left of the patience of a begun call."""
        return call.patience - (self._loop.time() - (call.since or 0.0))

    async def _give_way(self, call: Call) -> None:
        """Let others send during the pause of an idle query; then wait for a permit again."""
        self._scheduler.step_aside(call.packet)
        call.is_aside = True
        await self._pause(call)
        self._scheduler.enqueue(call, first=True)
        try:
            while True:  # at least one turn: earlier grants send first
                call.woken = self._loop.create_future()
                ends = call.granted, call.woken
                await asyncio.wait(ends, timeout=self._remaining(call), return_when=asyncio.FIRST_COMPLETED)
                if call.granted.done():
                    break
                await self._go_on(call)
            await call.granted
        except BaseException:
            self._scheduler.withdraw(call)
            raise
        self._scheduler.step_back()
        call.is_aside, call.queued = False, True
        try:
            since = call.since
            await self.clear_way(call)
            call.since = since
            await self._go_on(call)
        except BaseException:
            self.leave_queue(call)
            raise

    def leave_queue(self, call: Call) -> None:
        """Notify the scheduler: the packet has a slot, or will not be sent, and others may follow."""
        if call.queued:
            call.queued = False
            self._scheduler.sent(call.packet)

    async def clear_way(self, call: Call) -> None:
        """Send fences until nothing stands in the way of an unsent packet."""
        begun = self._loop.time()
        while (obstacle := self._slots.obstacle(call.packet)) is not Obstacle.NONE:
            if obstacle is Obstacle.FENCE_BESIDE and self._scheduler.window.depth > 1:
                await self.send_fence(call.packet)
                break
            if call.latest is not None and call.latest.is_expected:
                call.woken = woken = self._loop.create_future()
            else:
                call.since = begun
                self._give_up_if_late(call, begun)
                data = self._open_fence(call)
                call.woken = woken = self._loop.create_future()
                await self._writer.write(data)
            await woken
            await self._check(call)
        if call.latest is not None and call.latest.is_expected:
            # An older fence got the response, most likely the response to this fence: no other is expected.
            self._slots.expire(call.latest)
        call.since = None  # the packet still has the whole patience

    def _must_fence(self, call: Call) -> bool:
        """Return whether only a fence can help a call whose packet was sent before."""
        lane = self._slots.lanes[call.packet.packet_id + 1]
        if not call.packet.repeatable or lane.unmatched or self._slots.overdue >= FENCES_ONLY:
            return True
        if self._slots.answer_twice and lane.slots:  # a second response could be taken for the one to the repeat
            return True
        # Silent for long: a board without this request answers a fence, and is not given up as dead.
        fenced = call.latest is not None and call.latest.is_fence
        if call.unanswered:  # apparently again
            return call.tries > _FENCE_AFTER and call.open_slots > 0 and not fenced
        return call.open_slots >= _FENCE_AFTER and call.tries % 2 == 1 and not fenced

    def open_request(self, call: Call, packet: Request[Any], now: float) -> None:
        """Open the first slot for the packet of a call, to be written `now`."""
        if not packet.is_query and isinstance(packet, SetAngleUnitRequest):
            self.units_sent += 1
        call.latest = self._open(packet, call, 0, now)
        call.open_slots = call.tries = 1

    def _open_repeat(self, call: Call, packet: Request[Any]) -> None:
        """Open a further slot for the packet of a call, to be written now."""
        self._stats.retries += 1
        self.units_sent += isinstance(packet, SetAngleUnitRequest)
        owner = call if call.open_slots else self._slots.lanes[packet.packet_id + 1].hand_down(call)
        open_slots = owner.open_slots  # a proved loss does not show a slow board
        owner.latest = self._open(packet, owner, open_slots, self._loop.time())
        owner.open_slots = open_slots + 1
        call.tries += 1

    def _open_fence(self, call: Call) -> bytes:
        """Open a slot for a fence; return the frame to write now."""
        fence = self.fences.next(call.packet)
        call.latest = self._open(fence, call, call.fences, self._loop.time(), is_fence=True)
        call.fences += 1
        return self._codec.encode(fence)

    def _open(
        self, request: Request[Any], call: Call | None, tries: int, now: float, *, is_fence: bool = False
    ) -> Slot:
        timeout = self._times.timeout(request, tries, after_write=self._wrote)
        if call is not None:
            if not is_fence and self._core.through_hub:
                timeout = call.patience
            left = call.patience if call.since is None else call.since + call.patience - now
            if timeout > left:
                timeout = max(left, 0.001)
        self._wrote = not request.repeatable
        lane = self._slots.lanes[request.packet_id + 1]
        if self._core.repeats.is_on:
            self._core.repeats.asked(lane.response_id, owes=bool(lane.slots))
        slot = Slot(request, lane, call, now, timeout, is_fence)
        self._watchdog.open(slot)
        return slot

    def needs_mark(self, call: Call) -> bool:
        """Return whether to send a fence behind many slots without proof of each other: equal queries, or unmatched.

        And behind a repeat, if it would get no response before what others left overdue.
        """
        unmatched, unproved = self._slots.unmatched, self._slots.unproved
        if call.tries <= 1 and unproved < _MARK_EVERY and not unmatched:
            return False
        depth, packet = self._scheduler.window.depth, call.packet
        if depth <= 1:
            return False
        slots = self._slots.lanes[packet.packet_id + 1].slots
        if call.tries > 1 and slots and slots[0].overdue and slots[0].call is not call:
            return True
        is_good = self._watchdog.answered_in_a_row >= _MARK_GOOD_LINE_EVERY
        every = _MARK_GOOD_LINE_EVERY if is_good else _MARK_EVERY
        return not packet.exclusive and (unproved >= every or min(unmatched, unproved) * 2 >= depth)

    async def send_fence(self, packet: Packet) -> Slot:
        """Send a fence for whose response nobody waits."""
        slot = self._open(self.fences.next(packet), None, 0, self._loop.time(), is_fence=True)
        await self._writer.write(self._codec.encode(slot.request))
        return slot

    async def check_keeping_up(self, call: Call) -> None:
        """After some packets without response, send a fence; the next caller waits for the result."""
        self._slots.unanswerable += 1
        if self._slots.unanswerable >= _MOST_UNANSWERABLE:
            call.latest = await self.send_fence(call.packet)

    # --- ends ---------------------------------------------------------------------------------------------------

    async def _check(self, call: Call) -> None:
        """Raise the error of a call or of the connection; wait for an opening under way."""
        if call.error is not None:
            raise call.error
        self._writer.raise_if_ended()
        if (opening := self._answers.opening) is not None and opening.task is not None:
            await asyncio.wait((opening.task,))
            self._writer.raise_if_ended()

    def _give_up_if_late(self, call: Call, since: float) -> None:
        now = self._loop.time()
        if now - since >= call.patience - ROUNDING:
            raise self.given_up(call, now)

    def given_up(self, call: Call, now: float) -> ServolinkError:
        """Return the error for a call without a response; a change may have been done or not."""
        waited = now - call.begun_at
        if call.tries and not isinstance(call.packet, Query):
            return outcome_unknown(call.packet, self._core.url, waited)
        if call.fault is not None:
            return call.fault
        answers_others = call.unanswered > 0
        return timed_out(
            call.packet,
            self._core.url,
            call.tries,
            waited,
            self._stats,
            answers_others=answers_others,
            through_hub=self._core.through_hub,
            excuse=self._lifecycle.excuse,
        )


class QueryAsker:
    """Asks without a task as long as all goes well: a task takes two more turns of the loop and a third of the time.

    What is not answered at once goes on in a task, like any other call.
    """

    def __init__(
        self, sender: RequestSender, writer: FrameWriter, answers: ResponseDispatcher, scheduler: RequestScheduler
    ) -> None:
        """Ask through `sender` with permits of `scheduler`; `answers` receives the responses."""
        self._sender = sender
        self._writer = writer
        self._answers = answers
        self._scheduler = scheduler
        self._tasks = Tasks()

    def ask(self, call: Call, packet: Query[Any], frame: bytes, done: Done) -> None:
        """Send a query at once; the caller has taken its permit."""
        sender = self._sender
        sender.open_request(call, packet, call.begun_at)
        call.on_wake = partial(self._woken, packet, frame, done)
        try:
            taking = self._writer.take(frame)
        except ConnectionLost:
            return  # the end of the connection has woken the call
        if taking is not None:
            self._tasks.begin(self._await_transport(taking))
        if sender.needs_mark(call):
            self._tasks.begin(sender.send_fence(packet))

    async def close(self) -> None:
        """Wait until no query is under way, after all calls were ended."""
        await self._tasks.close(linger=1.0)

    def _woken(self, packet: Query[Any], frame: bytes, done: Done, call: Call) -> None:
        call.on_wake = None
        if call.response is None:
            self._tasks.begin(self._go_on(call, packet, frame, done))
        else:
            self._scheduler.later.append(partial(self._finish, call, call.response, done))

    async def _go_on(self, call: Call, packet: Query[Any], frame: bytes, done: Done) -> None:
        outcome: Response | ServolinkError
        try:
            outcome = await self._sender.converse(call, packet, frame)
        except ServolinkError as error:
            outcome = error
        self._finish(call, outcome, done)

    def _finish(self, call: Call, outcome: Response | ServolinkError, done: Done) -> None:
        self._answers.leave(call)
        done(outcome, call.content)

    async def _await_transport(self, taking: Awaitable[None]) -> None:
        try:
            await taking
        except ConnectionLost as error:
            self._answers.lost(error)
