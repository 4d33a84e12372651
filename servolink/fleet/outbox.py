"""Outbox: messages for the broker, kept until confirmed, across losses of the connection."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple, NoReturn

from servolink.errors import ConnectionLost
from servolink.fleet.broker import BrokerConnection, Denied
from servolink.fleet.broker_messages import Publication

MOST_KEPT = 1000
"""Most waiting messages; beyond the limit, the oldest is dropped, and counted."""
MOST_ANSWERS = 20_000
"""A broker can send all waiting commands together, without an acknowledgement; each is answered."""
_AT_ONCE = 16  # messages without the broker's confirmation: no pause is needed between any two


class _Item(NamedTuple):
    message: Publication
    on_sent: Callable[[], None] | None


class Outbox:
    """Sender of messages in order. A message sent when the connection was lost is sent again."""

    def __init__(self, broker: BrokerConnection) -> None:
        """Send over `broker`; use `run`."""
        self.dropped = 0
        """Number of messages dropped because too many waited."""
        self._broker = broker
        self._waiting: deque[_Item] = deque()
        self._news = asyncio.Event()

    def put(self, message: Publication, on_sent: Callable[[], None] | None = None) -> None:
        """Queue a message; `on_sent` is called when the broker has confirmed, or refuses for good.

        A message with `on_sent` is an answer, and dropped only for the newest of twenty thousand.
        """
        if on_sent is None and len(self._waiting) >= MOST_KEPT:
            self._drop_one()
        elif len(self._waiting) >= MOST_ANSWERS:
            self._waiting.popleft()
            self.dropped += 1
        self._waiting.append(_Item(message, on_sent))
        self._news.set()

    def _drop_one(self) -> None:
        """Drop the oldest message that is not an answer, if any."""
        oldest = next((at for at, item in enumerate(self._waiting) if item.on_sent is None), None)
        if oldest is not None:
            del self._waiting[oldest]
            self.dropped += 1

    async def run(self) -> NoReturn:
        """Send queued messages, in an endless loop."""
        while True:
            await self._news.wait()
            await self._broker.until_connected()
            await self._send_some()
            if not self._waiting:
                self._news.clear()

    async def flush(self) -> None:
        """Send queued messages, as far as the connection allows."""
        while self._waiting and self._broker.is_connected:
            if not await self._send_some():
                return

    async def _send_some(self) -> bool:
        """Send the next messages; return whether the broker has all of them."""
        items = [self._waiting.popleft() for _ in range(min(_AT_ONCE, len(self._waiting)))]
        done = [False] * len(items)

        async def send(at: int) -> None:
            item = items[at]
            with suppress(ConnectionLost):
                with suppress(Denied):  # reported by the connection; another attempt would be denied, too
                    await self._broker.send(item.message)
                done[at] = True
                if item.on_sent is not None:
                    item.on_sent()

        try:
            await asyncio.gather(*map(send, range(len(items))))
        finally:
            self._waiting.extendleft(
                item for item, is_done in reversed([*zip(items, done, strict=True)]) if not is_done
            )
        return all(done)
