"""Strangers: connections without a token, handshake or frame so far, kept from taking all open files."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Hashable
from weakref import WeakKeyDictionary

from servolink.support import most_open_files

_MOST_FILES = 16384  # where the system has no limit or a high one
_MOST_STRANGERS = 256  # likewise; dropping one takes time of the event loop
_OWN_FILES = 16  # for the hub and local programs, beside an eighth of all files


def _files() -> int:
    return min(most_open_files() or _MOST_FILES, _MOST_FILES)


class Strangers:
    """Connections of some doors: few strangers, the oldest making room for new connections, and admitted connections.

    Doors with the same object share the limit, as they share the open files of the process.
    """

    def __init__(self) -> None:
        """Begin without connections; the limit is that of the process now."""
        self.most = min(_MOST_STRANGERS, self.most_connections())
        """Most strangers."""
        self.waiting: dict[Stranger, None] = {}
        """Strangers, the oldest first."""
        self.admitted = Counter[Hashable]()
        """Open files of the admitted connections by token, or by kind of connection."""

    def add(self, begin: Callable[[Stranger], asyncio.Task[None]], seconds: float | None) -> None:
        """Begin to serve a new connection, which is dropped after `seconds` unless admitted; None for never.

        Await `make_room` before.
        """
        stranger = Stranger(self)
        self.waiting[stranger] = None
        stranger.task = begin(stranger)
        stranger.task.add_done_callback(stranger.leave)
        stranger.allow(seconds)

    @staticmethod
    def most_connections() -> int:
        """Return the most connections of one kind from the network: a quarter of the open files allowed.

        Otherwise strangers could take all files of this process, and nobody could connect to stop the board.
        """
        return max(_files() // 4, 1)

    @staticmethod
    def most_admitted() -> int:
        """Return the most open files for all admitted connections from the network."""
        return max(_files() * 5 // 8 - _OWN_FILES, 1)

    async def make_room(self) -> None:
        """Drop the oldest strangers, until there is room for a new one and their files are closed."""
        while len(self.waiting) >= self.most:
            oldest = next(iter(self.waiting))
            oldest.drop()
            await asyncio.wait((oldest.task,))
            await asyncio.sleep(0)  # in which asyncio closes the aborted connection


class Stranger:
    """Connection, a stranger until admitted."""

    task: asyncio.Task[None]
    """Task that serves the connection."""

    def __init__(self, group: Strangers) -> None:
        """Belong to `group`, which has a place for the connection."""
        self._group = group
        self._shown: Hashable = None
        self._files = 0
        self._timer: asyncio.TimerHandle | None = None

    def allow(self, seconds: float | None) -> None:
        """Drop a stranger `seconds` from now, in place of an earlier limit; None for never."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if seconds is not None and self in self._group.waiting:
            self._timer = self.task.get_loop().call_later(seconds, self.drop)

    def admit(self, shown: Hashable, most: int | None = None, *, files: int = 1) -> bool:
        """Keep the connection, with `files` open files, however many strangers come.

        Connections that have `shown` the same token, or are of the same kind, may take `most` files together, and all
        connections with such a limit `most_admitted`. Return False without room, or after `drop`; the caller must
        close the connection then. Admitting again has no effect.
        """
        admitted = self._group.admitted
        if self._shown is not None:
            return True
        if self not in self._group.waiting:
            return False
        if most is not None and (
            admitted[shown] + files > most or admitted.total() + files > self._group.most_admitted()
        ):
            return False
        del self._group.waiting[self]
        self.allow(None)
        self._shown, self._files = shown, files
        admitted[shown] += files
        return True

    def drop(self) -> None:
        """End the connection at once, with the unread bytes."""
        self._group.waiting.pop(self, None)
        self.task.cancel()

    def leave(self, _task: object = None) -> None:
        """Give up the place: the connection has ended."""
        self._group.waiting.pop(self, None)
        self.allow(None)
        if self._shown is not None:
            self._group.admitted[self._shown] -= self._files
            self._group.admitted += Counter()
            self._shown = None


_of_loop: WeakKeyDictionary[asyncio.AbstractEventLoop, Strangers] = WeakKeyDictionary()


def strangers_of_network() -> Strangers:
    """Return the strangers of all doors to the network on this event loop."""
    return _of_loop.setdefault(asyncio.get_running_loop(), Strangers())
