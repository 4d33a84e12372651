"""Upstream: requests of all programs on the way to the board, through a shared connection."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal, TypeAlias

from servolink.client import Board
from servolink.errors import Reason, ServolinkError, escape
from servolink.hub.engine.hub_gates import MotionOver
from servolink.hub.engine.sending import PacketSender
from servolink.hub.rules.exchanges import Exchange, RoundRobin
from servolink.motion import carries_angles
from servolink.protocol import Codec, Command, Packet, Query, Request
from servolink.support import Tasks

_logger = logging.getLogger(__name__)

RequestFollower: TypeAlias = Callable[[Packet, object, float, str, str], None]
"""Takes a request and the response, True for a request without response, False or a reason if unsent, or an error;
when it was asked, who asked, and the session, empty for the hub itself."""


class Upstream:
    """Sends the requests of all programs, as many at once as the connection has use for.

    Most are queries that need nothing first: they are sent and answered without any task. The others are carried out by
    tasks that live as long as the hub; those that wait for something else than the line, each by a task of its own.
    """

    def __init__(self, board: Board, sender: PacketSender) -> None:
        """Send to `board` through `sender`, from `start` on."""
        self.waiting = RoundRobin()
        """Unsent requests of all programs."""
        self._board = board
        self._sender = sender
        self._loop = asyncio.get_running_loop()
        self._tasks = Tasks()
        self._idle: deque[asyncio.Future[Exchange]] = deque()  # each of a task
        self._active = 0  # exchanges under way
        self._quiet = 0  # blocks of `quiet`
        self.on_over: RequestFollower | None = None
        """Called when a request is over, but not for a query with a response; None if nobody wants to know."""

    def start(self) -> None:
        """Begin to send queued requests."""
        for _ in range(self._board.connection.most_under_way):
            first = self._loop.create_future()
            self._idle.append(first)
            self._tasks.begin(self._work(first))

    async def close(self) -> None:
        """Stop sending. Requests under way are given up."""
        self._idle.clear()
        await self._tasks.close()

    def ask(self, exchange: Exchange) -> None:
        """Queue a request, send the request in turn, and finish."""
        self.waiting.add(exchange)
        self.send_waiting()

    def withdraw(self, exchange: Exchange) -> bool:
        """Drop a request that was not sent yet. Return whether the request was unsent."""
        return bool(self.waiting.drop_where(lambda waiting: waiting is exchange))

    async def begin(self, exchange: Exchange) -> Packet | None:
        """Send a motion ahead of all waiting requests, and return the response. Raise the reason for a failure."""
        outcome: object = False
        try:
            outcome = response = await self._sender.send(exchange, self.send_waiting)
        except ServolinkError as error:
            outcome = error
            raise
        finally:
            self._tell(exchange, outcome)
        return response

    def finish(self, exchange: Exchange, outcome: Packet | ServolinkError | Literal[False]) -> None:
        """Finish a request with the response, an error, or False after giving up."""
        self._tell(exchange, outcome)
        if isinstance(outcome, ServolinkError):
            exchange.error = outcome
        _finish(exchange, outcome if isinstance(outcome, Packet) else None)

    def drop_motions(self, reason: str) -> None:
        """Give up waiting motions, with the reason for people."""
        for exchange in self.waiting.drop_where(lambda waiting: waiting.packet.is_motion):
            self._tasks.begin(self._finish_stopped(exchange, reason))

    @contextmanager
    def quiet(self) -> Iterator[None]:
        """Send no waiting request in the block. A motion that is begun right after the block finds a free line."""
        self._quiet += 1
        try:
            yield
        finally:
            self._quiet -= 1
            self._loop.call_soon(self.send_waiting)  # after the motion

    def send_waiting(self) -> None:
        """Send waiting requests while the connection has room."""
        waiting = self.waiting
        if self._quiet:
            return
        while waiting.ring and self._idle and (not self._active or self._active < self._board.connection.callers):
            exchange = waiting.take()
            if exchange is None:
                return
            self._active += 1
            if waiting.ring and isinstance(exchange.packet, Query):
                exchange.equal = waiting.take_equal(exchange, _means_same)
            if self._sender.send_at_once(exchange, self._answered):
                continue
            exchange.program.queue.blocked_by = exchange
            exchange.may_wait = self._sender.may_wait(exchange)
            if exchange.may_wait:
                self._active -= 1  # must not occupy one of the places of the connection
                self._tasks.begin(self._carry_out(exchange))
            else:
                self._idle.popleft().set_result(exchange)

    def _answered(self, exchange: Exchange, outcome: Packet | ServolinkError, content: bytes | None) -> None:
        """Finish a query that was sent immediately."""
        self._active -= 1
        if isinstance(outcome, ServolinkError):
            _logger.debug("%s", outcome)
            self.finish(exchange, outcome)
        else:
            _finish(exchange, outcome, content, self._board.connection.codec)
        if self.waiting.ring:
            self.send_waiting()

    async def _work(self, next_one: asyncio.Future[Exchange]) -> None:
        """Carry out exchanges in turn, each to the end."""
        while True:
            await self._carry_out(await next_one)
            self._active -= 1
            next_one = self._loop.create_future()
            self._idle.append(next_one)
            self.send_waiting()

    async def _carry_out(self, exchange: Exchange) -> None:
        response: Packet | None = None
        outcome: object = False
        try:
            outcome = response = await self._sender.send(exchange, self.send_waiting)
        except ServolinkError as error:
            _logger.debug("%s", error)
            outcome = exchange.error = error
        except Exception:
            # A defect of ours. The board and the other programs should go on all the same.
            _logger.exception("%s of %s failed", type(exchange.packet).__name__, escape(exchange.program.who))
        finally:
            self._tell(exchange, outcome)
            _finish(exchange, response)

    async def _finish_stopped(self, exchange: Exchange, reason: str) -> None:
        response: Packet | None = None
        try:
            response = await self._sender.refused(exchange, MotionOver(reason, reason=Reason.STOP))
        finally:
            self._tell(exchange, response)
            exchange.program.finish(exchange, response)

    def _tell(self, exchange: Exchange, outcome: object) -> None:
        """Report the outcome of a request: a response, an error, None for a sent command, or False."""
        if self.on_over is None:
            return
        if isinstance(exchange.packet, Query) and not isinstance(outcome, ServolinkError):
            return
        if outcome is None:
            outcome = isinstance(exchange.packet, Command) and not exchange.program.has_left
        outcome, program = exchange.refused or outcome, exchange.program
        self.on_over(exchange.packet, outcome, exchange.asked_at, program.who, program.session_id)


def _finish(
    exchange: Exchange, response: Packet | None, content: bytes | None = None, codec: Codec | None = None
) -> None:
    """Finish an exchange and all equal exchanges. `content` is the response in the encoding of `codec`."""
    for each in (exchange, *exchange.equal):
        if response is None:
            each.program.counters.unanswered += isinstance(each.packet, Request)
            each.error = exchange.error
        each.program.finish(each, response, content, codec)


def _means_same(one: Exchange, other: Exchange) -> bool:
    """Return whether the response to a query answers an equal query as well."""
    return one.program.units == other.program.units or not carries_angles(one.packet)
