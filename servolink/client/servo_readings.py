"""Consecutive readings of all servos (3.2.2), with a single query for all iterators."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import ClassVar, cast

from msgspec import Struct

from servolink.client.alarms import Alarm, AlarmWatch, RaisedAlarm
from servolink.client.board_servos import ServoController
from servolink.client.readers import Reader, SharedIterator, Source
from servolink.client.servo_state import Servo
from servolink.client.session import Session
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout, ServolinkError, quote
from servolink.protocol import ALL_SERVOS, SetServoParameterRequest
from servolink.support import call_at, is_number

_SLACK = 1e-6  # seconds: sums of periods are not exact


class ServoReading(Struct, frozen=True):
    """State of all servos at a time."""

    seconds: float
    """When the response came, on the clock of the event loop (`loop.time()`): only differences have a meaning."""
    servos: tuple[Servo, ...]
    missed: int = 0
    """Readings left out directly before: the program or the board was too slow."""
    alarms: tuple[RaisedAlarm, ...] = ()
    """Alarms raised since the reading before, also by readings left out."""
    took: float = 0.0
    """Seconds from the request to the response."""


class _RatedReader(Reader[ServoReading]):
    """Latest reading, at most at the rate of the iterator."""

    def __init__(self, hz: float | None, alarms: tuple[Alarm, ...]) -> None:
        super().__init__(1)
        self.hz = hz
        self._alarms = AlarmWatch(alarms)
        self.can_stop = any(alarm.stops for alarm in alarms)
        self._raised: tuple[RaisedAlarm, ...] = ()  # not in an item yet
        self.due = 0.0
        """When the next reading is to be asked for, or later."""

    def offer(self, requested_at: float, reading: ServoReading) -> bool:
        """Take a reading requested at `requested_at`, unless too early; an unread reading is replaced.

        Return whether it raises an alarm that stops the servos.
        """
        raised = self._alarms.check(reading.servos, reading.seconds)
        self._raised += raised
        if requested_at >= self.due - _SLACK:
            self._take(requested_at, reading)
        return any(each.alarm.stops for each in raised)

    def _take(self, requested_at: float, reading: ServoReading) -> None:
        missed = 0
        if self.hz is not None:
            missed = int((requested_at - self.due + _SLACK) * self.hz)
            self.due += (missed + 1) / self.hz
        raised, self._raised = self._raised, ()
        if self.items:
            missed += self.items[0].missed + 1
            raised = self.items[0].alarms + raised
        self.put(ServoReading(reading.seconds, reading.servos, missed, raised, reading.took))


class ServoWatch(Source[_RatedReader]):
    """Reads all servos while there are readers, at the rate of the fastest reader.

    Without a rate as many queries are asked as the connection has use for: one that is answered is asked again, one
    more is added while nobody waits for a permit, and one is left out while others wait.
    """

    def __init__(self, session: Session, servos: ServoController) -> None:
        super().__init__(session.loop)
        self._session = session
        self._servos = servos
        self._readers: set[_RatedReader] = set()
        self._queries: set[asyncio.Task[None]] = set()
        self._resuming: asyncio.Task[None] | None = None
        self._stopping: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._period: float | None = None  # as fast as possible if None
        self._began_at = 0.0
        self._ticks = 0  # periods counted since the first reading
        self._is_late = False  # whether there was no room for the latest
        self._has_read = False  # whether there was a reading
        self._ended = False
        session.end_with(self._end)

    async def join(self, reader: _RatedReader) -> None:
        """Read for `reader` from now on. Raise ConnectionLost if the board is closed, or lost for good."""
        ended = self._session.connection.ended
        if self._ended and ended is not None:
            reader.ended = True
            raise ended.copy()
        reader.due = self._loop.time()
        self._readers.add(reader)
        self._begin()

    def pace(self, reader: _RatedReader, hz: float) -> None:
        """Read `hz` times a second for `reader` from now on; a change counts at once."""
        reader.hz, reader.due = hz, self._loop.time()
        if reader in self._readers:
            self._begin()

    async def leave(self, reader: _RatedReader) -> None:
        """Read no further for `reader`."""
        self.leave_soon(reader)

    def leave_soon(self, reader: _RatedReader) -> None:
        """Leave now, without waiting for the next reading."""
        reader.end()
        reader.items.clear()
        self._readers.discard(reader)
        if not self._loop.is_closed():
            self._begin()

    async def close(self) -> None:
        """End every reader and stop reading, after a stop caused by an alarm."""
        if self._stopping is not None:
            await asyncio.wait((self._stopping,))
        for reader in list(self._readers):
            self.leave_soon(reader)
        tasks = [*self._queries, *([] if self._resuming is None else [self._resuming])]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def _end(self, error: ConnectionLost) -> None:
        """End every reader for good: with `error`, quietly if the program closed the board."""
        self._ended = True
        self._fail(error)

    def _fail(self, error: ServolinkError) -> None:
        for reader in self._readers:
            reader.end(error)
        self._readers.clear()
        self._begin()

    def _begin(self) -> None:
        """Begin to read at the rate of the present readers."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self._readers:
            return
        rates = [reader.hz for reader in self._readers]
        limited = [hz for hz in rates if hz is not None]
        self._period = 1 / max(limited) if len(limited) == len(rates) else None
        self._began_at, self._ticks = self._loop.time(), 0
        if self._period is None:
            self._fill()
        else:
            self._tick(self._period)

    def _tick(self, period: float) -> None:
        """Send the query due now, and set the timer for the next."""
        due = self._began_at + self._ticks * period
        self._ticks = max(self._ticks, int((self._loop.time() - self._began_at) / period)) + 1
        self._timer = call_at(self._loop, self._began_at + self._ticks * period, self._tick, period)
        self._is_late = not self._ask(due)

    def _fill(self) -> None:
        """Send another query if useful; the query does the same in turn."""
        if self._readers and self._period is None:
            self._ask(self._loop.time())

    def _ask(self, due: float) -> bool:
        """Send a query due at `due`, unless the connection is lost or busy enough."""
        connection = self._session.connection
        has_enough = connection.has_waiting or len(self._queries) >= connection.callers
        if self._resuming is not None or (self._queries and has_enough):
            return False
        query = self._loop.create_task(self._read(due))
        self._queries.add(query)
        query.add_done_callback(self._queries.discard)
        return True

    async def _read(self, due: float) -> None:
        """Send a query, and repeat as long as needed."""
        try:
            while self._readers and await self._read_once(due):
                due = self._loop.time()
        except ServolinkError as error:
            connection = self._session.connection
            if isinstance(error, ConnectionLost) and (connection.ended is not None or self._session.state == "lost"):
                self._resume_later()
            elif isinstance(error, RequestTimeout | ConnectionLost) and self._has_read and connection.outlasts_silence:
                self._loop.call_soon(self._fill)  # the hub has lost its board, which may come back
            else:
                self._fail(error)
        finally:  # at once, or a new reader would take it for a query under way
            self._queries.discard(cast("asyncio.Task[None]", asyncio.current_task()))

    async def _read_once(self, due: float) -> bool:
        """Send a query. Return whether to send another at once."""
        if self._period is None:
            self._loop.call_soon(self._fill)  # when the present query is under way, or waits
        asked_at = self._loop.time()
        servos = await self._servos.servos()
        self._has_read = True
        reading = ServoReading(self._loop.time(), servos, took=self._loop.time() - asked_at)
        readers = tuple(self._readers)  # a copy: a change of readers meanwhile must not swallow a stop
        stopping = [reader for reader in readers if reader.offer(due, reading)]
        if stopping and self._stopping is None:
            self._stopping = self._loop.create_task(self._stop())
        if self._period is None:
            return len(self._queries) == 1 or not self._session.connection.has_waiting
        is_late, self._is_late = self._is_late, False
        return is_late

    async def _stop(self) -> None:
        """Stop the servos, because of an alarm. End the readers with the alarm if the stop cannot be confirmed."""
        try:
            await self._servos.stop()
        except ServolinkError as error:
            request = SetServoParameterRequest(ALL_SERVOS, 0, 1)
            unknown = OutcomeUnknown(f"an alarm was raised, and the servos may still move: {error}", request)
            unknown.__cause__ = error
            for reader in [reader for reader in self._readers if reader.can_stop]:
                reader.end(unknown)
                self._readers.discard(reader)
            self._begin()
        finally:
            self._stopping = None

    def _resume_later(self) -> None:
        """Read again after the connection is restored."""
        if self._resuming is None and not self._ended:
            self._resuming = self._loop.create_task(self._resume())

    async def _resume(self) -> None:
        states = self._session.states()
        while await anext(states) == "lost":
            pass
        self._resuming = None
        self._begin()


