"""When to stop waiting for a response: timers, times learnt from earlier responses, and the silence of a board."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from servolink.connection.handshake import FIRST_LENGTH, THIRD_LENGTH
from servolink.connection.times import (
    AFTER_WRITE,
    BACKOFF,
    COMMAND_TRY,
    COMPARISON_PAUSE,
    FIRST_TRY,
    FORGOTTEN,
    LEAST_MARGIN,
    LONGEST_COMPARISON,
    LONGEST_COMPARISON_PAUSE,
    LONGEST_DELAY,
    LONGEST_OPENING_TRY,
    LONGEST_TRY,
    MOST_MARGIN,
    NOISY_PATIENCES,
    OPENING_PATIENCES,
    OTHER_KIND,
    QUERY_PAUSE,
    QUIET_PATIENCES,
    SILENT_TRIES_IN_PATIENCE,
    TRIES_IN_PATIENCE,
)
from servolink.errors import ConnectionLost
from servolink.protocol import Request
from servolink.support import call_at

_MOST_BACKOFFS = 20  # enough for the largest patience
# Bounds for a board without pauses, or faster than the parser: deadlines must not be put off for ever.
_MOST_LOOKS = 100
_MOST_BYTES = 1024 * 1024  # more than the system buffers
_FREE_SENDINGS = 24  # queries of an opening that follow each other without a pause
_LEAST_TRIPS = FIRST_LENGTH // 2
_LEAST_BEHIND = 2  # responses behind the next query
_SILENT_SENDINGS = 5  # after fewer, a board without a response may only be slow


class DeadlineTimer:
    """Calls `passed(now)` when the earliest deadline has passed and all bytes from before have been read.

    After a stall of the event loop the response may already be in the operating system's buffer. So the loop reads
    again, for as long as that brings bytes, before anything counts as late.
    """

    def __init__(
        self,
        passed: Callable[[float], None],
        received: Callable[[], int],
        due: Callable[[], float | None] | None = None,
    ) -> None:
        """`received` returns the number of bytes received, `due` the earliest deadline in force."""
        self._loop = asyncio.get_running_loop()
        self._passed = passed
        self._received = received
        self._due = due
        self._timer: asyncio.TimerHandle | None = None
        self.deadline = math.inf
        """Time of the timer; infinity without a timer. Callers of `arm` compare first, to save a call for each slot."""

    def arm(self, deadline: float) -> None:
        """Call `passed` once `deadline` (loop time) has passed; an earlier deadline stands."""
        if deadline < self.deadline:
            self.stop()
            self.deadline = deadline
            self._timer = call_at(self._loop, deadline, self._reached, deadline)

    def stop(self) -> None:
        """Forget all deadlines, and stop the timer."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self.deadline = math.inf

    def _reached(self, deadline: float) -> None:
        self._timer = None
        self.deadline = math.inf
        due = deadline if self._due is None else self._due()
        if due is not None and due > deadline:  # the request of this timer was answered
            self.arm(due)
        elif due is not None:
            self._look_again(deadline, -1, _MOST_LOOKS, self._received() + _MOST_BYTES)

    def _look_again(self, deadline: float, received: int, looks: int, most: int) -> None:
        # Two turns of the loop: in one turn, this callback runs before newly read bytes.
        self._loop.call_soon(self._loop.call_soon, self._look, deadline, received, looks, most)

    def _look(self, deadline: float, received: int, looks: int, most: int) -> None:
        now_received = self._received()
        if received != now_received < most and looks:
            self._look_again(deadline, now_received, looks - 1, most)
            return
        self._passed(max(deadline, self._loop.time()))  # a timer fires early by the resolution of the clock


class NewsTimer:
    """Waits for news from a board, at most until a time."""

    def __init__(self, received: Callable[[], int]) -> None:
        """`received` returns the number of bytes received, as for DeadlineTimer."""
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()
        self._timer = DeadlineTimer(self._passed, received)
        self._passed_at = 0.0  # the latest passed deadline
        self._error: ConnectionLost | None = None

    @property
    def now(self) -> float:
        """Time of the loop, and not before the latest deadline: a timer fires early by the resolution of the clock."""
        return max(self._passed_at, self._loop.time())

    def tell(self) -> None:
        """Wake who waits: there is news."""
        self._news.set()

    def fail(self, error: ConnectionLost) -> None:
        """Wake who waits with an error: there will be no news."""
        self._error = error
        self._news.set()

    async def wait(self, until: float) -> None:
        """Wait for news, at most until `until` (loop time). Raise ConnectionLost."""
        self._timer.arm(until)
        await self._news.wait()
        self._news.clear()
        if self._error is not None:
            raise self._error.copy()

    def stop(self) -> None:
        """Stop the timer, if it is running."""
        self._timer.stop()

    def _passed(self, now: float) -> None:
        self._passed_at = now
        self._news.set()


