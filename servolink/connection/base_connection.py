"""BaseConnection: the parts of a connection, its life from opening to closing, and what it knows of the board."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from threading import get_ident
from typing import TYPE_CHECKING, Any

from servolink.connection.asking import QueryAsker
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.explain import lost
from servolink.connection.frame_writer import FrameWriter
from servolink.connection.gates import Gates, Preparation, limits_gate, ticket_gate
from servolink.connection.opener import Opener
from servolink.connection.options import HUB_MARGIN, PATIENCE, TransmissionMode
from servolink.connection.scheduler import RequestScheduler, Window
from servolink.connection.sender import RequestSender
from servolink.connection.slots import Slots
from servolink.connection.state import ConnectionEvent, Lifecycle, State
from servolink.connection.stats import Stats
from servolink.connection.taps import Taps
from servolink.errors import ConnectionLost
from servolink.motion.ticket import StopCounter
from servolink.platforms.time_asleep import SleepCounter, time_with_sleep
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Query

if TYPE_CHECKING:
    from random import Random

    from servolink.connection.sharing import BoardSharing
    from servolink.transports.base import Transport


class BaseConnection:
    """A connection without its requests."""

    def __init__(
        self,
        transport: Transport,
        codec: Codec,
        *,
        patience: float = PATIENCE,
        depth: int = 1,
        write_depth: int = 1,
        learn: bool = True,
        transmission_mode: TransmissionMode = "auto",
        unsupported: Collection[str] = (),
        answers_twice: bool = False,
        ignore_extra: bool = False,
        repeats: bool = True,
        stats: Stats | None = None,
        taps: Taps | None = None,
        random: Random | None = None,
    ) -> None:
        """Give a request up after `patience` seconds. Have at most `depth` under way, or `write_depth`.

        `transmission_mode` says when the handshake sets mode 1, and `unsupported` names queries that are not used for
        it, such as `QueryMemorySize`. `random` draws the handshake.
        With `answers_twice` each sending may be answered twice, and one request is under way. `ignore_extra` ignores
        what responses have behind the content of the document.
        `write_depth` holds while one of them is a change. How many pay is learnt, unless `learn` is False: then as many
        as allowed are sent from the beginning. Without `repeats` each request is sent once, and given up a second
        later: a hub repeats by itself.
        """
        self.transport = transport
        self.codec = codec
        self.patience = patience
        self.stats = stats or Stats()
        """Counters of all frames and bytes seen."""
        self.taps = taps or Taps()
        """Listeners to bytes and requests."""
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
        self._loop = asyncio.get_running_loop()
        self._thread = get_ident()
        self._slots = _repeating_slots() if answers_twice else Slots()
        if answers_twice:
            depth = write_depth = 1
        pace = getattr(transport, "bytes_per_second", 0.0)
        self._window = Window(depth, write_depth, learn=learn, bytes_per_second=pace)
        self._scheduler = RequestScheduler(self._window, self._slots)
        self.lifecycle = Lifecycle(outlasts_silence=not repeats)
        """State in the life of the connection."""
        self._takes_at_once: bool = getattr(transport, "takes_at_once", False)
        self.answers = ResponseDispatcher(
            transport.url,
            codec,
            self.lifecycle,
            self._slots,
            self._scheduler,
            patience,
            self._loop.time,
            self.stats,
            self.taps,
            ignore_extra=ignore_extra,
        )
        self._writer = FrameWriter(transport, self.lifecycle, self._scheduler, self.answers)
        self._sender = RequestSender(
            self._writer, codec, self.lifecycle, self._slots, self._scheduler, self.answers, repeats=repeats
        )
        self.opener = Opener(
            transport,
            codec,
            self.lifecycle,
            self._slots,
            self._scheduler,
            self.answers,
            self._writer,
            self._sender.fences,
            patience=patience,
            transmission_mode=transmission_mode,
            unsupported=unsupported,
            random=random,
        )
        """Openings of the connection, with what they have shown of the board."""
        self.gates = Gates(ticket=ticket_gate(self.stops, time_with_sleep), limits=limits_gate(lambda: self.units_sent))
        """Checks of each packet right before sending, stops and queries excepted."""
        self._margin = 0.0 if repeats else HUB_MARGIN
        self._asker = QueryAsker(self._sender, self._writer, self.answers, self._scheduler)

    @property
    def url(self) -> str:
        """The address."""
        return self.transport.url

    @property
    def board_url(self) -> str:
        """Address of the board itself; through a hub, not the address of the transport."""
        return getattr(self.transport, "board_url", self.transport.url)

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
        return self._window.queries.depth

    @property
    def depth_bound(self) -> int:
        """Bound of the depth for queries."""
        return self._window.queries.bound

    @property
    def write_depth_bound(self) -> int:
        """Bound of the depth while a change is under way."""
        return self._window.writes.bound

    @property
    def pace(self) -> float:
        """Bytes per second that the line is known to carry, 0 if they are unknown."""
        return self._window.least_pace

    @property
    def has_waiting(self) -> bool:
        """Whether somebody waits until less is under way."""
        return bool(self._scheduler.waiting)

    @property
    def callers(self) -> int:
        """Number of callers to keep the line full: one waits, as long as a greater depth may be tried.

        Those are not counted whose query the board may not know, and who let others send.
        """
        return min(self._window.queries.depth + 1, self._window.queries.bound) + self._scheduler.aside

    def on_more_callers(self, tell: Callable[[], None]) -> None:
        """Call `tell` when a caller steps aside and leaves room for another."""
        self._scheduler.on_aside = tell

    def bulk(self) -> AbstractContextManager[None]:
        """Return a context for large transfers: a stop may then take 0.1 s instead of 0.05 s."""
        return self._window.bulk()

    # --- opening and closing ------------------------------------------------------------------------------------

    async def open(self, *, handshake: bool = True) -> None:
        """Open the transport. Raise OpenError with the remedy.

        The handshake follows with `shake_hands`, or before the first request. Without one, responses to what others
        have asked this board before may be taken for responses to this connection.
        """
        await self.transport.open(self.answers)
        self.lifecycle.change(ConnectionEvent.OPENED if handshake else ConnectionEvent.JOINED)
        if handshake:
            self._scheduler.pause()
            self.answers.on_stranger = self.opener.open_again

    async def shake_hands(self) -> None:
        """Prove that no response to another program is outstanding. Raise OpenError with the remedy if none comes."""
        await self.opener.shake_hands()

    async def close(self) -> None:
        """Fail all waiting calls and free the port; may be called again."""
        error = lost(self.transport.url, None)
        if self._loop.is_closed():  # waiting tasks have ended with the loop, and cannot be woken
            self.lifecycle.end(error)
        else:
            self.answers.end(error)
            await self._asker.close()
        await self.transport.close()
        self._writer.end()
        if self.hub is not None:
            await self.hub.close()

    # --- a board that is shared ---------------------------------------------------------------------------------

    def suspend(self, reason: str) -> None:
        """Send nothing but stops until `resume`, and wait for responses as long: another program has exclusive use."""
        self.lifecycle.suspend(reason)
        self._scheduler.pause()

    def resume(self) -> None:
        """Send again, if the connection is suspended."""
        if self.is_suspended:
            self.answers.watchdog.count_from_now()
            self.lifecycle.change(ConnectionEvent.RESUMED)
            self._scheduler.resume()

    def explain_silence(self, reason: str) -> None:
        """Name `reason` in the errors of unanswered requests from now on; empty for an unknown reason."""
        self.lifecycle.silent_because = reason


def _repeating_slots() -> Slots:
    from servolink.connection.repeating_slots import RepeatingSlots  # late: few boards answer twice

    return RepeatingSlots()
