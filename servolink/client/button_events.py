"""Button events (3.4.7, 3.4.8): one subscription on the board, any number of readers in the program."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from servolink.client.readers import Reader, SharedIterator, Source
from servolink.client.session import Session
from servolink.connection import PacketConnection
from servolink.errors import ConnectionLost, Rejected, ServolinkError, quote
from servolink.protocol import ButtonEventResponse, SubscribeButtonEventRequest
from servolink.support import as_number, is_integer

ButtonEvent = ButtonEventResponse
"""A button event: `button_id`, `event` (1 press, 2 long press, 4 up) and `kind`, the event in words."""


_CLOSING_TIMEOUT = 0.5  # seconds for ending the subscription when the board is closed


class ButtonSubscription(Source[Reader[ButtonEvent]]):
    """Subscription on the board while there are readers; each reader gets every event."""

    def __init__(self, session: Session) -> None:
        super().__init__(session.loop)
        self._readers: set[Reader[ButtonEvent]] = set()
        self._subscribed: bool | None = False
        """Whether the board sends events; None after an unanswered request to change it."""
        self._ended = False
        self._changing = asyncio.Lock()
        self._leaving: set[asyncio.Task[None]] = set()
        self._connection = session.connection
        self._connection.answers.on_event = self._deliver
        session.end_with(self._end)
        session.restore_with(self._restore)

    async def join(self, reader: Reader[ButtonEvent]) -> None:
        """Deliver events to `reader`. Raise Rejected or ConnectionLost if the board sends none."""
        if self._connection.ended is not None:
            reader.ended = self._ended
            raise self._connection.ended.copy()
        self._readers.add(reader)
        try:
            await self._settle()
        except BaseException:
            self.leave_soon(reader)
            raise

    async def leave(self, reader: Reader[ButtonEvent]) -> None:
        """Stop delivering to `reader`; when the last reader leaves, unsubscribe."""
        self._readers.discard(reader)
        reader.end()
        await self._settle()

    def leave_soon(self, reader: Reader[ButtonEvent]) -> None:
        """Leave in the background, for callers outside coroutines."""
        if reader in self._readers and not self._loop.is_closed():
            task = self._loop.create_task(self._leave_quietly(reader))
            self._leaving.add(task)
            task.add_done_callback(self._leaving.discard)

    async def close(self) -> None:
        """End every reader and unsubscribe, within half a second even if the board does not respond."""
        for reader in list(self._readers):
            self.leave_soon(reader)
        if self._leaving:
            _, late = await asyncio.wait(self._leaving, timeout=_CLOSING_TIMEOUT)
            for task in late:
                task.cancel()

    def _end(self, error: ConnectionLost) -> None:
        """End every reader for good: with `error` after a loss, quietly if the program closed the board."""
        self._ended = True
        for reader in self._readers:
            reader.end(error)
        self._readers.clear()

    async def _restore(self, connection: PacketConnection) -> None:
        """Subscribe on a new connection if there are readers."""
        async with self._changing:
            self._connection = connection
            self._subscribed = False
            connection.answers.on_event = self._deliver
        await self._settle()

    async def _leave_quietly(self, reader: Reader[ButtonEvent]) -> None:
        with suppress(ServolinkError):  # without readers, later events are only counted
            await self.leave(reader)

    async def _settle(self) -> None:
        """Subscribe if there are readers, unsubscribe if there are none."""
        async with self._changing:
            has_readers = bool(self._readers)
            if has_readers == self._subscribed or self._connection.ended is not None:
                return
            # None while the request is under way: after an unanswered request, the next call asks again in any case.
            before, self._subscribed = self._subscribed, None
            request = SubscribeButtonEventRequest(subscribe=int(has_readers))
            response = await self._connection.request(request)
            if not response.result:
                self._subscribed = before
                raise Rejected(f"the board refused to {'start' if has_readers else 'end'} button events", request)
            self._subscribed = has_readers

    def _deliver(self, event: ButtonEvent) -> None:
        for reader in self._readers:
            self._connection.stats.events_dropped += reader.put(event)


class ButtonEvents(SharedIterator[ButtonEvent, Reader[ButtonEvent]]):
    """Button events as an async iterator; `async with`, or simply `async for`, subscribes and unsubscribes.

    It ends when the board is closed and raises ConnectionLost when the connection is lost for good. A reader that is
    too slow loses its oldest events; `dropped` counts them.
    """

    def __init__(self, subscription: ButtonSubscription, limit: int) -> None:
        """Keep up to `limit` unread events."""
        self._limit: int = as_number(limit)
        if not is_integer(self._limit):
            raise TypeError(f"limit must be an integer, not {quote(limit)}")
        if self._limit < 1:
            raise ValueError(f"limit must be at least 1, not {quote(limit)}")
        super().__init__(subscription)

    def __repr__(self) -> str:
        """Return state and counters, such as `<ButtonEvents subscribed, 2 unread, 0 dropped>`."""
        state = "ended" if self._reader.ended else "subscribed" if self._joined else "not subscribed"
        return f"<ButtonEvents {state}, {len(self._reader.items)} unread, {self.dropped} dropped>"

    @property
    def dropped(self) -> int:
        """Number of events lost because the reader was too slow."""
        return self._reader.dropped

    def _new_reader(self) -> Reader[ButtonEvent]:
        return Reader(self._limit)
