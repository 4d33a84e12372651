"""Guarding: feeds the guard from the readings of the hub, and stops the board for a stalled servo."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable

from servolink.client import Board, ServoReading, ServoReadings
from servolink.control import ProblemNotice
from servolink.errors import ServolinkError
from servolink.hub.hub import Hub
from servolink.hub.rules.guard import AFTERWARDS, Guard
from servolink.protocol import Packet
from servolink.support import Tasks

RESTING_HZ = 1.0
"""Readings per second while nothing moves."""
MOST_HZ = 50.0
"""Most readings per second for the guard while something moves."""
PROMISED_HZ = 10.0
"""Readings per second at which a stall is found within a second."""
SHARE = 0.25
"""Most of the line that the guard takes."""

_READINGS = 20  # whose quickest says how long the line takes for one
_PAUSE = 0.5  # seconds until the servos are read again after an error


class Guarding:
    """Guard of a hub, until closed: it shares the poll of all watchers, which is faster only while servos move."""

    def __init__(self, hub: Hub, open_board: Callable[[], Awaitable[Board]], hottest: int | None = None) -> None:
        """Watch over the servos of `hub`, read through `open_board`; warn before a raw temperature passes `hottest`."""
        self.guard = Guard(hottest)
        self._hub = hub
        self._open_board = open_board
        self._now = asyncio.get_running_loop().time
        self._took = deque[float](maxlen=_READINGS)
        self._readings: ServoReadings | None = None
        self._is_slow = False
        self._end_following = hub.follow_requests(self._sent)
        self._tasks = Tasks()
        self._tasks.begin(self._run())

    @property
    def moving_hz(self) -> float:
        """Readings per second while servos move: what a quarter of the line carries, at most 50."""
        quickest = min(self._took, default=0.0)
        return min(MOST_HZ, SHARE / quickest) if quickest > SHARE / MOST_HZ else MOST_HZ

    async def close(self) -> None:
        """Watch no longer."""
        self._end_following()
        await self._tasks.close()

    def _sent(self, packet: Packet, outcome: object, asked_at: float, who: str, session_id: str) -> None:
        """Read faster from now on, after a motion."""
        if packet.is_motion and self._readings is not None:
            self._readings.pace(self.moving_hz)

    async def _run(self) -> None:
        told = ""
        while True:
            board = await self._open_board()
            try:
                async with board.watch(RESTING_HZ) as self._readings:
                    async for reading in self._readings:
                        self._take(reading)
            except ServolinkError as error:
                if board.connection.ended is not None:  # the hub has ended
                    return
                if str(error) != told:
                    told = str(error)
                    self._hub.tell(ProblemNotice(f"the guard cannot read the servos: {told}; trying again"))
            else:
                return
            finally:
                self._readings = None
            await asyncio.sleep(_PAUSE)

    def _take(self, reading: ServoReading) -> None:
        """Look at a reading, and decide when to read next."""
        courses, now = self._hub.motions.courses, reading.seconds
        self._took.append(reading.took)
        courses.follow(now)
        for stall in self.guard.stalls(reading.servos, courses.way, now):
            self._hub.stop_stalled(stall.servo_id, str(stall))
        for warning in self.guard.warnings(reading.servos, now):
            self._hub.tell(ProblemNotice(f"the guard warns: {warning}"))
        courses.seen({servo.servo_id: int(servo.angle) for servo in reading.servos if not servo.doubt}, now)
        is_moving = now <= courses.end_of_motion() + AFTERWARDS
        if self._readings is not None:
            self._readings.pace(self.moving_hz if is_moving else RESTING_HZ)
        if is_moving:
            self._tell_slow()

    def _tell_slow(self) -> None:
        """Say once that the line is too slow for what the guard promises."""
        if self._is_slow or len(self._took) < _READINGS or (hz := self.moving_hz) >= PROMISED_HZ:
            return
        self._is_slow = True
        found = f"a stall is found within {PROMISED_HZ / hz:.1f} s, not within a second"
        self._hub.tell(ProblemNotice(f"a quarter of this line carries {hz:.1f} readings a second to a guard: {found}"))
