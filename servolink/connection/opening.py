"""Opening: the handshake on a connection with its time limits, and the test whether the board speaks at all."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Collection
from random import Random
from typing import Any

from servolink.connection.deadlines import BACKOFF, FIRST_TRY, DeadlineTimer, ResponseTimes
from servolink.connection.explain import same
from servolink.connection.handshake import MOST_SILENT, Handshake
from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.protocol.editing import QueryProjectIDRequest
from servolink.protocol.frame import ByteOrder
from servolink.protocol.joystick import QueryActiveJoystickTableRequest
from servolink.protocol.packet import Packet, Query
from servolink.protocol.servos import SetServoParameterResponse
from servolink.protocol.settings import (
    QueryMemorySizeRequest,
    QueryRemainPowerRequest,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
)

FENCES: tuple[Query[Any], ...] = (
    QueryProjectIDRequest(),
    QueryMemorySizeRequest(),
    QueryRemainPowerRequest(),
    QueryActiveJoystickTableRequest(),
)
"""Queries with short responses, which settle what was sent before them."""

_BY_ID: dict[int, Query[Any]] = {query.packet_id: query for query in FENCES}
_TRIES = 12  # with growing pauses, five fit into the patience
_LONGEST_TRY = 1.0  # seconds, on a slow line
_WAKE_AFTER = 2  # silent tries
_SILENT_PATIENCES, _MOST_PATIENCES = 2, 4
"""A board that has answered is given up after so many patiences of silence, and after so many in all."""
_COMMAND_RESPONSES = {TransmissionModeSettingResponse.packet_id, SetServoParameterResponse.packet_id}
"""Responses to what may be sent during an opening: they say nothing of earlier programs."""
_logger = logging.getLogger(__name__)


class Opening:
    """One opening of a connection."""

    def __init__(
        self,
        url: str,
        send: Callable[[Packet], Awaitable[None]],
        received: Callable[[], int],
        patience: float,
        times: ResponseTimes,
        *,
        wake: bool,
        random: Random,
        byte_order: ByteOrder = "little",
        unsupported: Collection[str] = (),
    ) -> None:
        """Send with `send`, and give up after `patience` seconds of silence.

        `wake` sets transmission mode 1 if the board is silent at first. `received` returns the bytes received so far.
        `byte_order` is the one in use.
        `unsupported` names queries that it is known not to answer, such as `QueryMemorySize`.
        """
        self._url = url
        self._send = send
        self._received = received
        self._received_before = received()
        self._patience = patience
        self._times = times
        self._wake = wake
        self._random = random
        self._other_order = "little" if byte_order == "big" else "big"
        self._unsupported = [
            query.packet_id for query in FENCES if type(query).__name__.removesuffix("Request") in unsupported
        ]
        self._handshake = Handshake(list(_BY_ID), random, self._unsupported)
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._timer = DeadlineTimer(self._deadline_passed, received)
        self._error: ConnectionLost | None = None
        self._heard_at: float | None = None
        self._silent_tries = 0
        self._now = 0.0  # the latest passed deadline
        self._timed: int | None = None  # the kind under way, if sent once
        self._first_sent_at: dict[int, float] = {}  # by kind: time of the first sending since the latest response
        self._round_trip = 0.0  # of the latest query, repeats included

    def heard(self, packet_id: int) -> None:
        """Take a response with this id into account, whatever the content."""
        self._heard_at = self._loop.time()
        kind = packet_id - 1
        if (sent_at := self._first_sent_at.pop(kind, None)) is not None:
            self._round_trip = self._heard_at - sent_at
            if kind == self._timed:
                self._times.record(kind, self._round_trip)
        self._silent_tries = 0
        if packet_id not in _COMMAND_RESPONSES:
            self._handshake.heard(kind)
        self._news.set()

    def heard_event(self) -> None:
        """Take a button event as a sign of life, not as a response."""
        self._heard_at = self._loop.time()

    def begin_again(self) -> None:
        """Draw a new word: another packet was sent beside the handshake."""
        self._handshake = Handshake(list(_BY_ID), self._random, self._unsupported)
        self._news.set()

    def end(self, error: ConnectionLost) -> None:
        """End the opening: the connection is lost."""
        self._error = error
        self._news.set()

    @property
    def fences(self) -> tuple[Query[Any], ...]:
        """Fences known to be answered by the board, or not yet tried."""
        return tuple(query for query in FENCES if query.packet_id not in self._handshake.unsupported)

    async def run(self) -> list[Query[Any]]:
        """Open the connection. Return the queries of this handshake with outstanding responses.

        Raise OpenError if the board is silent or answers too little.
        """
        begun = self._loop.time()
        due = begun
        try:
            while not self._handshake.is_open:
                now = self._time()
                self._give_up_if_late(now, begun)
                kind = self._handshake.query()
                if kind is not None:
                    self._timed = kind
                    self._first_sent_at.pop(kind, None)
                elif now >= due:
                    kind, self._timed = await self._repeat(), None
                if kind is not None and not self._handshake.is_provable:
                    return await self._open_unproved(_BY_ID[kind])
                if kind is not None:
                    self._first_sent_at.setdefault(kind, now)
                    due = now + self._try(kind)
                    await self._send(_BY_ID[kind])
                await self._wait(min(due, self._limit(begun)))
        finally:
            self._timer.stop()
        return [_BY_ID[kind] for kind in self._handshake.leftover()]

    def _try(self, kind: int) -> float:
        """Return the seconds until a query is sent again: longer than a response takes on a slow line."""
        usual = min(self._times.timeout(_BY_ID[kind], 0, after_write=False), self._patience / _TRIES)
        return max(usual * BACKOFF ** max(0, self._silent_tries - 1), min(1.5 * self._round_trip, _LONGEST_TRY))

    async def _repeat(self) -> int:
        self._silent_tries += 1
        if self._wake and self._heard_at is None and self._silent_tries == _WAKE_AFTER:
            await self._send(TransmissionModeSettingRequest(1))
        return self._handshake.repeat()

    def _deadline_passed(self, now: float) -> None:
        self._now = now
        self._news.set()

    def _time(self) -> float:
        return max(self._now, self._loop.time())  # a timer fires early by the resolution of the clock

    async def _wait(self, until: float) -> None:
        """Wait for a response, at most until `until` (loop time)."""
        self._timer.arm(until)
        await self._news.wait()
        self._news.clear()
        if self._error is not None:
            raise same(self._error)

    def _limit(self, begun: float) -> float:
        """Return when the board is given up: later if it shows signs of life."""
        if self._heard_at is None:
            return begun + self._patience
        return min(self._heard_at + _SILENT_PATIENCES * self._patience, begun + _MOST_PATIENCES * self._patience)

    def _give_up_if_late(self, now: float, begun: float) -> None:
        if now < self._limit(begun):
            return
        effort = f"{self._handshake.sendings} queries in {now - begun:.1f} s"
        where = escape(self._url)
        if self._heard_at is not None:
            raise self._too_little(effort)
        if self._received() > self._received_before:
            raise OpenError(
                f"{where} sends bytes, but no frame of this protocol ({effort}): try the other byte order "
                f"(byte_order={self._other_order}) or another baud rate; it may also be another device; `servolink "
                "doctor` finds out"
            )
        raise OpenError(
            f"{where} is open, but no board answers ({effort}): is it switched on, is this its port, is it a data "
            f"cable? Else try another baud rate or the other byte order (byte_order={self._other_order}); `servolink "
            "doctor` finds out"
        )

    def _too_little(self, effort: str) -> OpenError:
        return OpenError(
            f"{escape(self._url)} answers, but too little to be sure whose responses they are ({effort}): the line is "
            "bad, or the board is busy; try again, or run `servolink doctor`"
        )

    async def _open_unproved(self, query: Query[Any]) -> list[Query[Any]]:
        """Wait for a whole patience of silence, as one kind of query proves nothing. Then send the query once more."""
        while self._time() < (quiet_at := (self._heard_at or 0.0) + self._patience):
            await self._wait(quiet_at)
        for tries in range(MOST_SILENT):
            self._silent_tries = 1
            await self._send(query)
            await self._wait(self._loop.time() + FIRST_TRY * BACKOFF**tries)
            if not self._silent_tries:
                _logger.warning(
                    "%s answers only one kind of short query: a late response to an earlier program cannot be excluded",
                    escape(self._url),
                )
                return [query] * tries
        raise self._too_little(f"{MOST_SILENT} times the only query that was answered before")
