"""FrameWriter: frames on their way to the transport, counted, joined where possible, and held to their end."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from contextlib import suppress
from logging import DEBUG

from servolink.connection.core import ConnectionCore
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.scheduler import RequestScheduler
from servolink.connection.taps import is_logged
from servolink.errors import ConnectionLost, escape
from servolink.transports import Transport


class FrameWriter:
    """Writing end of a connection. A failure ends the connection."""

    def __init__(self, transport: Transport, core: ConnectionCore, answers: ResponseDispatcher) -> None:
        """Write to `transport`, and report its end to `answers`."""
        self._transport = transport
        # Without a coroutine, where the transport can (see `BaseTransport.take`).
        takes_at_once = getattr(transport, "takes_at_once", False)
        self._take: Callable[[bytes], Awaitable[None] | None] = (
            transport.take if takes_at_once else transport.send  # type: ignore[attr-defined]
        )
        self._joined: list[bytes] | None = None  # frames of this turn of the loop, while they are joined
        if takes_at_once and getattr(transport, "is_stream", False):
            answers.on_several = self._join
        self._core = core
        self._answers = answers
        self._drain = PendingDrain(transport, core.scheduler)

    def end(self) -> None:
        """Hold no permits any more: the connection is closed."""
        self._drain.end()

    def raise_if_ended(self) -> None:
        """Raise the error of an ended connection."""
        if self._core.lifecycle.ended is not None:
            raise self._core.lifecycle.ended.copy()

    async def write(self, frame: bytes) -> None:
        """Send a whole frame. On failure, end the connection and raise ConnectionLost."""
        if (sending := self.take(frame)) is not None:
            await self.accepted(sending)

    def take(self, frame: bytes, *, may_join: bool = False) -> Awaitable[None] | None:
        """Count a whole frame and pass it to the transport. Return None if the system has accepted it at once.

        Otherwise return an awaitable, to be awaited now. With `may_join`, the frame may leave together with those of
        other callers, at the end of this turn of the loop. Raise ConnectionLost if the connection has ended.
        """
        if self._core.lifecycle.ended is not None:
            raise self._core.lifecycle.ended.copy()
        stats = self._core.stats
        stats.frames_sent += 1
        stats.bytes_sent += len(frame)
        if self._core.taps.members:
            self._core.taps.sent(frame)
        if is_logged(DEBUG):
            self._answers.frame_log.sent(frame)
        if self._joined is None:
            data = frame
        else:
            self._joined.append(frame)
            if may_join:
                return None
            data = self._end_joining()
        try:
            return self._take(data)
        except ConnectionLost as error:
            self._answers.lost(error)
            raise

    def take_aside(self, frame: bytes) -> None:
        """Pass a whole frame to the transport as `take` does; a permit is held until the system has accepted it."""
        if (sending := self.take(frame)) is not None:
            self._drain.hold(sending)

    def _join(self) -> None:
        """Join the frames of the callers that were just woken. They run in the next turn, before `_send_joined`."""
        if self._joined is None:
            self._joined = []
            self._core.loop.call_soon(self._send_joined)

    def _send_joined(self) -> None:
        if data := self._end_joining():
            try:
                sending = self._take(data)
            except ConnectionLost as error:
                self._answers.lost(error)
            else:
                if sending is not None:
                    self._drain.hold(sending)

    def _end_joining(self) -> bytes:
        """Return the joined frames."""
        joined, self._joined = self._joined, None
        return b"".join(joined or ())

    async def accepted(self, sending: Awaitable[None]) -> None:
        """Wait until the system has accepted a frame. Raise ConnectionLost."""
        try:
            await sending
        except ConnectionLost as error:
            self._answers.lost(error)
            raise
        except asyncio.CancelledError:
            self._drain.hold()  # a permit, for the rest of the frame
            raise


class PendingDrain:
    """Holds a permit for each frame of a cancelled sender.

    A cancelled send still goes out whole. If its permit were free at once, a program that gives up late requests would
    fill the transport's buffer, and a stop would wait behind all of that.
    """

    def __init__(self, transport: Transport, scheduler: RequestScheduler) -> None:
        """Hold permits of `scheduler` until `transport` has sent the remaining bytes."""
        self._transport = transport
        self._scheduler = scheduler
        self._drains: set[asyncio.Future[tuple[None]]] = set()  # held here, as the loop does not hold them

    def hold(self, sending: Awaitable[None] | None = None) -> None:
        """Hold a permit beyond the depth until `sending` is done, or until all bytes so far have left."""
        self._scheduler.take_extra()
        waiting = self._wait_for_drain(self._transport.send(b"") if sending is None else sending)
        drained = asyncio.gather(waiting)  # a task would warn if the program ends first
        self._drains.add(drained)
        drained.add_done_callback(self._give_back)

    def end(self) -> None:
        """Hold no permit any more: the connection is closed."""
        for drained in self._drains:
            drained.cancel()

    async def _wait_for_drain(self, sending: Awaitable[None]) -> None:
        with suppress(ConnectionLost):  # the transport reports its end to the receiver
            await sending

    def _give_back(self, drained: asyncio.Future[tuple[None]]) -> None:
        self._drains.discard(drained)
        self._scheduler.give_back_extra()
        if not drained.cancelled() and (error := drained.exception()) is not None:
            logging.getLogger(__name__).error(
                "%s cannot tell when all is sent: %s", escape(self._transport.url), escape(str(error))
            )
