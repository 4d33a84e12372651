"""Feeds of a program: readings of the servos, button events, and the tap of the line."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import cast

from msgspec import Struct

from servolink.client import Board, Servo, ServoReading
from servolink.control import ButtonPressed, ProblemNotice, ServoNow, ServosFrame, TapFrame, TapItem
from servolink.errors import ConnectionLost, RequestTimeout, ServolinkError
from servolink.hub.engine.tap import HubTap
from servolink.hub.hub import Hub
from servolink.hub.method_messages import CREDIT
from servolink.hub.methods.context import OpenBoard
from servolink.hub.rules.courses import Courses
from servolink.motion import Angle, AngleUnit
from servolink.recorder import TOPICS, Backlog
from servolink.support import MIB

Notify = Callable[[Struct], None]

_IDLE = 2.0  # seconds without an acknowledgement until reading of the servos ends
_PAUSE = 0.5  # seconds until the servos are read again after an error
_TAP_EVERY = 0.05  # seconds: a notification for each message would cost the hub more than the message
_MOST_AT_ONCE = 64 * 1024  # bytes of messages in a notification
_TELEMETRY_BYTES, _MOST_BYTES = MIB, 8 * MIB
_TAP_DROPS = "the program that records reads too slowly"


class Feed(ABC):
    """Background task of a feed, until `end`."""

    def __init__(self, open_board: OpenBoard, notify: Notify) -> None:
        """Read the board of `open_board`, and pass notifications to `notify`."""
        self._open_board = open_board
        self._notify = notify
        self._task: asyncio.Task[None] | None = None
        self._ending = set[asyncio.Task[None]]()
        self._changing = asyncio.Lock()

    async def _begin(self) -> None:
        """Start again, and return when reading has begun. Raise the error of the reading."""
        async with self._changing:
            await self._end()
            loop = asyncio.get_running_loop()
            ready: asyncio.Future[None] = loop.create_future()
            self._task = loop.create_task(self._run(ready))
            await ready

    async def close(self) -> None:
        """End the background task of the feed."""
        async with self._changing:
            await self._end()

    async def _end(self) -> None:
        self._cancel()
        if self._ending:
            await asyncio.wait(self._ending)

    def _cancel(self) -> None:
        """Send no further notifications. The task ends later: leaving may take a request to the board."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            self._ending.add(task)
            task.add_done_callback(self._ending.discard)

    async def _run(self, ready: asyncio.Future[None]) -> None:
        """Read until the hub ends; after an error, say so once and read again."""
        told = ""
        while True:
            board = await self._open_board()
            try:
                await self._read(board, ready)
            except ServolinkError as error:
                if not ready.done():
                    ready.set_exception(error)
                    return
                if board.connection.ended is not None:  # of a session in this process: the hub has ended
                    return
                # Why nothing is answered, the notifications `connection` and `hold` say.
                if str(error) != told and not isinstance(error, RequestTimeout | ConnectionLost):
                    told = str(error)
                    self._notify(ProblemNotice(f"{told}; trying again"))
                await asyncio.sleep(_PAUSE)
            else:
                return

    @abstractmethod
    async def _read(self, board: Board, ready: asyncio.Future[None]) -> None:
        """Read, and resolve `ready` when the first item can come."""


class ServosFeed(Feed):
    """Feed of the latest reading after each acknowledgement, so that no program is flooded."""

    def __init__(self, open_board: OpenBoard, notify: Notify, is_paused: Callable[[], bool], courses: Courses) -> None:
        super().__init__(open_board, notify)
        self._is_paused = is_paused
        self._courses = courses
        self._hz = 0.0
        self._changed_only = False
        self._sent = 0
        self._acknowledged = 0
        self._last: dict[int, ServoNow] = {}
        self._room = asyncio.Event()

    async def watch(self, hz: float, *, changed_only: bool) -> None:
        """Send at most `hz` readings per second from now on."""
        self._hz, self._changed_only = hz, changed_only
        self._sent = self._acknowledged = 0
        self._last = {}
        await self._begin()

    def acknowledge(self, number: int) -> None:
        """Count a frame drawn by the program."""
        self._acknowledged = max(self._acknowledged, min(number, self._sent))
        self._room.set()

    def resume(self) -> None:
        """Look again whether there is room: the program reads again."""
        self._room.set()

    async def _read(self, board: Board, ready: asyncio.Future[None]) -> None:
        while not await self._read_until_idle(board, ready):
            await self._until_room()  # without reading: a frozen page costs the board nothing

    async def _read_until_idle(self, board: Board, ready: asyncio.Future[None]) -> bool:
        """Read until the program has acknowledged nothing for a while; return whether the readings have ended."""
        async with board.watch(self._hz) as readings:
            _resolve(ready)
            await self._until_room()
            # The iterator keeps only the latest reading, so the reading is fresh however long there was no room.
            async for reading in readings:
                self._send(reading)
                try:
                    async with asyncio.timeout(_IDLE):
                        await self._until_room()
                except TimeoutError:
                    return False
        return True

    async def _until_room(self) -> None:
        while self._sent - self._acknowledged >= CREDIT or self._is_paused():
            self._room.clear()
            await self._room.wait()

    def _send(self, reading: ServoReading) -> None:
        self._sent += 1
        shown = _latest.of(reading.servos, self._courses, reading.seconds)
        if self._changed_only:
            last, self._last = self._last, {servo.servo_id: servo for servo in shown}
            shown = tuple(servo for servo in shown if last.get(servo.servo_id) != servo)
        self._notify(ServosFrame(self._sent, round(reading.seconds, 6), shown, reading.missed))


