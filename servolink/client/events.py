"""Button events: one subscription on the board, any number of readers here."""

from __future__ import annotations

import asyncio
from collections import deque
from contextlib import suppress
from types import TracebackType
from typing import Self

from servolink.connection.connection import Connection
from servolink.connection.explain import same
from servolink.errors import ConnectionLost, Rejected, ServolinkError
from servolink.protocol.joystick import ButtonEventResponse, SubscribeButtonEventRequest

ButtonEvent = ButtonEventResponse
"""A button event: `button_id`, `event` (1 press, 2 long press, 4 up) and `kind`, the event in words."""


_PARTING = 0.5  # seconds that a closing board gets to end the subscription


class _Queue:
    """The events that one reader has not read yet."""

    def __init__(self, limit: int) -> None:
        self.events: deque[ButtonEvent] = deque(maxlen=limit)
        self.news = asyncio.Event()
        self.dropped = 0
        self.ended = False
        self.error: ConnectionLost | None = None


class Subscription:
    """The board pushes events while at least one reader is there."""

    def __init__(self, link: Connection) -> None:
        """Take the events of `link`."""
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._queues: set[_Queue] = set()
        self._subscribed: bool | None = False
        """Whether the board pushes events; None when it was asked to change that and has not answered."""
        self._ended = False
        self._changing = asyncio.Lock()
        self._leaving: set[asyncio.Task[None]] = set()
        link.answers.on_event = self._deliver

    async def move(self, link: Connection) -> None:
        """Go on with another link, and subscribe there if anybody reads."""
        async with self._changing:
            self._link = link
            self._subscribed = False
            link.answers.on_event = self._deliver
        await self._settle()

    def end(self, error: ConnectionLost) -> None:
        """End every reader, for good: by `error`, or quietly if that was asked for."""
        self._ended = True
        for queue in self._queues:
            queue.error = error
            queue.ended = True
            queue.news.set()
        self._queues.clear()

    async def join(self, queue: _Queue) -> None:
        """Deliver to `queue` from now on; Rejected or ConnectionLost if the board does not."""
        if self._link.answers.ended is not None:
            queue.ended = self._ended
            raise same(self._link.answers.ended)
        self._queues.add(queue)
        try:
            await self._settle()
        except BaseException:
            self.leave_soon(queue)
            raise

    async def leave(self, queue: _Queue) -> None:
        """Deliver no more to `queue`; the last reader ends the subscription."""
        self._queues.discard(queue)
        queue.ended = True
        queue.news.set()
        await self._settle()

    def leave_soon(self, queue: _Queue) -> None:
        """Do the same from where nothing can be awaited."""
        if queue in self._queues and not self._loop.is_closed():
            task = self._loop.create_task(self._leave_quietly(queue))
            self._leaving.add(task)
            task.add_done_callback(self._leaving.discard)

    async def close(self) -> None:
        """End the subscription and every reader, as far as the link allows within half a second."""
        for queue in list(self._queues):
            self.leave_soon(queue)
        if self._leaving:
            _, late = await asyncio.wait(self._leaving, timeout=_PARTING)
            for task in late:
                task.cancel()

    async def _leave_quietly(self, queue: _Queue) -> None:
        with suppress(ServolinkError):  # the reader has gone; pushes that still come are counted and dropped
            await self.leave(queue)

    async def _settle(self) -> None:
        async with self._changing:
            wanted = bool(self._queues)
            if wanted == self._subscribed or self._link.answers.ended is not None:
                return
            before, self._subscribed = self._subscribed, None  # an unanswered request is followed by another
            request = SubscribeButtonEventRequest(subscribe=int(wanted))
            response = await self._link.request(request)
            if not response.result:
                self._subscribed = before
                raise Rejected(f"the board refused to {'start' if wanted else 'end'} button events", request)
            self._subscribed = wanted

    def _deliver(self, event: ButtonEvent) -> None:
        for queue in self._queues:
            if len(queue.events) == queue.events.maxlen:
                queue.dropped += 1
                self._link.stats.events_dropped += 1
            queue.events.append(event)
            queue.news.set()


class ButtonEvents:
    """Button events as an async iterator; `async with`, or simply `async for`, subscribes and unsubscribes.

    Ends when the board is closed, raises ConnectionLost when the connection is lost. A reader that is too slow
    loses its oldest events, counted in `dropped`.
    """

    def __init__(self, subscription: Subscription, limit: int) -> None:
        """Keep at most `limit` events that have not been read."""
        self._joined = False  # first, as __del__ is called even if the limit is refused
        if limit < 1:
            raise ValueError(f"limit: {limit} is outside 1..")
        self._subscription = subscription
        self._limit = limit
        self._queue = _Queue(limit)

    @property
    def dropped(self) -> int:
        """How many events this reader has lost by being too slow."""
        return self._queue.dropped

    def __aiter__(self) -> Self:
        """Return itself."""
        return self

    async def __anext__(self) -> ButtonEvent:
        """Wait for the next event."""
        await self._join()
        queue = self._queue
        while not queue.events:
            if queue is not self._queue:  # another task has joined for both, and failed
                return await anext(self)
            if queue.ended:
                if queue.error is not None and queue.error.__cause__ is not None:
                    raise same(queue.error)
                raise StopAsyncIteration
            queue.news.clear()
            await queue.news.wait()
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
        """Unsubscribe; the iterator ends."""
        if self._joined and not self._queue.ended:
            await self._subscription.leave(self._queue)
        self._queue.ended = True

    def __del__(self) -> None:
        """Unsubscribe when `async for` was left by `break`."""
        if self._joined:
            self._subscription.leave_soon(self._queue)

    async def _join(self) -> None:
        if not self._joined and not self._queue.ended:
            self._joined = True
            queue = self._queue
            try:
                await self._subscription.join(queue)
            except BaseException:  # the next one who waits tries again
                if not queue.ended:
                    self._joined, self._queue = False, _Queue(self._limit)
                raise
