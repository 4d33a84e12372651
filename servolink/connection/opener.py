"""Opener: the openings of one connection, the first one and those after a stray response, with their findings."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from servolink.connection.call import Slot
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.explain import lost
from servolink.connection.fences import FenceChoice
from servolink.connection.frame_writer import FrameWriter
from servolink.connection.opening import Opening
from servolink.connection.options import TransmissionMode
from servolink.connection.scheduler import RequestScheduler
from servolink.connection.slots import Slots
from servolink.connection.state import ConnectionEvent, Lifecycle, State
from servolink.errors import ServolinkError
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Query

if TYPE_CHECKING:
    from random import Random

    from servolink.transports.base import Transport

_REOPEN_PAUSE = 10.0  # seconds at least between two openings for stray responses


class Opener:
    """Begins each opening of a connection, and passes the findings on."""

    def __init__(
        self,
        transport: Transport,
        codec: Codec,
        lifecycle: Lifecycle,
        slots: Slots,
        scheduler: RequestScheduler,
        answers: ResponseDispatcher,
        writer: FrameWriter,
        fences: FenceChoice,
        *,
        patience: float,
        transmission_mode: TransmissionMode = "auto",
        unsupported: Collection[str] = (),
        random: Random | None = None,
    ) -> None:
        """Open through `writer`, and give up after `patience` seconds of silence.

        `transmission_mode`, `unsupported` and `random` are as for `Connection`.
        """
        self.unsupported = frozenset(unsupported)
        """Names of queries that the board is known not to answer, such as `QueryMemorySize`; openings add to them."""
        self.answered: tuple[Query[Any], ...] = ()
        """Short queries that the board has answered in the latest opening."""
        self.woke = False
        """Whether an opening set mode 1 because the board was silent, and the board answered after that only."""
        self.mode_answered: int | None = None
        """Mode that the board has answered to the mode setting of the latest opening; None without an answer."""
        self.is_proved = True
        """Whether responses of the board prove that nothing is owed; otherwise only a silence before the opening."""
        self._transport = transport
        self._codec = codec
        self._lifecycle = lifecycle
        self._slots = slots
        self._scheduler = scheduler
        self._answers = answers
        self._writer = writer
        self._fences = fences
        self._patience = patience
        self._mode: TransmissionMode = transmission_mode
        self._random = random
        self._loop = asyncio.get_running_loop()
        self._kinds: frozenset[int] = frozenset()  # packet ids of the queries of the latest opening
        self._reopened_at = -_REOPEN_PAUSE

    def begin(self) -> None:
        """Begin the first opening, unless it has begun. Raise the error of an ended connection."""
        self._writer.raise_if_ended()
        if self._lifecycle.state is State.UNPROVED:
            self._begin(ConnectionEvent.HANDSHAKE_BEGUN)

    async def shake_hands(self) -> None:
        """Wait for the end of the first opening, which begins now unless it has begun. Raise OpenError."""
        self.begin()
        if self._lifecycle.state is State.OPENING and self._lifecycle.handshake is not None:
            await asyncio.shield(self._lifecycle.handshake)

    def open_again(self, packet_id: int) -> None:
        """Begin another opening after a stray response to a fence: the handshake has taken a wrong response."""
        now = self._loop.time()
        if packet_id - 1 not in self._kinds or self._lifecycle.state is not State.READY:
            return
        if now - self._reopened_at >= _REOPEN_PAUSE:
            self._reopened_at = now
            self._answers.stats.reopenings += 1
            self._begin(ConnectionEvent.STRAY_RESPONSE)

    def _begin(self, event: ConnectionEvent) -> None:
        opening = self._opening()
        self._lifecycle.begin_opening(event, opening)
        self._scheduler.pause()
        self._answers.close_all()
        self._lifecycle.handshake = self._loop.create_task(self._run(opening))
        self._lifecycle.handshake.add_done_callback(_see_exception)

    def _opening(self) -> Opening:
        """Return an opening that has seen what the board has sent so far."""
        # A recorded session can be replayed only with the same handshake.
        seed = b"" if getattr(self._transport, "is_recorded", False) else os.urandom(16)
        self._random = self._random or random_of(seed)
        opening = Opening(
            self._transport.url,
            self._codec,
            lambda packet: self._writer.write(self._codec.encode(packet)),
            lambda: self._answers.stats.bytes_received,
            self._patience,
            self._answers.times,
            transmission_mode=self._mode,
            random=self._random,
            unsupported=self.unsupported,
            twice=self._slots.answer_twice,
        )
        if early := bytes(self._answers.early):
            opening.seen(early)
        return opening

    async def _run(self, opening: Opening) -> None:
        try:
            leftover = await opening.run()
        except ServolinkError as error:
            self._answers.end(lost(self._transport.url, error))
            raise
        except BaseException:
            self._lifecycle.change(ConnectionEvent.HANDSHAKE_CANCELLED)
            raise
        self._answers.close_all()
        self._learn(opening)
        self._expect(leftover)
        self._lifecycle.change(ConnectionEvent.HANDSHAKE_DONE)
        self._scheduler.resume()

    def _learn(self, opening: Opening) -> None:
        self._fences.use(opening.fences)
        self._kinds = opening.kinds
        self.unsupported |= opening.unanswered
        self.answered = opening.answered
        self.woke |= opening.woke
        self.mode_answered = opening.mode_answered
        self.is_proved = opening.is_proved

    def _expect(self, leftover: list[Query[Any]]) -> None:
        """Open a slot for each query of the handshake whose response is still to come."""
        # Their order stands in for their times, by which the fences are chosen that settle the most.
        for age, query in zip(range(len(leftover), 0, -1), leftover, strict=True):
            lane = self._slots.lanes[query.packet_id + 1]
            self._slots.open(Slot(query, lane, None, float(-age), is_fence=True, overdue=True))


def random_of(seed: bytes) -> Random:
    """Return the source of chance for the handshakes of a connection."""
    from random import Random  # late: a program on a hub opens nothing

    return Random(seed)  # noqa: S311 - unlike in any other program, not unguessable


def _see_exception(handshake: asyncio.Task[None]) -> None:
    """Mark the error of a handshake as seen: all waiting callers get the same error from the end of the connection."""
    if not handshake.cancelled():
        handshake.exception()
