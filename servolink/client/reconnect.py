"""Reconnecting: the same board again after its connection was lost, with its session restored.

Whatever waited for the lost link fails at once, and motion never resumes by itself. What the board forgets at a
restart (angle units, transmission mode, the subscription to button events) is applied again before it is used.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Literal

from servolink.client.link import Link
from servolink.errors import ServolinkError

_logger = logging.getLogger(__name__)

ConnectionState = Literal["connected", "lost", "closed"]

FIRST_PAUSE = 0.1
"""Seconds from the loss of a connection to the first try; each further pause is twice as long."""
LONGEST_PAUSE = 5.0


class States:
    """The state of a connection, for any number of readers."""

    def __init__(self) -> None:
        """Begin connected."""
        self.now: ConnectionState = "connected"
        self._readers: list[asyncio.Queue[ConnectionState]] = []

    def become(self, state: ConnectionState) -> None:
        """Tell every reader of a change; nothing comes after `closed`."""
        if self.now not in {state, "closed"}:
            self.now = state
            for reader in self._readers:
                reader.put_nowait(state)

    async def read(self) -> AsyncIterator[ConnectionState]:
        """Yield the state as it is and then each change, up to `closed`."""
        reader: asyncio.Queue[ConnectionState] = asyncio.Queue()
        reader.put_nowait(self.now)
        self._readers.append(reader)
        try:
            state: ConnectionState | None = None
            while state != "closed":
                state = await reader.get()
                yield state
        finally:
            self._readers.remove(reader)


class Reconnector:
    """Brings a board back whenever its link is lost."""

    def __init__(self, open_link: Callable[[], Awaitable[Link]], resume: Callable[[Link], Awaitable[None]]) -> None:
        """`open_link` opens a new link to the same board; `resume` restores the session on it and uses it."""
        self._open_link = open_link
        self._resume = resume
        self._task: asyncio.Task[None] | None = None
        self._stopped = False

    def start(self) -> bool:
        """Begin to reconnect, unless that is under way; tell whether it is, which it is not after `stop`."""
        if not self._stopped and (self._task is None or self._task.done()):
            self._task = asyncio.get_running_loop().create_task(self._until_connected())
        return not self._stopped

    async def stop(self) -> None:
        """Give up for good."""
        self._stopped = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait((self._task,))

    async def _until_connected(self) -> None:
        pause = FIRST_PAUSE
        while True:
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)
            try:
                await self._resume_on(await self._open_link())
            except ServolinkError:
                pass  # not there yet, not to be opened yet, or another one
            except Exception:
                _logger.exception("a try to reconnect failed in a way that is none of ours; the next is in %g s", pause)
            else:
                return

    async def _resume_on(self, link: Link) -> None:
        try:
            await self._resume(link)
        except BaseException:
            await link.close()
            raise