class ResponseTimes:
    """Response times of each kind on this line, estimated as in TCP (RFC 6298).

    On a line that loses much and delays nothing a short margin makes losses good soon. A response that comes after
    another one has already ended its call shows that the board was only late: then the margin grows.
    """

    def __init__(self) -> None:
        """Start without the time of any response."""
        self.quick = 0.0
        """Seconds in which a response is too quick to be trusted, QUICK of the quickest so far; 0 for none."""
        self._margin = LEAST_MARGIN
        self._estimates: dict[int, tuple[float, float, float]] = {}  # by packet id: smoothed, variation, timeout

    def record(self, packet_id: int, seconds: float) -> None:
        """Take the time of a response into account whose sending is certain."""
        estimate = self._estimates.get(packet_id)
        if estimate is None:
            smoothed, variation = seconds, seconds / 2
        else:
            smoothed, variation, _ = estimate
            error = seconds - smoothed
            smoothed += error / 8
            variation += ((error if error > 0 else -error) - variation) / 4
        margin = self._margin
        if margin > LEAST_MARGIN:
            margin = self._margin = margin * FORGOTTEN
        timeout = smoothed + max(margin, 4 * variation)
        self._estimates[packet_id] = smoothed, variation, min(LONGEST_TRY, timeout)

    def late(self) -> None:
        """Wait longer from now on: a request was sent again while the response was on its way."""
        self._margin = min(2 * self._margin, MOST_MARGIN)

    def timeout(self, request: Request[Any], tries: int, *, after_write: bool) -> float:
        """Return the seconds for the next sending of `request` after `tries` earlier ones."""
        estimate = self._estimates.get(request.packet_id)
        if estimate is not None:
            if tries < 2 and not after_write:  # most requests
                return estimate[2]
            seconds = estimate[2]
        elif not request.repeatable:
            seconds = COMMAND_TRY
        elif self._estimates:
            seconds = min(smoothed for smoothed, _, _ in self._estimates.values()) + OTHER_KIND + self._margin
        else:
            seconds = FIRST_TRY
        if after_write and seconds < AFTER_WRITE:
            seconds = AFTER_WRITE
        # One loss does not show a slow board: only from the third sending on there is more time.
        return seconds if tries < 2 else seconds * BACKOFF ** min(tries - 1, _MOST_BACKOFFS)


class Silence:
    """Time since the first request without any frame from the board."""

    def __init__(self) -> None:
        """Start without any query under way."""
        self.since: float | None = None
        """Time of the first request since the latest frame; None if there was none."""
        self.sendings = 0
        """Number of requests since that time."""

    def begin(self, now: float) -> None:
        """Count from `now`, when a request is sent."""
        self.since, self.sendings = now, 0

    def count_from(self, now: float) -> None:
        """Forget the time before `now`, when the board could not answer."""
        if self.since is not None:
            self.since = now

    def seconds(self, now: float) -> float:
        """Return the duration of the silence; 0.0 after too few requests for a judgement."""
        return 0.0 if self.since is None or self.sendings < _SILENT_SENDINGS else now - self.since


class HeldResponses:
    """Order of queries and responses of an opening: whether each response is held until the next query comes."""

    def __init__(self) -> None:
        """Start without queries."""
        self._before: object = None
        self._latest: object = None
        self._behind = 0  # responses to the query before the latest
        self._is_prompt = False  # whether a response came before the next query

    def sent(self, query: object) -> None:
        """Take a query into account."""
        self._before, self._latest = self._latest, query

    def heard(self, query: object) -> None:
        """Take the response to `query` into account; to the first query and equal ones in a row it says nothing."""
        if self._before not in {None, self._latest}:
            self._is_prompt |= query == self._latest
            self._behind += query == self._before

    @property
    def is_sure(self) -> bool:
        """Whether responses came behind the next query, and never before it."""
        return not self._is_prompt and self._behind >= _LEAST_BEHIND