class ServoReadings(SharedIterator[ServoReading, _RatedReader]):
    """Readings of all servos as an async iterator; `async with`, or simply `async for`, begins and ends reading.

    It ends when the board is closed and raises ConnectionLost when the connection is lost for good; any other error of
    a reading ends it too, but while a hub has lost its board, it waits. A program that is too slow gets the latest
    reading, and `missed` counts the others.

    Alarms are compared with every reading, also with those that a slow program misses. An alarm that stops the servos
    does so at once, and reading goes on; if the stop cannot be confirmed, the iterator raises OutcomeUnknown.
    """

    MOST_HZ: ClassVar[float] = 1000.0
    """Most readings per second that can be asked for."""

    def __init__(self, watch: ServoWatch, hz: float | None, alarms: Iterable[Alarm] = ()) -> None:
        """Read `hz` times a second, 0 < hz <= 1000; None: as often as possible."""
        if hz is not None and not is_number(hz):
            raise TypeError(f"hz must be a number of readings per second or None, not {quote(hz)}")
        if hz is not None and not 0 < hz <= self.MOST_HZ:
            raise ValueError(f"hz must be above 0 and at most {self.MOST_HZ:g}, not {quote(hz)}")
        self._hz = hz
        self._alarms = tuple(alarms)
        self._watch = watch
        super().__init__(watch)

    def __repr__(self) -> str:
        """Return rate and state, such as `<ServoReadings at 50 Hz, reading>`."""
        state = "ended" if self._reader.ended else "reading" if self._joined else "not begun"
        rate = "as fast as possible" if self._hz is None else f"at {self._hz:g} Hz"
        return f"<ServoReadings {rate}, {state}>"

    def pace(self, hz: float) -> None:
        """Read `hz` times a second from now on, 0 < hz <= 1000."""
        if hz != self._hz:
            self._hz = hz
            self._watch.pace(self._reader, hz)

    def _new_reader(self) -> _RatedReader:
        return _RatedReader(self._hz, self._alarms)
