"""BaseConnection: the parts of a connection, its life from opening to closing, and what it knows of the board."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from random import Random
from threading import get_ident
from typing import Any

from servolink.connection.core import ConnectionCore
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.explain import lost
from servolink.connection.frame_writer import FrameWriter
from servolink.connection.gates import Gates, Preparation, ticket_gate
from servolink.connection.opening import Opener
from servolink.connection.options import ConnectionOptions
from servolink.connection.packet_connection import BoardSharing
from servolink.connection.scheduler import MOST_ASIDE
from servolink.connection.sender import QueryAsker, RequestSender
from servolink.connection.state import ConnectionEvent, State
from servolink.connection.stats import Stats
from servolink.connection.taps import Taps
from servolink.errors import ConnectionLost
from servolink.motion import StopCounter
from servolink.protocol import Query
from servolink.support import SleepCounter, time_with_sleep
from servolink.transports import Transport


class BaseConnection(ConnectionCore):
    """A connection without its requests."""

    def __init__(
        self,
        transport: Transport,
        options: ConnectionOptions | None = None,
        *,
        unsupported: Collection[str] = (),
        learn: bool = True,
        through_hub: bool = False,
        stats: Stats | None = None,
        taps: Taps | None = None,
        random: Random | None = None,
    ) -> None:
        """Speak through `transport` as `options` say.

        `unsupported` names queries that are not used for the handshake, such as `QueryMemorySize`; `random` draws the
        handshake. `learn` is as for `ConnectionCore`. `through_hub` sends each request once, and gives it up a second
        later: a hub repeats by itself.
        """
        options = options or ConnectionOptions()
        pace = getattr(transport, "bytes_per_second", 0.0)
        super().__init__(
            transport.url,
            options,
            bytes_per_second=pace,
            learn=learn,
            through_hub=through_hub,
            stats=stats,
            taps=taps,
        )
        self.transport = transport
        self.stops = StopCounter(SleepCounter())
        """Stops of all servos; no motion requested before a stop is sent after the stop."""
        self.motions = 0
        """Number of motions sent, or about to be sent."""
        self.preparations: tuple[Preparation, ...] = ()
        """Awaited in turn before a packet waits to be sent, except packets that pass no gates."""
        self.hub: BoardSharing | None = None
        """Link to the hub of a shared board; None for a board without a hub."""
        self.on_another: Callable[[str], None] = lambda text: None
        """Called with a description if another board answers in place of a lost one; empty when that board is gone."""
        self._thread = get_ident()
        self._proving = asyncio.Lock()
        self._takes_at_once: bool = getattr(transport, "takes_at_once", False)
        self.answers = ResponseDispatcher(self, ignore_extra=options.ignore_extra)
        self._writer = FrameWriter(transport, self, self.answers)
        self._sender = RequestSender(self, self._writer, self.answers)
        self.opener = Opener(
            self,
            self.answers,
            self._writer,
            self._sender.fences,
            transmission_mode=options.transmission_mode,
            unsupported=unsupported,
            random=random or _chance_for(transport),
        )
        """Openings of the connection, with what they have shown of the board."""
        self.gates = Gates(
            line=self.repeats.refusal,
            ticket=ticket_gate(self.stops, time_with_sleep),
            limits=Gates.of_units(lambda: self.units_sent),
        )
        """Checks of each packet right before sending, stops and queries excepted."""
        self._asker = QueryAsker(self._sender, self._writer, self.answers, self.scheduler)

    @property
    def board_url(self) -> str:
        """Address of the board itself; through a hub, not the address of the transport."""
        return getattr(self.transport, "board_url", self.url)

    @property
    def ended(self) -> ConnectionLost | None:
        """First cause of the end of the connection; None while it is up."""
        return self.lifecycle.ended

    @property
    def outlasts_silence(self) -> bool:
        """Whether the board may come back after a silence: a hub goes on without it."""
        return self.lifecycle.outlasts_silence

    @property
    def is_suspended(self) -> bool:
        """Whether another program has exclusive use of a shared board."""
        return self.lifecycle.state is State.SUSPENDED

    @property
    def unsupported(self) -> frozenset[str]:
        """Names of queries that the board is known not to answer, such as `QueryMemorySize`."""
        return self.opener.unsupported

    @property
    def answered(self) -> tuple[Query[Any], ...]:
        """Short queries that the board has answered in the latest opening."""
        return self.opener.answered

    @property
    def units_sent(self) -> int:
        """Number of angle units sent; an angle has another meaning after a new unit."""
        return self._sender.units_sent

    @property
    def depth(self) -> int:
        """Number of queries allowed under way now, found by trial."""
        return self.scheduler.window.queries.depth

    @property
    def depth_bound(self) -> int:
        """Bound of the depth for queries."""
        return self.scheduler.window.queries.bound

    @property
    def most_under_way(self) -> int:
        """Most requests under way at once: queries within the bound, and those that give way to none."""
        return self.depth_bound + MOST_ASIDE

    @property
    def write_depth_bound(self) -> int:
        """Bound of the depth while a change is under way."""
        return self.scheduler.window.writes.bound

    @property
    def pace(self) -> float:
        """Bytes per second that the line is known to carry, 0 if they are unknown."""
        return self.scheduler.window.least_pace

    @property
    def has_waiting(self) -> bool:
        """Whether somebody waits until less is under way."""
        return bool(self.scheduler.waiting)

    @property
    def callers(self) -> int:
        """Number of callers to keep the line full: one waits, as long as a greater depth may be tried.

        Those are not counted whose query the board may not know, and who let others send.
        """
        return min(self.scheduler.window.queries.depth + 1, self.scheduler.window.queries.bound) + self.scheduler.aside

    def on_more_callers(self, tell: Callable[[], None]) -> None:
        """Call `tell` when a caller steps aside and leaves room for another."""
        self.scheduler.on_aside = tell

    def bulk(self) -> AbstractContextManager[None]:
        """Return a context for large transfers: a stop may then take 0.1 s instead of 0.05 s."""
        return self.scheduler.window.bulk()

    # --- opening and closing ------------------------------------------------------------------------------------

    async def open(self, *, handshake: bool = True) -> None:
        """Open the transport. Raise OpenError with the remedy.

        The handshake follows with `shake_hands`, or before the first request. Without one, responses to what others
        have asked this board before may be taken for responses to this connection.
        """
        await self.transport.open(self.answers)
        self.lifecycle.change(ConnectionEvent.OPENED if handshake else ConnectionEvent.JOINED)
        if handshake:
            self.scheduler.pause()
            self.answers.on_stranger = self.opener.open_again

    async def shake_hands(self) -> None:
        """Prove that no response to another program is outstanding. Raise OpenError with the remedy if none comes."""
        await self.opener.shake_hands()

    async def close(self) -> None:
        """Fail all waiting calls and free the port; may be called again."""
        error = lost(self.url, None)
        if self.loop.is_closed():  # waiting tasks have ended with the loop, and cannot be woken
            self.lifecycle.end(error)
        else:
            self.answers.end(error)
            await self._asker.close()
        try:
            if self.hub is not None:  # first: the hub stops what a program moves that leaves without a word
                await self.hub.close()
        finally:
            await self.transport.close()
            self._writer.end()

    # --- a board that is shared ---------------------------------------------------------------------------------

    def suspend(self, reason: str) -> None:
        """Send nothing but stops until `resume`, and wait for responses as long: another program has exclusive use."""
        self.lifecycle.suspend(reason)
        self.scheduler.pause()

    def resume(self) -> None:
        """Send again, if the connection is suspended."""
        if self.is_suspended:
            self.answers.watchdog.count_from_now()
            self.lifecycle.change(ConnectionEvent.RESUMED)
            self.scheduler.resume()

    def explain_silence(self, reason: str) -> None:
        """Name `reason` in the errors of unanswered requests from now on; empty for an unknown reason."""
        self.lifecycle.silent_because = reason


def _chance_for(transport: Transport) -> Random:
    """Return the source of chance for a connection: a recorded session can be replayed only with the same handshake."""
    seed = b"" if getattr(transport, "is_recorded", False) else os.urandom(16)
    return Random(seed)  # noqa: S311 - unlike in any other program, not unguessable
