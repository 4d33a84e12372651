"""Upstream: the requests of all programs go to the board through its one connection."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias, TypeVar

from servolink.client.board import Board
from servolink.client.roles import is_motion
from servolink.connection.scheduler import MOST_ASIDE
from servolink.errors import ServolinkError
from servolink.escaping import escape
from servolink.hub.exchanges import Bounds, Exchange, RoundRobin
from servolink.hub.roles import carries_angles
from servolink.hub.sending import STOPPED, PacketSender
from servolink.hub.stopping import stop
from servolink.protocol.codec import Codec
from servolink.protocol.frame import encode_frame
from servolink.protocol.packet import Command, Packet, Query, Request
from servolink.protocol.servos import SetServoParameterRequest, SetServoParameterResponse

_logger = logging.getLogger(__name__)

T = TypeVar("T")

OnOver: TypeAlias = Callable[[Exchange, object], None]
"""Takes a request and its response, True if boards do not answer it, False if it was not sent, or why it was not."""


class _Stopping(NamedTuple):
    """A stop that is under way."""

    motions: int
    """How many motions had been sent when it began."""
    task: asyncio.Task[SetServoParameterResponse]


class Upstream:
    """Sends the requests of all programs, as many at once as the connection has use for.

    Most are queries that need nothing first: they are sent and answered without any task. The others are carried out by
    tasks that live as long as the hub; those that wait for something else than the line, each by a task of its own.
    """

    def __init__(self, board: Board, sender: PacketSender) -> None:
        """Send to `board` through `sender`, from `start` on."""
        self.waiting = RoundRobin()
        """What was not sent yet."""
        self._board = board
        self._sender = sender
        self._loop = asyncio.get_running_loop()
        self._tasks = list[asyncio.Task[None]]()
        self._idle: deque[asyncio.Future[Exchange]] = deque()  # each of a task
        self._active = 0  # exchanges under way
        self._stopping: dict[SetServoParameterRequest, _Stopping] = {}
        self.on_over: OnOver | None = None
        """Called when a request is over, but not for a query with a response; None if nobody wants to know."""
        self._others = set[asyncio.Task[Any]]()

    @property
    def stops(self) -> int:
        """How many times everything was stopped."""
        return self._sender.stops

    @property
    def is_stopped(self) -> bool:
        """Whether somebody has stopped all servos, and nobody has started any since."""
        return self._sender.is_stopped

    def stopped_all(self) -> None:
        """Count all servos as stopped until somebody starts one."""
        self._sender.is_stopped = True

    def start(self) -> None:
        """Begin to send."""
        for _ in range(self._board.connection.depth_bound + MOST_ASIDE):
            first = self._loop.create_future()
            self._idle.append(first)
            self._tasks.append(self._loop.create_task(self._work(first)))

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
        bounds = exchange.program.bounds
        exchange.stops, exchange.until = bounds or Bounds(self._sender.stops)
        self.waiting.add(exchange)
        self.send_waiting()

    def ask_stop(self, exchange: Exchange) -> None:
        """Send a stop at once (see `stop`), and finish it."""
        packet = exchange.packet
        assert isinstance(packet, SetServoParameterRequest)  # noqa: S101 - narrows the type
        self.stop(packet).add_done_callback(partial(self._stop_ended, exchange))

    def stop(self, packet: SetServoParameterRequest) -> asyncio.Task[SetServoParameterResponse]:
        """Send a stop at once and return its task; or that of an equal one, if nothing was moved since that began.

        Others may wait for the task, too: do not cancel it.
        """
        motions, under_way = self._sender.motions, self._stopping.get(packet)
        if under_way is not None and under_way.motions == motions:
            return under_way.task
        task = self._begin(stop(self._board, packet))
        self._stopping[packet] = _Stopping(motions, task)
        task.add_done_callback(partial(self._forget_stop, packet))
        return task

    async def begin(self, exchange: Exchange) -> Packet | None:
        """Send a motion before all that waits, and return the response. Raise what prevents that."""
        outcome: object = False
        try:
            outcome = response = await self._sender.send(exchange, self.send_waiting)
        except ServolinkError as error:
            outcome = error
            raise
        finally:
            self._tell(exchange, outcome)
        return response

    def drop_motions(self) -> None:
        """Send none of the motions that were asked for until now: a stop comes first."""
        self._sender.stops += 1
        for exchange in self.waiting.drop_where(lambda waiting: is_motion(waiting.packet)):
            self._begin(self._finish_stopped(exchange))

    def send_waiting(self) -> None:
        """Send what may be sent now."""
        while self._idle and self._active < self._board.connection.callers:
            exchange = self.waiting.take()
            if exchange is None:
                return
            self._active += 1
            if isinstance(exchange.packet, Query):
                exchange.equal = self.waiting.take_equal(exchange, _means_same)
            if self._sender.send_at_once(exchange, self._answered):
                continue
            exchange.program.queue.blocked_by = exchange
            if self._sender.may_wait(exchange):
                self._active -= 1  # others should not wait with it
                self._begin(self._carry_out(exchange))
            else:
                self._idle.popleft().set_result(exchange)

    def _answered(self, exchange: Exchange, outcome: Packet | ServolinkError, content: bytes | None) -> None:
        """Finish a query that was sent at once."""
        self._active -= 1
        if isinstance(outcome, ServolinkError):
            _logger.debug("%s", outcome)
            self._tell(exchange, outcome)
            _finish(exchange, None)
        else:
            _finish(exchange, outcome, content, self._board.codec)
        self.send_waiting()

    async def _work(self, next_one: asyncio.Future[Exchange]) -> None:
        """Carry out one exchange after the other."""
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
            outcome = error
        except Exception:
            # A defect of ours. The board and the other programs should go on all the same.
            _logger.exception("%s of %s failed", type(exchange.packet).__name__, escape(exchange.program.who))
        finally:
            self._tell(exchange, outcome)
            _finish(exchange, response)

    def _forget_stop(self, packet: SetServoParameterRequest, task: asyncio.Task[SetServoParameterResponse]) -> None:
        if self._stopping[packet].task is task:
            del self._stopping[packet]
        outcome = outcome_of(task)
        if isinstance(outcome, ServolinkError):
            _logger.warning("%s", outcome)

    def _stop_ended(self, exchange: Exchange, task: asyncio.Task[SetServoParameterResponse]) -> None:
        outcome = outcome_of(task)
        self._tell(exchange, outcome)
        _finish(exchange, outcome if isinstance(outcome, Packet) else None)

    async def _finish_stopped(self, exchange: Exchange) -> None:
        response: Packet | None = None
        try:
            response = await self._sender.refused(exchange, STOPPED)
        finally:
            self._tell(exchange, response)
            exchange.program.finish(exchange, response)

    def _tell(self, exchange: Exchange, outcome: object) -> None:
        """Pass on what became of a request: a response, an error, None for a command that was sent, or False."""
        if self.on_over is None:
            return
        if isinstance(exchange.packet, Query) and not isinstance(outcome, ServolinkError):
            return
        if outcome is None:
            outcome = isinstance(exchange.packet, Command) and not exchange.program.has_left
        self.on_over(exchange, exchange.refused or outcome)

    def _begin(self, doing: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        task = self._loop.create_task(doing)
        self._others.add(task)
        task.add_done_callback(self._others.discard)
        return task


def _finish(
    exchange: Exchange, response: Packet | None, content: bytes | None = None, codec: Codec | None = None
) -> None:
    """Finish an exchange, and all that its response answers as well. `content` is how `codec` would write it."""
    for each in (exchange, *exchange.equal):
        program = each.program
        if response is None:
            program.counters.unanswered += isinstance(each.packet, Request)
            program.finish(each, None)
        elif content is not None and codec is not None and program.codec.byte_order == codec.byte_order:
            # As it came: captions keep bytes that no encoding knows, and encoding it again takes longer.
            program.finish_with(each, encode_frame(response.packet_id, content, codec.byte_order))
        else:
            program.finish(each, response)


def outcome_of(task: asyncio.Task[Packet]) -> Packet | ServolinkError | Literal[False]:
    """Return what came of a stop whose task is over; False if it was given up."""
    if task.cancelled():
        return False
    try:
        return task.result()
    except ServolinkError as error:
        return error


def _means_same(one: Exchange, other: Exchange) -> bool:
    """Return whether the response to a query answers an equal one as well."""
    mine, its = one.program.state, other.program.state
    return mine is its or (mine.unit == its.unit and mine.units == its.units) or not carries_angles(one.packet)
