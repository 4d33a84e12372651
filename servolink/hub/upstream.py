"""Upstream: the requests of all programs go to the board through its one connection."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Coroutine
from typing import Any

from servolink.client.board import Board
from servolink.errors import ServolinkError
from servolink.escaping import escape
from servolink.hub.exchanges import Exchange, RoundRobin
from servolink.hub.roles import carries_angles, is_motion
from servolink.hub.sending import STOPPED, PacketSender
from servolink.hub.session_state import SessionState
from servolink.hub.stopping import stop
from servolink.protocol.packet import Packet, Query, Request
from servolink.protocol.servos import SetServoParameterRequest

_logger = logging.getLogger(__name__)


class Upstream:
    """Sends the requests of all programs, as many at once as the connection has use for.

    The tasks live as long as the hub; one for each request would cost as much as the request.
    """

    def __init__(self, board: Board, sender: PacketSender) -> None:
        """Send to `board` through `sender`, from `start` on."""
        self.waiting = RoundRobin()
        """What was not sent yet."""
        self._board = board
        self._sender = sender
        self._loop = asyncio.get_running_loop()
        self._tasks = list[asyncio.Task[None]]()
        self._idle: deque[asyncio.Future[None]] = deque()
        self._active = 0  # tasks that have an exchange, or were woken for one
        self._others = set[asyncio.Task[None]]()

    def start(self) -> None:
        """Begin to send."""
        self._tasks = [self._loop.create_task(self._work()) for _ in range(self._board.connection.depth_bound)]

    async def close(self) -> None:
        """Stop sending. What is under way is given up."""
        self._idle.clear()
        tasks = (*self._tasks, *self._others)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def ask(self, exchange: Exchange) -> None:
        """Send a request when it is its turn, and finish it."""
        exchange.stops = self._sender.stops
        self.waiting.add(exchange)
        self.wake()

    def ask_stop(self, exchange: Exchange) -> None:
        """Send a stop at once, and finish it."""
        self._begin(self._stop(exchange))

    def drop_motions(self) -> None:
        """Send none of the motions that were asked for until now: a stop comes first."""
        self._sender.stops += 1
        for exchange in self.waiting.drop_where(lambda waiting: is_motion(waiting.packet)):
            self._begin(self._finish_stopped(exchange))

    def wake(self) -> None:
        """Look again for what may be sent now."""
        if self._idle and self.waiting and self._active < self._board.connection.callers:
            self._active += 1
            self._idle.popleft().set_result(None)

    async def _work(self) -> None:
        """Carry out one exchange after the other; one task of many."""
        while True:
            woken = self._loop.create_future()
            self._idle.append(woken)
            self.wake()  # this one or another, if there is something to do
            await woken
            try:
                while self._active <= self._board.connection.callers and (exchange := self.waiting.take()):
                    self.wake()  # another task, if there is more to do
                    await self._carry_out(exchange)
            finally:
                self._active -= 1

    async def _carry_out(self, exchange: Exchange) -> None:
        """Send a request, and finish it and all that its response answers as well."""
        equal = list[Exchange]()
        if isinstance(exchange.packet, Query) and self.waiting:
            state = exchange.program.state
            equal = self.waiting.take_equal(exchange, lambda other: _means_same(other, state))
        response: Packet | None = None
        try:
            response = await self._sender.send(exchange, self.wake)
        except ServolinkError as error:
            _logger.debug("%s", error)
        except Exception:
            # A defect of ours. The board and the other programs should go on all the same.
            _logger.exception("%s of %s failed", type(exchange.packet).__name__, escape(exchange.program.who))
        finally:
            for each in (exchange, *equal):
                _finish(each, response)

    async def _stop(self, exchange: Exchange) -> None:
        packet, response = exchange.packet, None
        assert isinstance(packet, SetServoParameterRequest)  # noqa: S101 - narrows the type
        try:
            response = await stop(self._board, packet)
        except ServolinkError as error:
            _logger.warning("%s", error)
        finally:
            _finish(exchange, response)

    async def _finish_stopped(self, exchange: Exchange) -> None:
        response: Packet | None = None
        try:
            response = await self._sender.refused(exchange, STOPPED)
        finally:
            exchange.program.finish(exchange, response)

    def _begin(self, doing: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(doing)
        self._others.add(task)
        task.add_done_callback(self._others.discard)


def _finish(exchange: Exchange, response: Packet | None) -> None:
    if response is None and isinstance(exchange.packet, Request):
        exchange.program.counters.unanswered += 1
    exchange.program.finish(exchange, response)


def _means_same(exchange: Exchange, state: SessionState) -> bool:
    """Return whether the response to a query of a program with `state` answers an equal one as well."""
    other = exchange.program.state
    is_same = other is state or (other.unit == state.unit and other.units == state.units)
    return is_same or not carries_angles(exchange.packet)
