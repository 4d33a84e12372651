"""Button events (3.4.7, 3.4.8): one subscription on the board, any number of readers in the program."""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from types import TracebackType
from typing import Self

from servolink.client.session import Session
from servolink.connection.connection import Connection
from servolink.connection.explain import same
from servolink.errors import ConnectionLost, Rejected, ServolinkError
from servolink.protocol.joystick import ButtonEventResponse, SubscribeButtonEventRequest

ButtonEvent = ButtonEventResponse
"""A button event: `button_id`, `event` (1 press, 2 long press, 4 up) and `kind`, the event in words."""


_CLOSING_TIMEOUT = 0.5  # seconds for ending the subscription when the board is closed


class _Queue:
    """The events that one reader has not read yet."""

    def __init__(self, limit: int) -> None:
        self.events: deque[ButtonEvent] = deque(maxlen=limit)
        self.changed = asyncio.Event()
        self.dropped = 0
        self.ended = False
        self.error: ConnectionLost | None = None

    def end(self, error: ConnectionLost | None = None) -> None:
        self.ended = True
        self.error = error
        with suppress(RuntimeError):  # the reader's loop has ended, and nobody can be woken
            self.changed.set()


class ButtonSubscription:
    """Subscribes on the board while there is at least one reader, and gives each reader every event."""

    def __init__(self, session: Session) -> None:
        """Start without readers, not subscribed."""
        self._loop = asyncio.get_running_loop()
        self._queues: set[_Queue] = set()
        self._subscribed: bool | None = False
        """Whether the board sends events; None after a request to change that was not answered."""
        self._ended = False
        self._changing = asyncio.Lock()
        self._leaving: set[asyncio.Task[None]] = set()
        self._connection = session.connection
        self._connection.answers.on_event = self._deliver
        session.on_end = self._end
        session.restore_with(self._restore)

    async def join(self, queue: _Queue) -> None:
        """Deliver events to `queue`. Raise Rejected or ConnectionLost if the board does not send them."""
        if self._connection.answers.ended is not None:
            queue.ended = self._ended
            raise same(self._connection.answers.ended)
        self._queues.add(queue)
        try:
            await self._settle()
        except BaseException:
            self.leave_soon(queue)
            raise

    async def leave(self, queue: _Queue) -> None:
        """Stop delivering to `queue`; when the last reader leaves, unsubscribe."""
        self._queues.discard(queue)
        queue.end()
        await self._settle()

    def leave_soon(self, queue: _Queue) -> None:
        """Leave in the background, for callers that cannot await."""
        if queue in self._queues and not self._loop.is_closed():
            task = self._loop.create_task(self._leave_quietly(queue))
            self._leaving.add(task)
            task.add_done_callback(self._leaving.discard)

    async def close(self) -> None:
        """End every reader and unsubscribe, within half a second even if the board does not respond."""
        for queue in list(self._queues):
            self.leave_soon(queue)
        if self._leaving:
            _, late = await asyncio.wait(self._leaving, timeout=_CLOSING_TIMEOUT)
            for task in late:
                task.cancel()

    def _end(self, error: ConnectionLost) -> None:
        """End every reader for good: with `error` after a loss, quietly if the program closed the board."""
        self._ended = True
        for queue in self._queues:
            queue.end(error)
        self._queues.clear()

    async def _restore(self, connection: Connection) -> None:
        """Subscribe on a new connection if there are readers."""
        async with self._changing:
            self._connection = connection
            self._subscribed = False
            connection.answers.on_event = self._deliver
        await self._settle()

    async def _leave_quietly(self, queue: _Queue) -> None:
        with suppress(ServolinkError):  # nobody reads any more; events that still come are only counted
            await self.leave(queue)

    async def _settle(self) -> None:
        """Subscribe if there are readers, unsubscribe if there are none."""
        async with self._changing:
            wanted = bool(self._queues)
            if wanted == self._subscribed or self._connection.answers.ended is not None:
                return
            # None while the request is under way: if it fails unanswered, the next call asks again, whatever it wants.
            before, self._subscribed = self._subscribed, None
            request = SubscribeButtonEventRequest(subscribe=int(wanted))
            response = await self._connection.request(request)
            if not response.result:
                self._subscribed = before
                raise Rejected(f"the board refused to {'start' if wanted else 'end'} button events", request)
            self._subscribed = wanted

    def _deliver(self, event: ButtonEvent) -> None:
        for queue in self._queues:
            if len(queue.events) == queue.events.maxlen:
                queue.dropped += 1
                self._connection.stats.events_dropped += 1
            queue.events.append(event)
            queue.changed.set()


class ButtonEvents:
    """Button events as an async iterator; `async with`, or simply `async for`, subscribes and unsubscribes.

    It ends when the board is closed and raises ConnectionLost when the connection is lost for good. A reader that is
    too slow loses its oldest events; `dropped` counts them.
    """

    def __init__(self, subscription: ButtonSubscription, limit: int) -> None:
        """Keep up to `limit` unread events."""
        self._joined = False  # first, because __del__ runs even if the limit is refused
        if limit < 1:
            raise ValueError(f"limit must be at least 1, not {limit}")
        self._subscription = subscription
        self._limit = limit
        self._queue = _Queue(limit)

    def __repr__(self) -> str:
        """Return state and counters, such as `<ButtonEvents subscribed, 2 unread, 0 dropped>`."""
        state = "ended" if self._queue.ended else "subscribed" if self._joined else "not subscribed"
        return f"<ButtonEvents {state}, {len(self._queue.events)} unread, {self.dropped} dropped>"

    @property
    def dropped(self) -> int:
        """The number of events that this reader lost because it was too slow."""
        return self._queue.dropped

    def __aiter__(self) -> Self:
        """Return the iterator itself."""
        return self

    async def __anext__(self) -> ButtonEvent:
        """Return the next event, waiting for it if necessary."""
        await self._join()
        queue = self._queue
        while not queue.events:
            if queue is not self._queue:  # another task joined for both, failed, and left a fresh queue
                return await anext(self)
            if queue.ended:
                if queue.error is not None and queue.error.__cause__ is not None:
                    raise same(queue.error)
                raise StopAsyncIteration
            queue.changed.clear()
            await queue.changed.wait()
        return queue.events.popleft()

    async def __aenter__(self) -> Self:
        """Subscribe."""
        await self._join()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Unsubscribe."""
        await self.aclose()

    async def aclose(self) -> None:
        """Unsubscribe and end the iterator."""
        if self._joined and not self._queue.ended:
            await self._subscription.leave(self._queue)
        self._queue.ended = True

    def __del__(self) -> None:
        """Unsubscribe after `break` has left an `async for` loop."""
        if self._joined:
            self._subscription.leave_soon(self._queue)

    async def _join(self) -> None:
        if not self._joined and not self._queue.ended:
            self._joined = True
            queue = self._queue
            try:
                await self._subscription.join(queue)
            except BaseException:  # the next read tries again
                if not queue.ended:
                    self._joined, self._queue = False, _Queue(self._limit)
                raise
