"""Readings of all servos, one after the other (3.2.2): the board is asked once for all iterators together."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from typing import cast

from msgspec import Struct

from servolink.client.alarms import Alarm, AlarmWatch, RaisedAlarm
from servolink.client.readers import Reader, SharedIterator, Source
from servolink.client.servos import Servo, ServoController
from servolink.client.session import Session
from servolink.connection.explain import same
from servolink.errors import ConnectionLost, OutcomeUnknown, RequestTimeout, ServolinkError
from servolink.escaping import quote
from servolink.numeric import is_number
from servolink.protocol.servos import ALL_SERVOS, SetServoParameterRequest

MOST_HZ = 1000.0
"""Readings per second that can be asked for."""

_SLACK = 1e-6  # seconds: sums of periods are not exact


class ServoReading(Struct, frozen=True):
    """The state of all servos at one time."""

    seconds: float
    """When the response came, on the clock of the event loop (`loop.time()`): only differences have a meaning."""
    servos: tuple[Servo, ...]
    missed: int = 0
    """Readings left out directly before this one: the program was too slow for them, or the board."""
    alarms: tuple[RaisedAlarm, ...] = ()
    """Alarms raised since the reading before, also by readings that were left out."""


class _RatedReader(Reader[ServoReading]):
    """The latest reading, at most so often as its iterator wants one."""

    def __init__(self, hz: float | None, alarms: tuple[Alarm, ...]) -> None:
        super().__init__(1)
        self.hz = hz
        self._alarms = AlarmWatch(alarms)
        self.can_stop = any(alarm.stops for alarm in alarms)
        self._raised: tuple[RaisedAlarm, ...] = ()  # not in an item yet
        self.due = 0.0
        """When the next reading is to be asked for, or later."""

    def offer(self, asked_at: float, reading: ServoReading) -> bool:
        """Take a reading that was asked for at `asked_at`, unless it is too early; in place of an unread one.

        Return whether it raises an alarm that stops the servos.
        """
        raised = self._alarms.check(reading.servos, reading.seconds)
        self._raised += raised
        if asked_at >= self.due - _SLACK:
            self._take(asked_at, reading)
        return any(each.alarm.stops for each in raised)

    def _take(self, asked_at: float, reading: ServoReading) -> None:
        missed = 0
        if self.hz is not None:
            missed = int((asked_at - self.due + _SLACK) * self.hz)
            self.due += (missed + 1) / self.hz
        raised, self._raised = self._raised, ()
        if self.items:
            missed += self.items[0].missed + 1
            raised = self.items[0].alarms + raised
        self.put(ServoReading(reading.seconds, reading.servos, missed, raised))


class ServoWatch(Source[_RatedReader]):
    """Reads all servos while there is at least one reader, as often as the one that wants the most readings.

    Without a rate as many queries are asked as the connection has use for: one that is answered is asked again, one
    more is added while nobody waits for a permit, and one is left out while others wait.
    """

    def __init__(self, session: Session, servos: ServoController) -> None:
        """Start without readers."""
        super().__init__(session.loop)
        self._session = session
        self._servos = servos
        self._readers: set[_RatedReader] = set()
        self._queries: set[asyncio.Task[None]] = set()
        self._resuming: asyncio.Task[None] | None = None
        self._stopping: asyncio.Task[None] | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._period: float | None = None  # None: as fast as possible
        self._began_at = 0.0
        self._ticks = 0  # periods since then
        self._is_late = False  # whether there was no room for the latest one
        self._has_read = False  # whether there was a reading
        self._ended = False
        session.end_with(self._end)

    async def join(self, reader: _RatedReader) -> None:
        """Read for `reader` from now on. Raise ConnectionLost if the board is closed, or lost for good."""
        ended = self._session.connection.ended
        if self._ended and ended is not None:
            reader.ended = True
            raise same(ended)
        reader.due = self._loop.time()
        self._readers.add(reader)
        self._begin()

    async def leave(self, reader: _RatedReader) -> None:
        """Read no further for `reader`."""
        self.leave_soon(reader)

    def leave_soon(self, reader: _RatedReader) -> None:
        """Leave now."""
        reader.end()
        reader.items.clear()
        self._readers.discard(reader)
        if not self._loop.is_closed():
            self._begin()

    async def close(self) -> None:
        """End every reader and stop reading, once a stop that an alarm asked for has ended."""
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
        """Begin to read at the rate that the readers want now."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if not self._readers:
            return
        rates = [reader.hz for reader in self._readers]
        known = [hz for hz in rates if hz is not None]
        self._period = 1 / max(known) if len(known) == len(rates) else None
        self._began_at, self._ticks = self._loop.time(), 0
        if self._period is None:
            self._fill()
        else:
            self._tick(self._period)

    def _tick(self, period: float) -> None:
        """Ask for the reading that is due now, and set the timer for the next one."""
        due = self._began_at + self._ticks * period
        self._ticks = max(self._ticks, int((self._loop.time() - self._began_at) / period)) + 1
        self._timer = self._loop.call_at(self._began_at + self._ticks * period, self._tick, period)
        self._is_late = not self._ask(due)

    def _fill(self) -> None:
        """Ask one query more if there is use for it; it does the same in turn."""
        if self._readers and self._period is None:
            self._ask(self._loop.time())

    def _ask(self, due: float) -> bool:
        """Ask a query that is due at `due`, unless the connection is lost or has no use for it."""
        connection = self._session.connection
        has_enough = connection.has_waiting or len(self._queries) >= connection.callers
        if self._resuming is not None or (self._queries and has_enough):
            return False
        query = self._loop.create_task(self._read(due))
        self._queries.add(query)
        query.add_done_callback(self._queries.discard)
        return True

    async def _read(self, due: float) -> None:
        """Ask a query, and again as long as that is needed."""
        try:
            while self._readers and await self._read_once(due):
                due = self._loop.time()
        except ConnectionLost:
            self._resume_later()
        except ServolinkError as error:
            if (
                isinstance(error, RequestTimeout)
                and self._has_read
                and self._session.connection.lifecycle.outlasts_silence
            ):
                self._loop.call_soon(self._fill)  # the hub has lost its board, which may come back
            else:
                self._fail(error)
        finally:  # at once, or whoever begins to read now would take it for a query under way
            self._queries.discard(cast("asyncio.Task[None]", asyncio.current_task()))

    async def _read_once(self, due: float) -> bool:
        """Ask a query. Return whether it should be asked again at once."""
        if self._period is None:
            self._loop.call_soon(self._fill)  # when this one is on its way, or waits
        servos = await self._servos.servos()
        self._has_read = True
        reading = ServoReading(self._loop.time(), servos)
        readers = tuple(self._readers)  # a copy: no reader that comes or goes meanwhile may swallow a stop
        stopping = [reader for reader in readers if reader.offer(due, reading)]
        if stopping and self._stopping is None:
            self._stopping = self._loop.create_task(self._stop())
        if self._period is None:
            return len(self._queries) == 1 or not self._session.connection.has_waiting
        is_late, self._is_late = self._is_late, False
        return is_late

    async def _stop(self) -> None:
        """Stop the servos, because of an alarm. End the readers that asked for that if it cannot be confirmed."""
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
        """Read again once the connection is restored, if it will be."""
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

    def __init__(self, watch: ServoWatch, hz: float | None, alarms: Iterable[Alarm] = ()) -> None:
        """Read `hz` times a second, 0 < hz <= 1000; None: as often as possible."""
        if hz is not None and not is_number(hz):
            raise TypeError(f"hz must be a number of readings per second or None, not {quote(hz)}")
        if hz is not None and not 0 < hz <= MOST_HZ:
            raise ValueError(f"hz must be above 0 and at most {MOST_HZ:g}, not {quote(hz)}")
        self._hz = hz
        self._alarms = tuple(alarms)
        super().__init__(watch)

    def __repr__(self) -> str:
        """Return rate and state, such as `<ServoReadings at 50 Hz, reading>`."""
        state = "ended" if self._reader.ended else "reading" if self._joined else "not begun"
        rate = "as fast as possible" if self._hz is None else f"at {self._hz:g} Hz"
        return f"<ServoReadings {rate}, {state}>"

    def _new_reader(self) -> _RatedReader:
        return _RatedReader(self._hz, self._alarms)
