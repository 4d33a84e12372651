"""QueryAsker: queries without a waiting task; a function is called with the response or the error."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, TypeAlias

from servolink.connection.call import Call
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.frame_writer import FrameWriter
from servolink.connection.scheduler import RequestScheduler
from servolink.connection.sender import RequestSender
from servolink.errors import ConnectionLost, ServolinkError
from servolink.protocol import Query, Response
from servolink.support import Tasks

Done: TypeAlias = Callable[["Response | ServolinkError", "bytes | None"], None]
"""Called with the response to a query, and its content as it came if that is known; or with an error."""


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
