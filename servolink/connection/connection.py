"""Connection: the conversation with one board over one transport."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Coroutine
from contextlib import AbstractContextManager
from threading import get_ident
from typing import TYPE_CHECKING, Any, TypeVar

from servolink.connection.asking import Done, QueryAsker
from servolink.connection.call import Call, Slot
from servolink.connection.deadlines import DeadlineTimer
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.explain import lost, other_loop, timed_out
from servolink.connection.gates import Gates, Preparation, limits_gate, passes_gates, ticket_gate
from servolink.connection.opener import Opener
from servolink.connection.options import HUB_MARGIN, PATIENCE, SLOW_PATIENCE, TransmissionMode
from servolink.connection.scheduler import RequestScheduler, Window
from servolink.connection.sender import RequestSender
from servolink.connection.slots import NO_OBSTACLE, Slots
from servolink.connection.state import ConnectionEvent, Lifecycle, State
from servolink.connection.stats import Stats
from servolink.connection.taps import Taps
from servolink.errors import ConnectionLost, ServolinkError
from servolink.motion.ticket import NO_TICKET, StopCounter, Ticket
from servolink.platforms.time_asleep import SleepCounter, time_with_sleep
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Command, Packet, Query, Request, Response, is_motion
from servolink.protocol.servos import SetServoParameterRequest
from servolink.protocol.settings import ClearAllDataRequest

if TYPE_CHECKING:
    from random import Random

    from servolink.connection.sharing import BoardSharing
    from servolink.transports.base import Transport

R = TypeVar("R", bound=Response)

_READY = State.READY  # a global is faster than a member of an enum


class Connection:
    """Sends requests to one board and matches each response to its request (docs/design/matching.md)."""

    def __init__(
        self,
        transport: Transport,
        codec: Codec,
        *,
        patience: float = PATIENCE,
        depth: int = 1,
        write_depth: int = 1,
        learn: bool = True,
        transmission_mode: TransmissionMode = "auto",
        unsupported: Collection[str] = (),
        answers_twice: bool = False,
        ignore_extra: bool = False,
        repeats: bool = True,
        stats: Stats | None = None,
        taps: Taps | None = None,
        random: Random | None = None,
    ) -> None:
        """Give a request up after `patience` seconds. Have at most `depth` under way, or `write_depth`.

        `transmission_mode` says when the handshake sets mode 1, and `unsupported` names queries that are not used for
        it, such as `QueryMemorySize`. `random` draws the handshake.
        With `answers_twice` each sending may be answered twice, and one request is under way. `ignore_extra` ignores
        what responses have behind the content of the document.
        `write_depth` holds while one of them is a change. How many pay is learnt, unless `learn` is False: then as many
        as allowed are sent from the beginning. Without `repeats` each request is sent once, and given up a second
        later: a hub repeats by itself.
        """
        self.transport = transport
        self.codec = codec
        self.patience = patience
        self.stats = stats or Stats()
        """Counters of all frames and bytes seen."""
        self.taps = taps or Taps()
        """Listeners to bytes and requests."""
        self.stops = StopCounter(SleepCounter())
        """Stops of all servos; no motion requested before a stop is sent after the stop."""
        self.motions = 0
        """Number of motions sent, or about to be sent."""
        self.preparations: tuple[Preparation, ...] = ()
        """Awaited in turn before a packet waits to be sent, except packets that pass no gates."""
        self.hub: BoardSharing | None = None
        """Link to the hub of a shared board; None for a board without a hub."""
        self.on_another: Callable[[str], None] = lambda text: None
        """Called with a description if another board answers in place of a lost one; empty when that board is gone."""
        self._loop = asyncio.get_running_loop()
        self._thread = get_ident()
        self._slots = _repeating_slots() if answers_twice else Slots()
        if answers_twice:
            depth = write_depth = 1
        pace = getattr(transport, "bytes_per_second", 0.0)
        self._window = Window(depth, write_depth, learn=learn, bytes_per_second=pace)
        self._scheduler = RequestScheduler(self._window, self._slots)
        self.lifecycle = Lifecycle(outlasts_silence=not repeats)
        """State in the life of the connection."""
        self._takes_at_once: bool = getattr(transport, "takes_at_once", False)
        self.answers = ResponseDispatcher(
            transport.url,
            codec,
            self.lifecycle,
            self._slots,
            self._scheduler,
            patience,
            self._loop.time,
            self.stats,
            self.taps,
            ignore_extra=ignore_extra,
        )
        self._sender = RequestSender(
            transport, codec, self.lifecycle, self._slots, self._scheduler, self.answers, repeats=repeats
        )
        self.opener = Opener(
            transport,
            codec,
            self.lifecycle,
            self._slots,
            self._scheduler,
            self.answers,
            self._sender,
            patience=patience,
            transmission_mode=transmission_mode,
            unsupported=unsupported,
            random=random,
        )
        """Openings of the connection, with what they have shown of the board."""
        self.gates = Gates(ticket=ticket_gate(self.stops, time_with_sleep), limits=limits_gate(lambda: self.units_sent))
        """Checks of each packet right before sending, stops and queries excepted."""
        self._margin = 0.0 if repeats else HUB_MARGIN
        self._asker = QueryAsker(self._sender, self.answers)

    @property
    def url(self) -> str:
        """The address."""
        return self.transport.url

    @property
    def board_url(self) -> str:
        """Address of the board itself; through a hub, not the address of the transport."""
        return getattr(self.transport, "board_url", self.transport.url)

    @property
    def ended(self) -> ConnectionLost | None:
        """First cause of the end of the connection; None while it is up."""
        return self.lifecycle.ended

    @property
    def outlasts_silence(self) -> bool:
        """Whether the board may come back after a silence: a hub goes on without it."""
        return self.lifecycle.outlasts_silence

    @property
    def is_suspended(self) -> bool:
        """Whether another program has exclusive use of a shared board."""
        return self.lifecycle.state is State.SUSPENDED

    @property
    def unsupported(self) -> frozenset[str]:
        """Names of queries that the board is known not to answer, such as `QueryMemorySize`."""
        return self.opener.unsupported

    @property
    def answered(self) -> tuple[Query[Any], ...]:
        """Short queries that the board has answered in the latest opening."""
        return self.opener.answered

    @property
    def units_sent(self) -> int:
        """Number of angle units sent; an angle has another meaning after a new unit."""
        return self._sender.units_sent

    @property
    def depth(self) -> int:
        """Number of queries allowed under way now, found by trial."""
        return self._window.queries.depth

    @property
    def depth_bound(self) -> int:
        """Bound of the depth for queries."""
        return self._window.queries.bound

    @property
    def write_depth_bound(self) -> int:
        """Bound of the depth while a change is under way."""
        return self._window.writes.bound

    @property
    def pace(self) -> float:
        """Bytes per second that the line is known to carry, 0 if they are unknown."""
        return self._window.least_pace

    @property
    def has_waiting(self) -> bool:
        """Whether somebody waits until less is under way."""
        return bool(self._scheduler.waiting)

    @property
    def callers(self) -> int:
        """Number of callers to keep the line full: one waits, as long as a greater depth may be tried.

        Those are not counted whose query the board may not know, and who let others send.
        """
        return min(self._window.queries.depth + 1, self._window.queries.bound) + self._scheduler.aside

    def on_more_callers(self, tell: Callable[[], None]) -> None:
        """Call `tell` when a caller steps aside and leaves room for another."""
        self._scheduler.on_aside = tell

    def bulk(self) -> AbstractContextManager[None]:
        """Return a context for large transfers: a stop may then take 0.1 s instead of 0.05 s."""
        return self._window.bulk()

    # --- opening and closing ------------------------------------------------------------------------------------

    async def open(self, *, handshake: bool = True) -> None:
        """Open the transport. Raise OpenError with the remedy.

        The handshake follows with `shake_hands`, or before the first request. Without one, responses to what others
        have asked this board before may be taken for responses to this connection.
        """
        await self.transport.open(self.answers)
        self.lifecycle.change(ConnectionEvent.OPENED if handshake else ConnectionEvent.JOINED)
        if handshake:
            self._scheduler.pause()
            self.answers.on_stranger = self.opener.open_again

    async def shake_hands(self) -> None:
        """Prove that no response to another program is outstanding. Raise OpenError with the remedy if none comes."""
        await self.opener.shake_hands()

    async def close(self) -> None:
        """Fail all waiting calls and free the port; may be called again."""
        error = lost(self.transport.url, None)
        if self._loop.is_closed():  # waiting tasks have ended with the loop, and cannot be woken
            self.lifecycle.end(error)
        else:
            self.answers.end(error)
            await self._asker.close()
        await self.transport.close()
        self._sender.end()
        if self.hub is not None:
            await self.hub.close()

    # --- a board that is shared ---------------------------------------------------------------------------------

    def suspend(self, reason: str) -> None:
        """Send nothing but stops until `resume`, and wait for responses as long: another program has exclusive use."""
        self.lifecycle.suspend(reason)
        self._scheduler.pause()

    def resume(self) -> None:
        """Send again, if the connection is suspended."""
        if self.is_suspended:
            self.answers.count_from_now()
            self.lifecycle.change(ConnectionEvent.RESUMED)
            self._scheduler.resume()

    def explain_silence(self, reason: str) -> None:
        """Name `reason` in the errors of unanswered requests from now on; empty for an unknown reason."""
        self.lifecycle.silent_because = reason

    # --- requests -----------------------------------------------------------------------------------------------

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
        if timeout is None and packet.is_query:
            asking = self._query(packet, first, unchecked)
        else:
            asking = self._request(packet, timeout, first, unchecked, ticket, begun_at)
        return self.taps.follow(packet, asking) if self.taps.members else asking

    async def _query(self, packet: Request[R], first: bool, unchecked: bool) -> R:  # noqa: FBT001 - passed on by `request`
        """Send a query without a time limit, in fewer steps than `_request`."""
        if get_ident() != self._thread or not self._loop.is_running():
            self._check_loop()
        frame = self.codec.encode(packet, unchecked=unchecked)
        if self._window.learns and len(frame) != (lane := self._slots.lanes[packet.packet_id + 1]).request_size:
            lane.sent(len(frame))
        now = self._loop.time()
        call = Call(packet, self.patience + self._margin, now)
        if self.lifecycle.state is not _READY:
            self.opener.begin()
        if not self._scheduler.acquire_at_once(packet):
            self._scheduler.enqueue(call, frame if self._takes_at_once else b"", first=first)
            try:
                await (self._scheduler.let_others_send(call) if call.granted.done() else call.granted)
            except asyncio.CancelledError:
                self._give_up_waiting(call)
                raise
            if not call.tries:
                await self._clear_way(call)
        try:
            if not call.tries:
                await self._sender.start(call, packet, frame, self._loop.time() if call.queued else now)
            answer: Any = call.response or await self._sender.converse(call, packet, frame)
            return answer  # type: ignore[no-any-return]  # of the class that belongs to the lane
        finally:
            if call.queued:
                self._sender.leave_queue(call)
            self.answers.leave(call)

    async def _request(
        self,
        packet: Request[R],
        timeout: float | None,
        first: bool,  # noqa: FBT001 - passed on by `request`
        unchecked: bool,  # noqa: FBT001 - likewise
        ticket: Ticket | None,
        begun_at: float | None,
    ) -> R:
        self._check_loop()
        frame = self.codec.encode(packet, unchecked=unchecked)
        self._slots.lanes[packet.packet_id + 1].sent(len(frame))
        call = self._call(packet, timeout, self._loop.time() if begun_at is None else begun_at)
        ticket = ticket or (NO_TICKET if packet.is_query else self.stops.ticket())
        deadline = None if timeout is None else call.begun_at + timeout
        if self.preparations and passes_gates(packet):
            await self._prepare(call, ticket, deadline)
        if self.lifecycle.state is not _READY:
            self.opener.begin()
        if not self._scheduler.acquire_at_once(packet):
            await self._acquire(call, deadline, first=first)
        limit = None if deadline is None else self._limit(call, deadline)
        try:
            if not packet.is_query:
                self._raise_refusal(packet, ticket)
            await self._sender.start(call, packet, frame, self._loop.time())
            answer: Any = call.response or await self._sender.converse(call, packet, frame)
            return answer  # type: ignore[no-any-return]  # of the class that belongs to the lane
        finally:
            if limit is not None:
                limit.stop()
            self._leave(call)

    def ask(self, packet: Query[R], done: Done) -> bool:
        """Send a query unless it must wait, and call `done` with the response or an error. Return whether it was sent.

        For who asks much for others: no task waits, and `done` is called as soon as the response is read. It must not
        raise.
        """
        self._sender.raise_if_ended()
        is_ready = self._takes_at_once and self.lifecycle.state is _READY
        if not is_ready or not self._scheduler.acquire_at_once(packet):
            return False
        frame = self.codec.encode(packet, unchecked=True)
        if self._window.learns:
            self._slots.lanes[packet.packet_id + 1].sent(len(frame))
        self._asker.ask(self._call(packet, None, self._loop.time()), packet, frame, done)
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
        call = self._call(packet, None, self._loop.time())
        ticket = ticket or self.stops.ticket()
        if self.preparations:
            await self.prepare(packet, ticket)
        if self.lifecycle.state is not _READY:
            self.opener.begin()
        if not self._scheduler.acquire_at_once(packet):
            await self._wait_in_queue(call)
        try:
            self._raise_refusal(packet, ticket)
            await self._sender.write(frame)
            await self._sender.check_keeping_up(call)
        finally:
            self._leave(call)
        return True

    def send_stop(self, packet: SetServoParameterRequest) -> Coroutine[Any, Any, bool]:
        """Return a coroutine to send `packet` ahead of everything else, without waiting for the response."""
        sending = self._send_stop(packet)
        return self.taps.follow(packet, sending) if self.taps.members else sending

    async def _send_stop(self, packet: SetServoParameterRequest) -> bool:
        self._check_loop()
        self._sender.raise_if_ended()
        self.stops.stop()
        lane = self._slots.lanes[packet.packet_id + 1]
        self._scheduler.hold()  # nothing goes before the stop
        try:
            self.answers.open_stop(Slot(packet, lane, None, self._loop.time()))
            sending = self._sender.take(self.codec.encode(packet))
        finally:
            self._scheduler.go_on()
        if sending is not None:
            await self._sender.accepted(sending)
        return True

    async def prepare(self, packet: Packet, ticket: Ticket) -> None:
        """Await the preparations for `packet`. Raise the error of a failed preparation, or of the role."""
        if refusal := self.gates.role(packet, ticket):
            raise refusal
        for prepare in self.preparations:
            await prepare(packet, ticket)

    def _call(self, packet: Request[Any] | Command, timeout: float | None, begun_at: float) -> Call:
        patience = self.patience + self._margin if timeout is None else timeout
        if timeout is None and not packet.is_query and isinstance(packet, ClearAllDataRequest):
            patience = max(patience, SLOW_PATIENCE + self._margin)
        return Call(packet, patience, begun_at)

    def _raise_refusal(self, packet: Packet, ticket: Ticket) -> None:
        """Raise the error of the first gate to refuse `packet`. Nothing is awaited between this check and sending."""
        if refusal := self.gates.refusal(packet, ticket):
            raise refusal
        self.motions += is_motion(packet)

    async def _prepare(self, call: Call, ticket: Ticket, deadline: float | None) -> None:
        try:
            async with asyncio.timeout_at(deadline):
                await self.prepare(call.packet, ticket)
        except TimeoutError as error:
            if isinstance(error, ServolinkError):
                raise
            raise timed_out(call.packet, self.transport.url, 0, call.patience, self.stats) from None

    async def _acquire(self, call: Call, deadline: float | None, *, first: bool) -> None:
        """Wait in the queue. At `deadline` (loop time) raise RequestTimeout."""
        try:
            async with asyncio.timeout_at(deadline):
                await self._wait_in_queue(call, first=first)
        except TimeoutError:
            excuse = self.lifecycle.excuse
            raise timed_out(call.packet, self.transport.url, 0, call.patience, self.stats, excuse=excuse) from None

    async def _wait_in_queue(self, call: Call, *, first: bool = False) -> None:
        """Wait for a permit, then until nothing stands in the way."""
        await self._scheduler.acquire(call, first=first)
        await self._clear_way(call)

    def _give_up_waiting(self, call: Call) -> None:
        """End a call that was cancelled in the queue, or after its query was sent with the permit."""
        if call.tries:
            self.answers.leave(call)
        else:
            self._scheduler.withdraw(call)

    async def _clear_way(self, call: Call) -> None:
        call.queued = True
        if self._slots.obstacle(call.packet) is NO_OBSTACLE:
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
        if get_ident() != self._thread or not self._loop.is_running():
            raise other_loop(self.transport.url, has_ended=self._loop.is_closed())


def _repeating_slots() -> Slots:
    from servolink.connection.repeating_slots import RepeatingSlots  # late: few boards answer twice

    return RepeatingSlots()