class QueryPace:
    """When the queries of an opening are sent, by the responses so far."""

    def __init__(self, times: ResponseTimes, patience: float) -> None:
        """Record response times in `times`. A try is a share of `patience`, in seconds."""
        self.ready_at = 0.0
        """When the next query may be sent (loop time)."""
        self.silent_tries = 0
        """Tries in a row without any response."""
        self.round_trip = 0.0
        """Seconds to the response to the latest answered query, repeats included."""
        self.timed: object = None
        """Query under way, if it was sent once; None otherwise."""
        self._times = times
        self._patience = patience
        self._first_sent_at: dict[object, float] = {}  # by query: first sending since the latest response
        self._trips: list[float] = []  # seconds to the responses of queries sent once
        self.held = HeldResponses()

    def begin(self, query: object) -> None:
        """Take the time of a query from its next sending: it is sent for the first time."""
        self.timed = query
        self._first_sent_at.pop(query, None)

    def sent(self, query: object, now: float, count: int) -> None:
        """Take a sending into account, the `count`-th of all. Many of them are sent with pauses."""
        self._first_sent_at.setdefault(query, now)
        self.held.sent(query)
        if count >= _FREE_SENDINGS:
            self.ready_at = now + QUERY_PAUSE

    def heard(self, query: object, packet_id: int, now: float) -> None:
        """Take the response to a query into account, by the id of the response."""
        self.held.heard(query)
        if (sent_at := self._first_sent_at.pop(query, None)) is not None:
            self.round_trip = now - sent_at
            if query == self.timed:
                self._trips.append(self.round_trip)
                self._times.record(packet_id - 1, self.round_trip)
        self.silent_tries = 0

    def timeout(self, request: Request[Any], *, is_silent: bool) -> float:
        """Return the seconds until a query is sent again; `is_silent` says that nothing at all was answered so far."""
        usual = min(self._times.timeout(request, 0, after_write=False), self._patience / TRIES_IN_PATIENCE)
        pause = usual * BACKOFF ** max(0, self.silent_tries - 1)
        if is_silent:
            pause = min(pause, max(usual, self._patience / SILENT_TRIES_IN_PATIENCE))
        return max(pause, min(1.5 * self.round_trip, LONGEST_OPENING_TRY))

    @property
    def pause_of_all(self) -> float:
        """Seconds after which all boards of a line have answered a query."""
        return max(COMPARISON_PAUSE, min(3 * self.round_trip, LONGEST_COMPARISON_PAUSE))

    @property
    def quickest(self) -> float:
        """Seconds to the quickest response; 0 after few responses in time."""
        return min(self._trips) if len(self._trips) >= _LEAST_TRIPS else 0.0


class SignsOfLife:
    """Signs of life of a board during an opening, and when it is given up for lack of them (loop times)."""

    def __init__(self, now: float, patience: float, *, is_first: bool) -> None:
        """Begin `now`. Only the first opening of a connection has time for all it needs."""
        self.begun_at = now
        self.heard_at: float | None = None
        """When the latest response or event came; None before any."""
        self.bytes_at: float | None = None
        """When the latest bytes came, of whatever kind; None before any."""
        self.responded_at = now
        """When the latest response came; when the opening began, before any."""
        self.end = math.inf if is_first else now + LONGEST_DELAY + max(LONGEST_COMPARISON, OPENING_PATIENCES * patience)
        """When pause, handshake and comparison are over in any case."""
        self._since = now  # since when the board is asked
        self._patience = patience

    def count_from(self, now: float) -> None:
        """Count from `now`: the board was not asked before."""
        self._since = now
        self.heard_at = self.heard_at and now

    def limit(self, round_trip: float) -> float:
        """Return when the board is given up: later if it shows signs of life, and if it answers slowly."""
        since, patience = self._since, self._patience
        if self.heard_at is not None:
            most = OPENING_PATIENCES * patience + THIRD_LENGTH * min(round_trip, patience)
            limit = min(self.heard_at + QUIET_PATIENCES * patience, since + most)
        elif self.bytes_at is not None:
            limit = min(max(since, self.bytes_at) + patience, since + NOISY_PATIENCES * patience)
        else:
            limit = since + patience
        return min(self.end, limit)

    @property
    def patience_ends(self) -> float:
        """When a board without a sign of life is given up."""
        return self._since + self._patience

    @property
    def quiet_at(self) -> float:
        """When the line has been quiet for a whole patience, unless something comes."""
        return (self.heard_at or self.begun_at) + self._patience

    @property
    def longest_quiet_at(self) -> float:
        """When waiting for that ends."""
        return self.begun_at + OPENING_PATIENCES * self._patience
