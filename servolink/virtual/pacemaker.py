"""Runs a virtual board in the time of the event loop."""

from __future__ import annotations

import asyncio

from servolink.virtual.board import VirtualBoard


class Pacemaker:
    """Wakes a board whenever it has something to do by itself; several for one board do no harm."""

    def __init__(self, board: VirtualBoard) -> None:
        """Begin at once, on the running loop, until `stop`."""
        self._board = board
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        board.advance(self._loop.time())
        board.watch(self._set)
        self._set()

    def stop(self) -> None:
        """Leave the board to itself."""
        self._board.unwatch(self._set)
        self._clear()

    def _set(self) -> None:
        due = self._board.next_due(self._loop.time())
        if self._timer is not None and self._timer.when() == due:
            return
        self._clear()
        if due is not None:
            self._timer = self._loop.call_at(due, self._beat, due)

    def _beat(self, due: float) -> None:
        self._timer = None
        # Timers may fire a little early; the board must not find that nothing is due yet.
        self._board.advance(max(due, self._loop.time()))
        self._set()

    def _clear(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