class _Latest:
    """Latest servos in the form of the control interface: all watching programs get the same."""

    def __init__(self) -> None:
        self._latest: tuple[tuple[Servo, ...], tuple[ServoNow, ...]] = ((), ())

    def of(self, servos: tuple[Servo, ...], courses: Courses, now: float) -> tuple[ServoNow, ...]:
        of, shown = self._latest
        if of is not servos:
            shown = servos_now(servos, courses, now)
            self._latest = servos, shown
        return shown


_latest = _Latest()


class ButtonsFeed(Feed):
    """Sender of each button event to the program."""

    async def subscribe(self) -> None:
        """Begin to send events; return when the board sends them. Raise Rejected if the board refuses."""
        await self._begin()

    async def unsubscribe(self) -> None:
        """Send no further events. The board is asked later, as its response may wait for the end of exclusive use."""
        async with self._changing:
            self._cancel()

    async def _read(self, board: Board, ready: asyncio.Future[None]) -> None:
        async with board.button_events() as events:
            _resolve(ready)
            async for event in events:
                self._notify(ButtonPressed(event.button_id, event.event, event.kind))


class TapFeed:
    """Feed of notifications `tap`. A program that reads too slowly loses some, and is notified."""

    def __init__(self, hub: Hub, notify: Notify, is_paused: Callable[[], bool]) -> None:
        """Send nothing while `is_paused()`, but keep some MiB."""
        self._hub = hub
        self._notify = notify
        self._is_paused = is_paused
        self._loop = asyncio.get_running_loop()
        self._tap: HubTap | None = None
        self._backlog = Backlog(_TELEMETRY_BYTES, _MOST_BYTES, why=_TAP_DROPS)
        self._timer: asyncio.TimerHandle | None = None

    def now(self) -> float:
        """Return the present time, as the messages have it."""
        return self._loop.time()

    def start(self, *, wire_only: bool) -> None:
        """Send notifications `tap` from now on."""
        self.stop()
        self._tap = HubTap(self._hub, self._backlog.put, wire_only=wire_only)
        self._timer = self._loop.call_later(_TAP_EVERY, self._flush)

    def stop(self) -> None:
        """Send the remaining messages and end the tap."""
        if self._tap is not None:
            self._tap.close()
            self._tap = None
            self._backlog.tell_dropped(self.now())
            self._send_waiting()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _flush(self) -> None:
        self._timer = self._loop.call_later(_TAP_EVERY, self._flush)
        self._send_waiting()

    def _send_waiting(self) -> None:
        backlog = self._backlog
        while backlog.size and not self._is_paused():
            items = list[TapItem]()
            end = max(0, backlog.size - _MOST_AT_ONCE)
            while backlog.size > end and (timed := backlog.take()) is not None:
                items.append(TapItem(timed.seconds, TOPICS[type(timed.message)], timed.message))
            self._notify(TapFrame(tuple(items)))


def _resolve(ready: asyncio.Future[None]) -> None:
    if not ready.done():
        ready.set_result(None)


def servos_now(servos: Iterable[Servo], courses: Courses, now: float) -> tuple[ServoNow, ...]:
    """Return servos as read at `now`, in the form of the control interface."""
    return tuple(_servo_now(servo, courses, now) for servo in servos)


def _servo_now(servo: Servo, courses: Courses, now: float) -> ServoNow:
    angle, unit = int(servo.angle), cast("AngleUnit", servo.angle.unit) if isinstance(servo.angle, Angle) else None
    return ServoNow(
        servo.servo_id,
        angle,
        unit,
        servo.current,
        servo.temperature,
        servo.servo_type,
        servo.is_start,
        servo.is_hold,
        courses.lag(servo.servo_id, angle, now) if unit == "degree" else None,
        servo.doubt,
    )
