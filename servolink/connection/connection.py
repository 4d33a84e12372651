"""Connection: requests to one board over one transport, and their responses."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from contextlib import suppress
from threading import get_ident
from typing import Any, TypeVar, cast

from servolink.connection.base_connection import BaseConnection
from servolink.connection.call import Call, Slot
from servolink.connection.deadlines import DeadlineTimer
from servolink.connection.explain import different_answers, other_loop, timed_out, unproved
from servolink.connection.gates import passes_gates
from servolink.connection.repeats import Inquiry
from servolink.connection.sender import Done
from servolink.connection.slots import Obstacle
from servolink.connection.state import State
from servolink.connection.times import PROOF_PAUSE, SLOW_PATIENCE
from servolink.errors import DecodeError, RequestTimeout, ServolinkError
from servolink.motion import NO_TICKET, Ticket
from servolink.protocol import (
    ClearAllDataRequest,
    Command,
    Effect,
    Packet,
    Query,
    Request,
    Response,
    SetServoParameterRequest,
)

R = TypeVar("R", bound=Response)


class Connection(BaseConnection):
    """Sends requests to one board and matches each response to its request (docs/design/matching.md)."""

    def request(
        self,
        packet: Request[R],
        *,
        timeout: float | None = None,
        first: bool = False,
        unchecked: bool = False,
        ticket: Ticket | None = None,
        begun_at: float | None = None,
    ) -> Coroutine[Any, Any, R]:
        """Return a coroutine to send `packet` and return the response.

        What may be repeated is repeated until `patience` ends, and raises RequestTimeout. What changes the board
        otherwise is sent once, and raises OutcomeUnknown. `timeout` limits the whole call, waiting included, and counts
        from `begun_at` (loop time) if the caller has waited already. `first` goes before all who wait; `unchecked`
        sends back what was read from a board (see Codec.encode). `ticket` says when a motion was asked for: now, unless
        given. What a gate refuses (see `gates`) raises its error, and is not sent.
        """
        if self.repeats.is_proving:
            asking = self._prove(packet, timeout, first, unchecked, ticket, begun_at)
        else:
            asking = self._request(packet, timeout, first, unchecked, ticket, begun_at)
        return self.taps.follow(packet, asking) if self.taps.members else asking

    async def _request(
        self,
        packet: Request[R],
        timeout: float | None,
        first: bool,  # noqa: FBT001 - passed on by `request`
        unchecked: bool,  # noqa: FBT001 - likewise
        ticket: Ticket | None,
        begun_at: float | None,
        *,
        is_prepared: bool = False,
    ) -> R:
        self._check_loop()
        frame = self.codec.encode(packet, unchecked=unchecked)
        if len(frame) != (lane := self.slots.lanes[packet.packet_id + 1]).request_size:
            lane.sent(len(frame))
        call = self._call(packet, timeout, self.loop.time() if begun_at is None else begun_at)
        ticket = ticket or (NO_TICKET if packet.is_query else self.stops.ticket())
        deadline = None if timeout is None else call.begun_at + timeout
        if self.preparations and passes_gates(packet) and not is_prepared:
            await (self.prepare(packet, ticket) if deadline is None else self._prepare(call, ticket, deadline))
        if self.lifecycle.state is not State.READY:
            self.opener.begin()
        if not self.scheduler.acquire_at_once(packet):
            await self._acquire(call, deadline, first=first)
        limit = None if deadline is None else self._limit(call, deadline)
        try:
            if not packet.is_query:
                self._raise_refusal(packet, ticket)
            await self._sender.start(call, packet, frame, self.loop.time())
            answer: Any = call.response or await self._sender.converse(call, packet, frame)
            return answer  # type: ignore[no-any-return]  # of the class that belongs to the lane
        finally:
            if limit is not None:
                limit.stop()
            if call.queued:
                self._sender.leave_queue(call)
            self.answers.leave(call)

    async def _prove(
        self,
        packet: Request[R],
        timeout: float | None,
        first: bool,  # noqa: FBT001 - passed on by `request`
        unchecked: bool,  # noqa: FBT001 - likewise
        ticket: Ticket | None,
        begun_at: float | None,
    ) -> R:
        """Send `packet` and a fence behind it, one such pair at a time, until one of all answers is certain.

        What may not be repeated ends with OutcomeUnknown if its answers differ. RequestRefused names several boards.
        """
        self._check_loop()
        ticket = ticket or (NO_TICKET if packet.is_query else self.stops.ticket())
        if self.preparations and passes_gates(packet):
            await self.prepare(packet, ticket)
        begun, patience = self.loop.time() if begun_at is None else begun_at, timeout or self.patience
        async with self._proving:
            self.repeats.end_proofs()
            if not self.repeats.is_proving:  # answers are kept no more
                return await self._request(packet, timeout, first, unchecked, ticket, begun_at, is_prepared=True)
            tries = 0
            while True:
                is_stop = packet.effect is Effect.STOPS  # sent without a confirmation
                if not is_stop and (refusal := self.repeats.refusal(packet)):
                    raise refusal
                response = await self._request(packet, timeout, first, unchecked, ticket, begun_at, is_prepared=True)
                question = self.repeats.answers(packet.packet_id + 1)
                fence = self._sender.fences.any_but(packet, self.opener.chance)
                try:
                    await self._request(fence, timeout, True, False, NO_TICKET, begun_at)  # noqa: FBT003
                except (RequestTimeout, DecodeError) as error:  # the packet was sent all the same
                    raise unproved(packet, self.url, error) from error
                self.repeats.believe(self.repeats.answers(fence.packet_id + 1))
                if self.repeats.trusts_order(question):
                    return response
                await self._pause(self.repeats.proof_time(question) - self.loop.time())
                if (content := self.repeats.certain(question, self._accepted(packet, question))) is not None:
                    return cast("R", self.codec.decode(packet.packet_id + 1, content))
                waited = self.loop.time() - begun
                if waited >= patience or not packet.repeatable:
                    self.repeats.doubt()
                    raise different_answers(packet, self.url, waited)
                await self._pause(PROOF_PAUSE * 2 ** min(tries, 5) * (1 + self.opener.chance.random()))
                tries += 1

    async def _pause(self, seconds: float) -> None:
        """Pause for a time, at most until the connection ends."""
        await asyncio.wait((self.answers.over,), timeout=max(seconds, 0.0))  # Pyodide schedules nothing in the past

    def _accepted(self, packet: Request[Any], question: Inquiry) -> list[bytes]:
        """Return the answers to a question that fit `packet`."""
        found = []
        for content in question.answers:
            with suppress(DecodeError):
                response: Any = self.codec.decode(packet.packet_id + 1, content)
                found += [content] * packet.accepts(response)
        return found

    def ask(self, packet: Query[R], done: Done) -> bool:
        """Send a query unless it must wait, and call `done` with the response or an error. Return whether it was sent.

        For who asks much for others: no task waits, and `done` is called as soon as the response is read. It must not
        raise.
        """
        self._writer.raise_if_ended()
        is_ready = self._takes_at_once and self.lifecycle.state is State.READY
        if not is_ready or self.repeats.is_proving or not self.scheduler.acquire_at_once(packet):
            return False
        frame = self.codec.encode(packet, unchecked=True)
        if self.scheduler.window.learns:
            self.slots.lanes[packet.packet_id + 1].sent(len(frame))
        self._asker.ask(self._call(packet, None, self.loop.time()), packet, frame, done)
        return True

    def send(self, packet: Command, *, ticket: Ticket | None = None) -> Coroutine[Any, Any, bool]:
        """Return a coroutine to send a packet without a response, with the result True.

        `ticket` is as for `request`.
        """
        sending = self._send(packet, ticket)
        return self.taps.follow(packet, sending) if self.taps.members else sending

    async def _send(self, packet: Command, ticket: Ticket | None) -> bool:
        self._check_loop()
        frame = self.codec.encode(packet)
        call = self._call(packet, None, self.loop.time())
        ticket = ticket or self.stops.ticket()
        if self.preparations:
            await self.prepare(packet, ticket)
        if self.lifecycle.state is not State.READY:
            self.opener.begin()
        if not self.scheduler.acquire_at_once(packet):
            await self._wait_in_queue(call)
        try:
            self._raise_refusal(packet, ticket)
            await self._writer.write(frame)
            await self._sender.check_keeping_up(call)
        finally:
            self._leave(call)
        return True

    def send_aside(self, packet: Command) -> None:
        """Write a packet for a hub behind all that was written so far, at once. Raise ConnectionLost."""
        self._writer.take_aside(self.codec.encode(packet))

    def send_stop(self, packet: SetServoParameterRequest) -> Coroutine[Any, Any, bool]:
        """Return a coroutine to send `packet` ahead of everything else, without waiting for the response."""
        sending = self._send_stop(packet)
        return self.taps.follow(packet, sending) if self.taps.members else sending

    async def _send_stop(self, packet: SetServoParameterRequest) -> bool:
        self._check_loop()
        self._writer.raise_if_ended()
        self.stops.stop()
        lane = self.slots.lanes[packet.packet_id + 1]
        self.scheduler.hold()  # nothing goes before the stop
        try:
            self.answers.open_stop(Slot(packet, lane, None, self.loop.time()))
            sending = self._writer.take(self.codec.encode(packet))
        finally:
            self.scheduler.go_on()
        if sending is not None:
            await self._writer.accepted(sending)
        return True

    async def prepare(self, packet: Packet, ticket: Ticket) -> None:
        """Await the preparations for `packet`. Raise the error of a failed preparation, or of the role."""
        if refusal := self.gates.role(packet, ticket):
            raise refusal
        for prepare in self.preparations:
            await prepare(packet, ticket)

    def _call(self, packet: Request[Any] | Command, timeout: float | None, begun_at: float) -> Call:
        patience = self.call_patience if timeout is None else timeout
        if timeout is None and not packet.is_query and isinstance(packet, ClearAllDataRequest):
            patience = max(patience, SLOW_PATIENCE + self.call_patience - self.patience)
        return Call(packet, patience, begun_at)

    def _raise_refusal(self, packet: Packet, ticket: Ticket) -> None:
        """Raise the error of the first gate to refuse `packet`. Nothing is awaited between this check and sending."""
        if refusal := self.gates.refusal(packet, ticket):
            raise refusal
        self.motions += packet.is_motion

    async def _prepare(self, call: Call, ticket: Ticket, deadline: float) -> None:
        try:
            async with asyncio.timeout_at(deadline):
                await self.prepare(call.packet, ticket)
        except TimeoutError as error:
            if isinstance(error, ServolinkError):
                raise
            raise timed_out(call.packet, self.url, 0, call.patience, self.stats) from None

    async def _acquire(self, call: Call, deadline: float | None, *, first: bool) -> None:
        """Wait in the queue. At `deadline` (loop time) raise RequestTimeout."""
        try:
            async with asyncio.timeout_at(deadline):
                await self._wait_in_queue(call, first=first)
        except TimeoutError:
            excuse = self.lifecycle.excuse
            raise timed_out(call.packet, self.url, 0, call.patience, self.stats, excuse=excuse) from None

    async def _wait_in_queue(self, call: Call, *, first: bool = False) -> None:
        """Wait for a permit, then until nothing stands in the way."""
        await self.scheduler.acquire(call, first=first)
        await self._clear_way(call)

    async def _clear_way(self, call: Call) -> None:
        call.queued = True
        if self.slots.obstacle(call.packet) is Obstacle.NONE:
            return
        try:
            await self._sender.clear_way(call)
        except BaseException:
            self._leave(call)
            raise

    def _leave(self, call: Call) -> None:
        self._sender.leave_queue(call)
        self.answers.leave(call)

    def _limit(self, call: Call, deadline: float) -> DeadlineTimer:
        def passed(now: float) -> None:
            call.error = self._sender.given_up(call, now)
            call.wake()

        timer = DeadlineTimer(passed, lambda: self.stats.bytes_received)
        timer.arm(deadline)
        return timer

    def _check_loop(self) -> None:
        # Not with `get_running_loop`, as Python 3.11 asks the system for the process id in each call of that.
        if get_ident() != self._thread or not self.loop.is_running():
            raise other_loop(self.url, has_ended=self.loop.is_closed())
