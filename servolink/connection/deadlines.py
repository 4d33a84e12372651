"""When to stop waiting for a response: a timer, times learnt from earlier responses, and the silence of a board."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any

from servolink.protocol.packet import Request

FIRST_TRY = 0.25
"""Seconds until a request is sent again, before any response has been timed."""
COMMAND_TRY = 1.0
"""The same for a request that is sent once: then a fence is sent."""
AFTER_WRITE = 0.5
"""At least so many seconds for what follows a request that is sent once: the board may be writing its memory."""
BACKOFF = 1.5
"""Each try after the second one gets so many times as long."""

_OTHER_KIND = 0.1  # seconds more for an untimed kind than for the quickest one
_LEAST_MARGIN, _MOST_MARGIN = 0.04, 0.3  # seconds more for a response than usual
_FORGOTTEN = 0.98  # factor of a grown margin for each response in time
_LONGEST = 0.5
_MOST_BACKOFFS = 20  # enough for the largest patience
# Bounds for a board without pauses, or faster than the parser: deadlines must not be put off for ever.
_MOST_LOOKS = 100
_MOST_BYTES = 1024 * 1024  # more than the system buffers
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
            self._timer = self._loop.call_at(deadline, self._reached, deadline)

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


class ResponseTimes:
    """Response times of each kind on this line, estimated as in TCP (RFC 6298).

    On a line that loses much and delays nothing a short margin makes losses good soon. A response that comes after
    another one has already ended its call shows that the board was only late: then the margin grows.
    """

    def __init__(self) -> None:
        """Start without response times."""
        self._margin = _LEAST_MARGIN
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
        if margin > _LEAST_MARGIN:
            margin = self._margin = margin * _FORGOTTEN
        timeout = smoothed + (4 * variation if 4 * variation > margin else margin)
        self._estimates[packet_id] = smoothed, variation, timeout if timeout < _LONGEST else _LONGEST

    def late(self) -> None:
        """Wait longer from now on: a request was sent again while the response was on its way."""
        self._margin = min(2 * self._margin, _MOST_MARGIN)

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
            seconds = min(smoothed for smoothed, _, _ in self._estimates.values()) + _OTHER_KIND + self._margin
        else:
            seconds = FIRST_TRY
        if after_write and seconds < AFTER_WRITE:
            seconds = AFTER_WRITE
        # One loss does not show a slow board: only from the third sending on there is more time.
        return seconds if tries < 2 else seconds * BACKOFF ** min(tries - 1, _MOST_BACKOFFS)


class Silence:
    """Time since the first request without any frame from the board."""

    def __init__(self) -> None:
        """Start with nothing asked."""
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
