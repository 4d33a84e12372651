"""Opening: from an open transport to a connection whose responses are all its own.

A program that was killed leaves questions with the board, and their responses would fit the questions of the next one.
So a connection begins with a *handshake*: a random word of short queries, one at a time, after which nothing is owed to
others (`handshake.py` has the word, with the proof). An opening is all that is needed for that. Its phases:

    PAUSE -> HANDSHAKE -> OPEN, or HANDSHAKE -> SEARCH (-> QUIET) -> HANDSHAKE, or HANDSHAKE -> COMPARISON -> HANDSHAKE

* PAUSE: a later opening, after a stray response, waits until the copies of earlier responses have come.
* HANDSHAKE: the queries of the word are sent. One that is not answered in time is sent again, or another in its place.
  A board that answers nothing is perhaps in mode 0, so mode 1 is set after a few silent tries.
* SEARCH: the board answers fewer than three kinds of short queries. Lists of servos and records are asked for, and what
  they name, until there are three kinds.
* QUIET: there are none left. With one or two kinds a word says little, so a silence of the whole patience comes first.
* COMPARISON: more came than was asked for. Two boards may answer on this line (`repeats.py`).
* OPEN: the word is complete.

A stop goes at any time, and the word is drawn anew. When the board is silent for too long, answers too little or too
often, the opening fails with the evidence (`deadlines.py` has the limits). docs/design/opening.md has the figures.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable, Collection
from enum import Enum
from random import Random
from typing import Any

from servolink.connection.call import Slot
from servolink.connection.core import ConnectionCore
from servolink.connection.deadlines import NewsTimer, QueryPace, SignsOfLife
from servolink.connection.dispatcher import ResponseDispatcher
from servolink.connection.evidence import HandshakeFailed, LineEvidence, ReceivedBytes
from servolink.connection.explain import lost
from servolink.connection.fences import FENCES, SERVO_LIST, FenceChoice, Kind, ShortQueries
from servolink.connection.frame_writer import FrameWriter
from servolink.connection.handshake import LEAST_KINDS, MOST_SILENT, Handshake
from servolink.connection.options import TransmissionMode
from servolink.connection.repeats import compare_boards
from servolink.connection.state import ConnectionEvent, State
from servolink.connection.times import AFTER_MODE, LONGEST_COMPARISON, LONGEST_DELAY, QUICK, QUICK_FROM, REOPENING_PAUSE
from servolink.errors import ConnectionLost, OpenError, Reason, ServolinkError, escape
from servolink.protocol import (
    ALL_SERVOS,
    Packet,
    Query,
    QueryServoRequest,
    SetServoParameterResponse,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
)
from servolink.support import Tasks

_WAKE_AFTER = (2, 4)  # silent tries
_PAIR_AFTER = 5  # silent tries
_MOST_SENDINGS = 500  # queries of one opening
_MOST_REPEATED = 64  # responses beyond the queries: no board owes so many to an earlier program
_LEAST_REPEATED = 16  # responses beyond the queries in a later opening, where requests are proved instead
_MODE_1 = TransmissionModeSettingRequest(1)
_COMMAND_RESPONSES = {TransmissionModeSettingResponse.packet_id, SetServoParameterResponse.packet_id}
"""Responses to what may be sent during an opening: they say nothing of earlier programs."""
_logger = logging.getLogger(__name__)


class Phase(Enum):
    """Phase of an opening, from the first query to the end."""

    PAUSE = "waits until copies of earlier responses have come"
    HANDSHAKE = "sends the queries of the word"
    SEARCH = "looks for further queries that the board answers"
    QUIET = "waits until the line was quiet for the whole patience"
    COMPARISON = "compares the answers to queries that are asked alone"
    OPEN = "is done"


class Opening:
    """One opening of a connection."""

    def __init__(
        self,
        core: ConnectionCore,
        send: Callable[[Packet], Awaitable[None]],
        *,
        transmission_mode: TransmissionMode,
        random: Random,
        unsupported: Collection[str] = (),
        is_first: bool = True,
    ) -> None:
        """Send with `send`, and give up after the patience of `core` in silence.

        `transmission_mode` says when mode 1 is set. `unsupported` names queries that the board is known not to answer,
        such as `QueryMemorySize`. Unless it `is_first`, a stray response came.
        """
        self.phase = Phase.HANDSHAKE if is_first else Phase.PAUSE
        self.task: asyncio.Task[None] | None = None
        """Task that runs the opening; None before it."""
        self.mode_answered: int | None = None
        """Mode in the latest response to the mode setting; None without one."""
        self.queries = ShortQueries(unsupported)
        """Short queries, with what the opening has found out about them."""
        self.pace = QueryPace(core.times, core.patience)
        """Times of the queries and of their responses."""
        self._core = core
        self._send = send
        self._mode = transmission_mode
        self._random = random
        self._is_first = is_first
        self._handshake = self._new_handshake()
        self._life = SignsOfLife(core.loop.time(), core.patience, is_first=is_first)
        self._news = NewsTimer(lambda: core.stats.bytes_received)
        self._received = ReceivedBytes()
        self._unmatched: list[Query[Any]] = []  # queries of the comparison without a response

    # --- what the connection reports ----------------------------------------------------------------------------------

    def seen(self, chunk: bytes) -> None:
        """Count bytes received, and keep the first ones, as evidence for an error."""
        self._life.bytes_at = self._core.loop.time()
        self._received.add(chunk, self._news.now)

    def heard(self, packet_id: int, content: bytes) -> None:
        """Take a response into account."""
        now = self._core.loop.time()
        self._core.repeats.heard_in_opening((packet_id, content))
        if packet_id == TransmissionModeSettingResponse.packet_id:
            self.mode_answered = content[0] if content else None
            if self._life.heard_at is None:
                self.queries.wake()
            self.pace.ready_at = now + AFTER_MODE  # the board may drop requests during a change of mode
        self._life.heard_at = self._life.responded_at = now
        kind = self.queries.origin(packet_id, content, self._core.codec)
        self.pace.heard(kind, packet_id, now)
        if packet_id not in _COMMAND_RESPONSES:
            self.queries.answered[kind] += 1
            self._handshake.heard(kind)
        self._news.tell()

    def heard_event(self) -> None:
        """Take a button event as a sign of life, not as a response."""
        self._life.heard_at = self._core.loop.time()

    def begin_again(self) -> None:
        """Draw a new word: another packet was sent beside the handshake."""
        self._handshake = self._new_handshake()
        self._news.tell()

    def end(self, error: ConnectionLost) -> None:
        """End the opening: the connection is lost."""
        self._news.fail(error)

    # --- result -------------------------------------------------------------------------------------------------------

    @property
    def unanswered(self) -> frozenset[str]:
        """Names of queries that the board is known or was seen not to answer, such as `QueryMemorySize`."""
        return self.queries.unanswered(self._handshake.unsupported)

    @property
    def fences(self) -> tuple[Query[Any], ...]:
        """Fences for the connection, at least two: all of FENCES, or if the board lacks some, those that it answers."""
        return self.queries.fences(self._handshake.unsupported)

    @property
    def is_proved(self) -> bool:
        """Whether the responses of the handshake prove that nothing is owed; otherwise only a silence says so."""
        return not self._handshake.is_quiet

    # --- phases -------------------------------------------------------------------------------------------------------

    async def run(self) -> list[Query[Any]]:
        """Open the connection. Return the queries of this handshake with outstanding responses.

        Raise HandshakeFailed if the board is silent or answers too little.
        """
        repeats = self._core.repeats
        try:
            if self._mode == 1:
                await self._set_mode()
            if not self._is_first:
                await self._wait_for_pause(self._life.begun_at, self._life.begun_at + LONGEST_DELAY)
                self.queries.answered.clear()
            await self._open()
            if self._is_first and self.pace.held.is_sure:
                raise self._failure()
            if self._is_suspicious:
                await self._compare(FENCES if self.queries.differ or not self._is_first else ())
                await self._open()  # once more, after a stop meanwhile
        except OpenError:
            if not self._evidence().answers_twice:
                raise
            await self._compare(FENCES)
            if self._is_first and not repeats.several:
                raise
            repeats.prove_always()
        finally:
            self._news.stop()
        leftover = self._handshake.leftover() if self._handshake.is_open else []
        return [*(kind for kind in leftover if not isinstance(kind, int)), *self._unmatched]

    async def _open(self) -> None:
        self.phase = Phase.HANDSHAKE
        while self.phase is not Phase.OPEN:
            self.phase = await (self._shake() if self.phase is Phase.HANDSHAKE else self._search())

    async def _shake(self) -> Phase:
        """Send the queries of a handshake until it is open, is replaced, or needs more kinds."""
        handshake, due = self._handshake, self._news.now
        while handshake is self._handshake and handshake.is_provable and not handshake.is_open:
            now = self._news.now
            self._give_up_if_late(now)
            if now < self.pace.ready_at:
                await self._news.wait(self.pace.ready_at)
                due = min(due, self.pace.ready_at)
                continue
            kind = handshake.query()
            if kind is not None:
                self.pace.begin(kind)
            elif now >= due and not await self._wake():
                kind, self.pace.timed = handshake.repeat(), None
            if kind is not None:
                due = now + self._try(kind)
                await self._ask(kind, now)
            await self._news.wait(min(due, self._life.limit(self.pace.round_trip)))
        if self._handshake.is_open:
            return Phase.OPEN
        return Phase.HANDSHAKE if self._handshake.is_provable else Phase.SEARCH

    async def _search(self) -> Phase:
        """Find further queries that the board answers; with too few of them, wait until the line was quiet for long."""
        queries = self.queries
        queries.unsupported |= self._handshake.unsupported
        while len(kinds := queries.known()) < LEAST_KINDS and queries.unasked:
            await self._ask_list(queries.unasked.pop(0))
        if not kinds:
            raise self._failure()
        if len(kinds) < LEAST_KINDS:
            self.phase = Phase.QUIET
            await self._wait_for_quiet()
            _logger.warning(
                "%s answers only %s of short queries: a late response to an earlier program cannot be excluded",
                escape(self._core.url),
                "one kind" if len(kinds) == 1 else f"{len(kinds)} kinds",
            )
        queries.kinds = kinds
        self._handshake = self._new_handshake(is_quiet=self._handshake.is_quiet or len(kinds) < LEAST_KINDS)
        return Phase.HANDSHAKE

    async def _ask_list(self, query: Query[Any]) -> None:
        """Ask for a list, several times if need be; without a response it counts as unsupported."""
        self.pace.silent_tries = self.pace.silent_tries if self._life.heard_at is None else 0
        for tries in range(MOST_SILENT + 1):
            while self._news.now < self.pace.ready_at:
                await self._news.wait(self.pace.ready_at)
            self._give_up_if_late(self._news.now)
            if query in self.queries.named:
                return
            if tries and await self._wake():
                continue
            await self._ask(query, self._news.now)
            due = self._news.now + self._try(query)
            while query not in self.queries.named and self._news.now < due:
                await self._news.wait(due)
        self.queries.unsupported.add(query)

    async def _wait_for_quiet(self) -> None:
        """Wait until nothing has come for a whole patience: too few kinds prove nothing."""
        while self._news.now < (quiet_at := self._life.quiet_at):
            if self._news.now >= self._life.longest_quiet_at:
                raise self._failure()
            await self._news.wait(quiet_at)
        self._life.count_from(self._news.now)  # the board is not late: it was not asked meanwhile

    def _new_handshake(self, *, is_quiet: bool = False) -> Handshake[Kind]:
        queries = self.queries
        return Handshake(
            queries.kinds,
            self._random,
            queries.unsupported,
            spare=[query for query in queries.unasked if query == SERVO_LIST],
            is_quiet=is_quiet,
            twice=self._core.slots.answer_twice,
        )

    # --- several boards -----------------------------------------------------------------------------------------------

    @property
    def _is_suspicious(self) -> bool:
        """Whether more came than was asked for, and a second board may have sent that."""
        has_more = self.queries.answered.total() > self.queries.sent.total()
        return not self._is_first or (has_more and (self._core.repeats.is_on or self.queries.differ))

    async def _compare(self, fences: Collection[Query[Any]]) -> None:
        """Ask short queries alone, and compare all answers."""
        self.phase = Phase.COMPARISON
        end = min(self._news.now + LONGEST_COMPARISON, self._life.end)
        # In a later opening, copies of earlier readings of a servo that moves may come meanwhile.
        servos = (QueryServoRequest(ALL_SERVOS),) if self._is_first else ()
        queries = [each for each in (*servos, SERVO_LIST, *fences) if each not in self.queries.unsupported]

        async def ask(query: Query[Any]) -> bool:
            if not await self._wait_for_pause(self._life.responded_at, end):
                return False
            self._core.repeats.asked(query.packet_id + 1, counts=False)
            await self._ask(query, self._news.now)
            await self._wait_for_pause(self._news.now, end)
            return True

        self._unmatched += await compare_boards(self._core.repeats, queries, ask)

    async def _wait_for_pause(self, since: float, end: float) -> bool:
        """Wait for a pause of all responses after `since`, and return whether there is one before `end` (loop time)."""
        end = min(end, self._news.now + LONGEST_DELAY)
        pause = self.pace.pause_of_all
        while self._news.now < (until := max(since, self._life.responded_at) + pause):
            if self._news.now > end:
                return False
            await self._news.wait(until)
        return True

    # --- one query ----------------------------------------------------------------------------------------------------

    async def _ask(self, kind: Kind, now: float) -> None:
        assert not isinstance(kind, int)  # noqa: S101 - only queries are kinds of a handshake
        self.queries.sent[kind] += 1
        self.pace.sent(kind, now, self.queries.sent.total())
        if self._life.bytes_at is None and self.pace.silent_tries >= _PAIR_AFTER:
            await self._send(kind)  # a board that sleeps loses the first bytes, and hears the second query
        await self._send(kind)

    async def _wake(self) -> bool:
        """Count a silent try. Return whether mode 1 was set in place of a repeat."""
        self.pace.silent_tries += 1
        if self._mode == "keep" or self._life.heard_at is not None or self.pace.silent_tries not in _WAKE_AFTER:
            return False
        await self._set_mode()
        return True

    async def _set_mode(self) -> None:
        """Set mode 1, alone: a board that changes its mode may drop what comes meanwhile."""
        await self._send(_MODE_1)
        self.pace.ready_at = self._news.now + self._try(_MODE_1)

    def _try(self, request: Query[Any] | TransmissionModeSettingRequest | int) -> float:
        """Return the seconds until a query is sent again: longer than a response takes on a slow line."""
        assert not isinstance(request, int)  # noqa: S101 - as in `_ask`
        return self.pace.timeout(request, is_silent=self._life.heard_at is None)

    # --- failure ------------------------------------------------------------------------------------------------------

    def _give_up_if_late(self, now: float) -> None:
        sent, answered, life = self.queries.sent.total(), self.queries.answered.total(), self._life
        most_repeated = _MOST_REPEATED if self._is_first else _LEAST_REPEATED
        is_endless = life.heard_at is not None and (sent >= _MOST_SENDINGS or answered - sent >= most_repeated)
        if is_endless or now >= life.limit(self.pace.round_trip):
            raise self._failure()
        if now >= life.patience_ends and self._evidence().has_longer_contents:
            raise self._failure()

    def _evidence(self) -> LineEvidence:
        sent, answered = self.queries.sent.total(), self.queries.answered.total()
        order, is_held = self._core.codec.byte_order, self.pace.held.is_sure
        return self._received.evidence(order, sent=sent, answered=answered, is_held=is_held)

    def _failure(self) -> HandshakeFailed:
        """Return the error of a board that is silent or answers too little, with what was received meanwhile."""
        evidence = self._evidence()
        effort = f"{evidence.sent} queries in {self._news.now - self._life.begun_at:.1f} s"
        explain = evidence.explain_silence if self._life.heard_at is None else evidence.explain_too_little
        return HandshakeFailed(f"{escape(self._core.url)} {explain(effort)}", evidence)


class Opener:
    """Begins each opening of a connection, and keeps what the openings have shown of the board."""

    def __init__(
        self,
        core: ConnectionCore,
        answers: ResponseDispatcher,
        writer: FrameWriter,
        fences: FenceChoice,
        *,
        transmission_mode: TransmissionMode,
        unsupported: Collection[str],
        random: Random,
    ) -> None:
        """Open through `writer`. `transmission_mode`, `unsupported` and `random` are as for `Connection`."""
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
        self.chance = random
        """Source of chance for fences and pauses."""
        self._core = core
        self._answers = answers
        self._writer = writer
        self._fences = fences
        self._mode: TransmissionMode = transmission_mode
        self._kinds: frozenset[int] = frozenset()  # packet ids of the queries of the latest opening
        self._reopened_at = -REOPENING_PAUSE

    def begin(self) -> None:
        """Begin the first opening, unless it has begun. Raise the error of an ended connection."""
        self._writer.raise_if_ended()
        if self._core.lifecycle.state is State.UNPROVED:
            self._begin(ConnectionEvent.HANDSHAKE_BEGUN)

    async def shake_hands(self) -> None:
        """Wait for the end of the first opening, which begins now unless it has begun. Raise OpenError."""
        self.begin()
        opening = self._answers.opening
        if self._core.lifecycle.state is State.OPENING and opening is not None and opening.task is not None:
            await Tasks.shared_result(opening.task)
        if several := self._core.repeats.several:
            evidence = LineEvidence(self._core.codec.byte_order, several=True)
            raise HandshakeFailed(several, evidence, reason=Reason.SEVERAL_BOARDS)

    def open_again(self, packet_id: int) -> None:
        """Begin another opening after a stray response to a fence: the handshake has taken a wrong response."""
        now, repeats = self._core.loop.time(), self._core.repeats
        if packet_id - 1 not in self._kinds or self._core.lifecycle.state is not State.READY:
            return
        if repeats.has_many_copies or repeats.several:
            return
        if now - self._reopened_at >= REOPENING_PAUSE:
            self._reopened_at = now
            self._core.stats.reopenings += 1
            self._begin(ConnectionEvent.STRAY_RESPONSE)

    def _begin(self, event: ConnectionEvent) -> None:
        core = self._core
        core.repeats.forget_questions()
        opening = self._answers.opening = Opening(
            core,
            lambda packet: self._writer.write(core.codec.encode(packet)),
            transmission_mode=self._mode,
            random=self.chance,
            unsupported=self.unsupported,
            is_first=event is ConnectionEvent.HANDSHAKE_BEGUN,
        )
        if early := bytes(self._answers.early):
            opening.seen(early)
        core.lifecycle.change(event)
        core.scheduler.pause()
        self._answers.close_all()
        opening.task = core.loop.create_task(self._run(opening))
        opening.task.add_done_callback(_see_exception)

    async def _run(self, opening: Opening) -> None:
        core = self._core
        try:
            leftover = await opening.run()
        except ServolinkError as error:
            self._answers.end(lost(core.url, error))
            raise
        except BaseException:
            self._answers.opening = None
            core.lifecycle.change(ConnectionEvent.HANDSHAKE_CANCELLED)
            raise
        self._answers.close_all()
        self._learn(opening)
        self._expect(leftover)
        self._answers.opening = None
        core.lifecycle.change(ConnectionEvent.HANDSHAKE_DONE)
        core.scheduler.resume()

    def _learn(self, opening: Opening) -> None:
        self._fences.use(opening.fences)
        self._kinds = opening.queries.packet_ids
        quickest = opening.pace.quickest
        self._core.times.quick = QUICK * quickest if quickest > QUICK_FROM else 0.0
        self.unsupported |= opening.unanswered
        self.answered = opening.queries.answered_ones
        self.woke |= opening.queries.has_woken
        self.mode_answered = opening.mode_answered
        self.is_proved = opening.is_proved

    def _expect(self, leftover: list[Query[Any]]) -> None:
        """Open a slot for each query of the handshake whose response is still to come."""
        # Their order stands in for their times, by which the fences are chosen that settle the most.
        slots = self._core.slots
        for age, query in zip(range(len(leftover), 0, -1), leftover, strict=True):
            slots.open(Slot(query, slots.lanes[query.packet_id + 1], None, float(-age), is_fence=True, overdue=True))


def _see_exception(handshake: asyncio.Task[None]) -> None:
    """Mark the error of a handshake as seen: all waiting callers get the same error from the end of the connection."""
    if not handshake.cancelled():
        handshake.exception()
