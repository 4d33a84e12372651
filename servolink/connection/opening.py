"""Opening: the handshake on a connection with its time limits, and the test whether the board speaks at all."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Awaitable, Callable, Collection
from typing import TYPE_CHECKING, Any, TypeAlias

from servolink.connection.deadlines import BACKOFF, DeadlineTimer, ResponseTimes
from servolink.connection.explain import same
from servolink.connection.fences import FENCES, LISTS, RESERVES, SERVO_LIST, name_of, names, queries_about
from servolink.connection.handshake import LEAST_KINDS, MOST_SILENT, THIRD_LENGTH, Handshake
from servolink.connection.options import TransmissionMode
from servolink.errors import ConnectionLost, DecodeError
from servolink.escaping import escape
from servolink.protocol.codec import Codec
from servolink.protocol.packet import Packet, Query, Response
from servolink.protocol.servos import SetServoParameterResponse
from servolink.protocol.settings import TransmissionModeSettingRequest, TransmissionModeSettingResponse

if TYPE_CHECKING:
    from random import Random

    from servolink.connection.evidence import HandshakeFailed, LineEvidence

Kind: TypeAlias = "Query[Any] | int"
"""A query of the handshake, or the id of any other response."""

_TRIES = 12  # with growing pauses, five fit into the patience
_LONGEST_TRY = 1.5  # seconds, on a slow line
_LEAST_SILENT_TRIES = 6  # in a patience without any response, however long the pauses have grown
_WAKE_AFTER = (2, 4)  # silent tries
_AFTER_MODE = 0.06  # seconds in which a board may drop what comes behind the mode setting
_SILENT_PATIENCES, _MOST_PATIENCES = 2, 4
"""A board that has answered is given up after so many patiences of silence, and after so many in all; one that answers
slowly has the time for a whole word beside that."""
_NOISY_PATIENCES = 1.7  # for one that sends other bytes, such as the text of a boot loader
_FREE_SENDINGS, _LEAST_PAUSE, _MOST_SENDINGS = 24, 0.02, 500
"""So many queries follow each other without a pause, the further ones with at least so many seconds, up to so many."""
_MOST_REPEATED = 64  # responses beyond the queries: no board owes so many to an earlier program
_MOST_EVIDENCE = 8192  # bytes
_COMMAND_RESPONSES = {TransmissionModeSettingResponse.packet_id, SetServoParameterResponse.packet_id}
"""Responses to what may be sent during an opening: they say nothing of earlier programs."""
_logger = logging.getLogger(__name__)


class Opening:
    """One opening of a connection."""

    def __init__(
        self,
        url: str,
        codec: Codec,
        send: Callable[[Packet], Awaitable[None]],
        received: Callable[[], int],
        patience: float,
        times: ResponseTimes,
        *,
        transmission_mode: TransmissionMode,
        random: Random,
        unsupported: Collection[str] = (),
        twice: bool = False,
    ) -> None:
        """Send with `send`, and give up after `patience` seconds of silence.

        `transmission_mode` says when mode 1 is set. `received` returns the bytes received so far. `unsupported` names
        queries that the board is known not to answer, such as `QueryMemorySize`; `twice`: it may answer each twice.
        """
        self._url = url
        self._codec = codec
        self._send = send
        self._patience = patience
        self._times = times
        self._mode = transmission_mode
        self._random = random
        self._twice = twice
        self._unsupported: set[Kind] = {query for query in FENCES if name_of(query) in unsupported}
        self._unasked = [query for query in LISTS if name_of(query) not in unsupported]  # to be asked if kinds lack
        self._named: dict[Query[Any], list[Query[Any]]] = {}  # by list: queries of what it names
        self._kinds: list[Kind] = list(FENCES)
        self._is_quiet = False
        self._handshake = self._begin_handshake()
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._begun = self._since = self._loop.time()  # and since when the board is asked
        self._timer = DeadlineTimer(self._deadline_passed, received)
        self._error: ConnectionLost | None = None
        self._heard_at: float | None = None
        self._bytes_at: float | None = None
        self._silent_tries = 0
        self._now = 0.0  # the latest passed deadline
        self._timed: Kind | None = None  # the kind under way, if sent once
        self._first_sent_at: dict[Kind, float] = {}  # by kind: time of the first sending since the latest response
        self._round_trip = 0.0  # of the latest query, repeats included
        self._sent: Counter[Kind] = Counter()
        self._answered: Counter[Kind] = Counter()
        self._ready_at = 0.0  # when the next query may be sent
        self._sample = bytearray()
        self._seen = 0  # bytes
        self.mode_answered: int | None = None
        """Mode in the latest response to the mode setting; None without one."""
        self._asleep: set[Kind] = set()  # queries without an answer before the mode setting, the first to have one

    # --- what the connection reports -------------------------------------------------------------------------------

    def seen(self, chunk: bytes) -> None:
        """Count bytes received, and keep the first ones, as evidence for an error."""
        self._bytes_at = self._loop.time()
        self._seen += len(chunk)
        self._sample += chunk[: _MOST_EVIDENCE - len(self._sample)]

    def heard(self, packet_id: int, content: bytes) -> None:
        """Take a response into account."""
        is_first, self._heard_at = self._heard_at is None, self._loop.time()
        if packet_id == TransmissionModeSettingResponse.packet_id:
            self.mode_answered = content[0] if content else None
            self._asleep = set(self._sent) if is_first else self._asleep
            self._ready_at = self._heard_at + _AFTER_MODE
        kind = self._kind(packet_id, content)
        if (sent_at := self._first_sent_at.pop(kind, None)) is not None:
            self._round_trip = self._heard_at - sent_at
            if kind == self._timed:
                self._times.record(packet_id - 1, self._round_trip)
        self._silent_tries = 0
        if packet_id not in _COMMAND_RESPONSES:
            self._answered[kind] += 1
            self._handshake.heard(kind)
        self._news.set()

    def heard_event(self) -> None:
        """Take a button event as a sign of life, not as a response."""
        self._heard_at = self._loop.time()

    def begin_again(self) -> None:
        """Draw a new word: another packet was sent beside the handshake."""
        self._is_quiet = False
        self._handshake = self._begin_handshake()
        self._news.set()

    def end(self, error: ConnectionLost) -> None:
        """End the opening: the connection is lost."""
        self._error = error
        self._news.set()

    def _kind(self, packet_id: int, content: bytes) -> Kind:
        """Return the query that a response answers, else its id."""
        queries = [each for each in (*self._kinds, *LISTS) if not isinstance(each, int)]
        queries = [each for each in queries if each.packet_id + 1 == packet_id]
        if not queries or queries[0] in FENCES:
            return queries[0] if queries else packet_id
        try:
            response = self._codec.decode(packet_id, content)
        except DecodeError:
            return packet_id
        assert isinstance(response, Response)  # noqa: S101 - its id is that of a response
        kind = next((each for each in queries if names(response, each)), None)
        if kind in LISTS:
            self._named[kind] = queries_about(response)
        return packet_id if kind is None else kind

    # --- result ----------------------------------------------------------------------------------------------------

    @property
    def fences(self) -> tuple[Query[Any], ...]:
        """Fences for the connection, at least two: all of FENCES, or if the board lacks some, those that it answers."""
        if not self._handshake.unsupported | self._unsupported:
            return FENCES
        fences = tuple(query for query in FENCES if self._answered[query])
        return fences if len(fences) > 1 else (*fences, *RESERVES)

    @property
    def answered(self) -> tuple[Query[Any], ...]:
        """Short queries that the board has answered."""
        return tuple(query for query in (*FENCES, SERVO_LIST) if self._answered[query])

    @property
    def kinds(self) -> frozenset[int]:
        """Packet ids of all queries that this opening may have sent."""
        return frozenset(kind if isinstance(kind, int) else kind.packet_id for kind in (*self._kinds, *self._sent))

    @property
    def unanswered(self) -> frozenset[str]:
        """Names of queries that the board is known or was seen not to answer, such as `QueryMemorySize`."""
        silent = self._handshake.unsupported | self._unsupported
        return frozenset(name_of(query) for query in (*FENCES, *LISTS) if query in silent)

    @property
    def woke(self) -> bool:
        """Whether queries were answered only behind the mode setting: the board seems to have been in mode 0."""
        return any(self._answered[kind] for kind in self._asleep)

    @property
    def is_proved(self) -> bool:
        """Whether the responses of the handshake prove that nothing is owed; otherwise only a silence says so."""
        return not self._is_quiet

    # --- the opening -----------------------------------------------------------------------------------------------

    async def run(self) -> list[Query[Any]]:
        """Open the connection. Return the queries of this handshake with outstanding responses.

        Raise HandshakeFailed if the board is silent or answers too little.
        """
        try:
            if self._mode == 1:
                await self._set_mode()
            while not self._handshake.is_open:
                if self._handshake.is_provable:
                    await self._shake()
                else:
                    await self._find_kinds()
        finally:
            self._timer.stop()
        return [kind for kind in self._handshake.leftover() if not isinstance(kind, int)]

    async def _shake(self) -> None:
        """Send the queries of a handshake until it is open, is replaced, or needs more kinds."""
        handshake, due = self._handshake, self._time()
        while handshake is self._handshake and handshake.is_provable and not handshake.is_open:
            now = self._time()
            self._give_up_if_late(now)
            if now < self._ready_at:
                await self._wait(self._ready_at)
                due = min(due, self._ready_at)
                continue
            kind = handshake.query()
            if kind is not None:
                self._timed = kind
                self._first_sent_at.pop(kind, None)
            elif now >= due and not await self._wake():
                kind, self._timed = handshake.repeat(), None
            if kind is not None:
                due = now + self._try(kind)
                await self._ask(kind, now)
            await self._wait(min(due, self._limit()))

    def _begin_handshake(self) -> Handshake[Kind]:
        return Handshake(
            self._kinds,
            self._random,
            self._unsupported,
            spare=[query for query in self._unasked if query == SERVO_LIST],
            is_quiet=self._is_quiet,
            twice=self._twice,
        )

    async def _wake(self) -> bool:
        """Count a silent try. Return whether mode 1 was set in place of a repeat."""
        self._silent_tries += 1
        if self._mode == "keep" or self._heard_at is not None or self._silent_tries not in _WAKE_AFTER:
            return False
        await self._set_mode()
        return True

    async def _set_mode(self) -> None:
        """Set mode 1, alone: a board that changes its mode may drop what comes meanwhile."""
        await self._send(TransmissionModeSettingRequest(1))
        self._ready_at = self._time() + self._try(TransmissionModeSettingRequest(1))

    async def _ask(self, kind: Kind, now: float) -> None:
        assert not isinstance(kind, int)  # noqa: S101 - only queries are kinds of a handshake
        self._first_sent_at.setdefault(kind, now)
        self._sent[kind] += 1
        if self._sent.total() >= _FREE_SENDINGS:
            self._ready_at = now + _LEAST_PAUSE
        await self._send(kind)

    def _try(self, request: Query[Any] | TransmissionModeSettingRequest | int) -> float:
        """Return the seconds until a query is sent again: longer than a response takes on a slow line."""
        assert not isinstance(request, int)  # noqa: S101 - as in `_ask`
        usual = min(self._times.timeout(request, 0, after_write=False), self._patience / _TRIES)
        pause = usual * BACKOFF ** max(0, self._silent_tries - 1)
        if self._heard_at is None:
            pause = min(pause, max(usual, self._patience / _LEAST_SILENT_TRIES))
        return max(pause, min(1.5 * self._round_trip, _LONGEST_TRY))

    # --- boards that answer few of the short queries ---------------------------------------------------------------

    async def _find_kinds(self) -> None:
        """Find further queries that the board answers; with too few of them, wait until the line was quiet for long."""
        self._unsupported |= self._handshake.unsupported
        while len(kinds := self._answered_kinds()) < LEAST_KINDS and self._unasked:
            await self._ask_list(self._unasked.pop(0))
        if not kinds:
            raise self._failure()
        if len(kinds) < LEAST_KINDS:
            await self._wait_for_quiet()
            self._is_quiet = True
            _logger.warning(
                "%s answers only %s of short queries: a late response to an earlier program cannot be excluded",
                escape(self._url),
                "one kind" if len(kinds) == 1 else f"{len(kinds)} kinds",
            )
        self._kinds = kinds
        self._handshake = self._begin_handshake()

    def _answered_kinds(self) -> list[Kind]:
        """Return all queries so far that the board answers, as far as it is known."""
        found: dict[Kind, None] = dict.fromkeys(kind for kind in self._kinds if kind not in self._unsupported)
        for listed, named in self._named.items():
            found |= dict.fromkeys((listed, *(each for each in named if each not in self._unsupported)))
        return list(found)

    async def _ask_list(self, query: Query[Any]) -> None:
        """Ask for a list, several times if need be; without a response it counts as unsupported."""
        self._silent_tries = self._silent_tries if self._heard_at is None else 0
        for tries in range(MOST_SILENT + 1):
            while self._time() < self._ready_at:
                await self._wait(self._ready_at)
            self._give_up_if_late(self._time())
            if query in self._named:
                return
            if tries and await self._wake():
                continue
            await self._ask(query, self._time())
            due = self._time() + self._try(query)
            while query not in self._named and self._time() < due:
                await self._wait(due)
        self._unsupported.add(query)

    async def _wait_for_quiet(self) -> None:
        """Wait until nothing has come for a whole patience: too few kinds prove nothing."""
        while self._time() < (quiet_at := (self._heard_at or self._begun) + self._patience):
            if self._time() >= self._begun + _MOST_PATIENCES * self._patience:
                raise self._failure()
            await self._wait(quiet_at)
        self._since = self._time()  # the board is not late: it was not asked meanwhile
        self._heard_at = self._heard_at and self._since

    # --- time ------------------------------------------------------------------------------------------------------

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

    def _limit(self) -> float:
        """Return when the board is given up: later if it shows signs of life."""
        since, patience = self._since, self._patience
        if self._heard_at is not None:
            most = _MOST_PATIENCES * patience + THIRD_LENGTH * min(self._round_trip, patience)
            return min(self._heard_at + _SILENT_PATIENCES * patience, since + most)
        if self._bytes_at is not None:
            return min(max(since, self._bytes_at) + patience, since + _NOISY_PATIENCES * patience)
        return since + patience

    def _give_up_if_late(self, now: float) -> None:
        sent, answered = self._sent.total(), self._answered.total()
        if self._heard_at is not None and (sent >= _MOST_SENDINGS or answered - sent >= _MOST_REPEATED):
            raise self._failure()
        if now >= self._limit() or (now >= self._since + self._patience and self._evidence().has_longer_contents):
            raise self._failure()

    def _evidence(self) -> LineEvidence:
        from servolink.connection.evidence import evidence_in  # late, as below: most openings succeed

        return evidence_in(
            bytes(self._sample),
            self._codec.byte_order,
            received=self._seen,
            sent=self._sent.total(),
            answered=self._answered.total(),
        )

    def _failure(self) -> HandshakeFailed:
        """Return the error of a board that is silent or answers too little, with what was received meanwhile."""
        from servolink.connection.evidence import HandshakeFailed

        evidence = self._evidence()
        effort = f"{evidence.sent} queries in {self._time() - self._begun:.1f} s"
        explain = evidence.explain_silence if self._heard_at is None else evidence.explain_too_little
        return HandshakeFailed(f"{escape(self._url)} {explain(effort)}", evidence)
