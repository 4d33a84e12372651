"""Board: the 32 commands of the protocol as a person would say them."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress

from servolink.client.angles import AngleUnit
from servolink.client.editing import Editing
from servolink.client.explain import lost, same
from servolink.client.link import Link
from servolink.client.motion import MotionLimits
from servolink.client.projects import Projects
from servolink.client.reconnect import ConnectionState, Reconnector, States
from servolink.client.servos import Servos
from servolink.client.stats import Stats
from servolink.errors import ConnectionLost, ServolinkError


class Board(Servos, Projects):
    """A connected board; one file per chapter of the document holds its commands."""

    def __init__(
        self,
        link: Link,
        angle_unit: AngleUnit | None,
        limits: MotionLimits,
        reopen: Callable[[], Awaitable[Link]] | None = None,
    ) -> None:
        """Use `connect`; with `reopen`, which opens a new link to the same board, a lost link is replaced."""
        super().__init__(link, angle_unit, limits)
        self._states = States()
        self._reconnector: Reconnector | None = None
        if reopen is not None:
            self._reconnector = Reconnector(lambda: self._open_again(reopen), self._resume)
        link.answers.on_end = self._link_ended

    @property
    def stats(self) -> Stats:
        """What the link has seen: frames, bytes, noise, late answers, round trips."""
        return self._link.stats

    def states(self) -> AsyncIterator[ConnectionState]:
        """Yield `connected`, `lost` or `closed`: the state as it is, and then each change up to `closed`."""
        return self._states.read()

    async def clear_all_data(self) -> None:
        """Delete everything stored on the board (3.1.2); nothing else is sent before it is answered."""
        await super().clear_all_data()
        if self._reconnector is not None:
            with suppress(ServolinkError):  # it is deleted; only less would be known of which board this is
                await Editing.project_id(self)  # that of Projects would warn of an import that is under way

    async def close(self) -> None:
        """End the button events and free the port; may be called again."""
        try:
            if self._reconnector is not None:
                await self._reconnector.stop()
            await self._events.close()
        finally:
            self._link.answers.on_end = self._events.end
            try:
                await self._link.close()
            finally:
                self._events.end(lost(self.url, None))
                self._states.become("closed")

    def _link_ended(self, error: ConnectionLost) -> None:
        self._states.become("lost")
        if self._reconnector is None or not self._reconnector.start():
            self._events.end(error)

    async def _open_again(self, reopen: Callable[[], Awaitable[Link]]) -> Link:
        await self._link.close()  # it may have ended by silence and still hold the port
        return await reopen()

    async def _resume(self, link: Link) -> None:
        """Restore the session on a new link and use it from then on; raises what keeps it from being restored."""
        link.answers.on_end = self._link_ended
        await self._speak_this_protocol(link)
        await self._identity.check(link)  # any answer also proves that nothing is owed
        await self._restore_units(link)
        self._link = link
        await self._events.move(link)
        await self._restore_mode(link)  # last, as the old one is the end of all answers
        if link.answers.ended is not None:
            raise same(link.answers.ended)
        self.stats.reconnects += 1
        self._states.become("connected")
