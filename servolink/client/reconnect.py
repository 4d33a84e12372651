"""Restoring a lost connection: attempts in growing pauses."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable

from servolink.connection import PacketConnection
from servolink.errors import NotFound, ServolinkError
from servolink.support import Pauses, Reconnecting

_logger = logging.getLogger(__name__)


class Reconnector:
    """Attempts to reopen a board in the background, in growing intervals."""

    def __init__(
        self,
        open_connection: Callable[[], Awaitable[PacketConnection]],
        resume: Callable[[PacketConnection], Awaitable[None]],
        on_another: Callable[[str], None],
    ) -> None:
        """Connect with `open_connection`; `resume` then restores the session, or raises on failure.

        `on_another` is called with a description when another board answers, and with no text when that has ended.
        """
        self._open_connection = open_connection
        self._resume = resume
        self._on_another = on_another
        self._pauses = Pauses()
        self._wrong_board = ""
        self._task: asyncio.Task[None] | None = None
        self._stopped = False

    def start(self) -> bool:
        """Start to reconnect, unless under way. Return False after `stop`, when nothing is started."""
        if not self._stopped and (self._task is None or self._task.done()):
            self._task = asyncio.get_running_loop().create_task(self._until_connected())
        return not self._stopped

    async def stop(self) -> None:
        """Cancel reconnecting, and never begin again."""
        self._stopped = True
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait((self._task,))

    async def _until_connected(self) -> None:
        self._pauses.restart()
        self._wrong_board = ""
        await self._pauses.wait()
        await anext(Reconnecting(self._reopen, self._pauses, self._retry))

    def _retry(self, error: Exception) -> bool:
        if not isinstance(error, ServolinkError):
            # A defect of ours or of a third-party transport. A board on a robot should come back all the same.
            _logger.error(
                "unexpected error while reconnecting; next attempt in %g s", self._pauses.next, exc_info=error
            )
            return True
        # Not plugged in yet, or still busy: expected, so only a trace in the log.
        _logger.debug("cannot reconnect yet, next attempt in %g s: %s", self._pauses.next, error)
        wrong_board = str(error) if isinstance(error, NotFound) else ""
        if wrong_board != self._wrong_board:
            if wrong_board:  # nobody would find out why the lost board never comes back
                _logger.warning("%s; still waiting for the board that was lost", wrong_board)
            self._wrong_board = wrong_board
            self._on_another(wrong_board)
        return True

    async def _reopen(self) -> None:
        connection = await self._open_connection()
        try:
            await self._resume(connection)
        except BaseException:
            await connection.close()  # or the next attempt finds the port busy
            raise
