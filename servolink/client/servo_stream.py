"""ServoStream: set-points of servos at up to 100 Hz, of which the latest counts."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from typing import ClassVar, TypeAlias

from msgspec.structs import replace

from servolink.client.board_servos import ServoController
from servolink.client.captions import CaptionSource, Targets, servo_targets
from servolink.client.session import Session
from servolink.connection import SendPoints
from servolink.errors import MotionRefused, Reason, RequestError, RequestRefused, quote
from servolink.motion import Degrees, MotionPlanner, SetPoints, Ticket, checked_set_points
from servolink.protocol import ExecuteActionRequest
from servolink.support import as_number, is_number, time_with_sleep

CheckPoints: TypeAlias = Callable[[Mapping[int, float]], Awaitable[None]]
"""Raises the error of a set-point that must not be sent."""


class ServoStream:
    """Stream of set-points, made by `Board.stream`. Nothing need be closed: it ends by a gap or a stop.

    Any number of tasks may send set-points: the latest one counts, whoever has given it.
    """

    MOST_HZ: ClassVar[float] = 100.0
    """Most set-points a second: the shortest movement takes 10 ms."""
    MOST_GAP: ClassVar[float] = 10.0
    """Longest time between two set-points, in seconds."""

    def __init__(
        self,
        source: CaptionSource,
        check: CheckPoints,
        send_points: SendPoints,
        hz: float,
        gap: float,
    ) -> None:
        """Send at most `hz` set-points a second with `send_points`, each after `check`.

        Captions are read from `source`.
        """
        check_rate(hz, gap)
        self._source = source
        self._check = check
        self._send_points = send_points
        self._period = 1 / hz
        """Least time from one movement to the next, in seconds."""
        self._gap = gap
        """Longest time from one set-point to the next, in seconds."""
        self._clock = time_with_sleep
        self._turn = asyncio.Lock()
        self._newest = 0
        """Number of the latest set-point; earlier ones are dropped."""
        self._given_at: float | None = None
        """Time of the latest set-point on the clock of deadlines; None before the first."""
        self._due = 0.0
        """Earliest time of the next movement, on the same clock."""
        self._names: tuple[int | str, ...] = ()
        """Ids and captions of the latest set-point, in the order given."""
        self._places: Mapping[int, float] = {}
        """Place of each servo in the latest set-point, by servo id."""

    async def send(self, targets: Targets) -> dict[int, Degrees]:
        """Turn servos toward set-points in degrees, by id or caption, and return the angles sent.

        Waits until the set-point before is sent and its period is over. Return nothing, and send nothing, if a newer
        set-point comes meanwhile. Raise EncodeError for NaN, infinity and raw angles, NotFound for a missing servo, and
        RequestRefused after a gap or a stop, and ConnectionLost after a loss of the connection: these end the stream.
        """
        if self._given_at is not None and self._clock() - self._given_at > self._gap:
            text = f"the stream has ended: no set-point was given for more than {self._gap:g} s; begin another"
            raise RequestRefused(text, reason=Reason.DEADLINE)
        angles = checked_set_points(await self._by_id(targets))
        await self._check(angles)
        self._given_at = given_at = self._clock()
        self._newest += 1
        number = self._newest
        async with self._turn:
            # A set-point that comes during this sleep is newer: this one is dropped then, and not sent late.
            if number == self._newest and (early := self._due - self._clock()) > 0:
                await asyncio.sleep(early)
            if number != self._newest:
                return {}
            try:
                sent = await self._send_points(angles, given_at + self._gap)
            except (RequestError, MotionRefused):
                if number != self._newest:
                    return {}  # late; the sender of the newest set-point gets the error of an ended stream
                raise
            now = self._clock()
            self._due = (self._due if now - self._due < self._period else now) + self._period
        return {servo_id: Degrees(angle) for servo_id, angle in sent.items()}

    async def _by_id(self, targets: Targets) -> dict[int, float]:
        """Return set-points by id. Captions are read once for a stream."""
        if not isinstance(targets, Mapping):
            raise TypeError(f"stream: set-points must map servos to angles, such as {{1: 90}}, not {quote(targets)}")
        names, values = tuple(targets), tuple(targets.values())
        if names != self._names:
            places = await servo_targets(self._source, {name: place for place, name in enumerate(names)})
            self._names, self._places = names, places
        return {servo_id: values[int(place)] for servo_id, place in self._places.items()}


def check_rate(hz: float, gap: float) -> None:
    """Raise TypeError or ValueError for an impossible rate of set-points, or an impossible gap between them."""
    for name, value in (("hz", hz), ("gap", gap)):
        if not is_number(value):
            raise TypeError(f"{name} must be a number, not {quote(value)}")
    if not 0 < hz <= ServoStream.MOST_HZ:
        raise ValueError(f"hz must be above 0 and at most {ServoStream.MOST_HZ:g}, not {quote(hz)}")
    if not 1 / hz < gap <= ServoStream.MOST_GAP:
        raise ValueError(
            f"gap must be above the period of {1 / hz:g} s and at most {ServoStream.MOST_GAP:g} s, not {quote(gap)}"
        )


def point_check(servos: ServoController, planner: MotionPlanner, *, any_angle: bool) -> CheckPoints:
    """Return a function that raises the errors of `move` for set-points, before anything is sent."""

    async def check(angles: Mapping[int, float]) -> None:
        planner.check_turns(angles, lambda servo_id: "degree", any_angle=any_angle)
        await servos.all.ready(angles)

    return check


def stream_on(
    session: Session,
    servos: ServoController,
    hz: float,
    gap: float,
    ticket: Ticket | None,
    *,
    any_angle: bool = False,
) -> ServoStream:
    """Return a stream on the board of `session`, or on the hub that shares it."""
    hz, gap = as_number(hz), as_number(gap)
    check_rate(hz, gap)
    begun, planner = ticket or session.ticket(), servos.planner
    points = SetPoints(planner.limits, hz, planner.interval_unit, any_angle=any_angle)
    # The hub knows where the last target of any program has brought a servo, and limits of the board.
    hub = session.connection.hub
    through_hub = None if hub is None else hub.stream(hz, gap, planner.limits, any_angle=any_angle)
    check_points = point_check(servos, planner, any_angle=any_angle)

    async def send_points(angles: Mapping[int, float], until: float) -> Mapping[int, int]:
        session.check_goes_on("the stream", ExecuteActionRequest(), begun)
        if through_hub is not None:
            return await through_hub(angles, until)
        return await servos.stream(angles, points, replace(begun, until=until))

    async def check(angles: Mapping[int, float]) -> None:
        session.check_goes_on("the stream", ExecuteActionRequest(), begun)
        # The unit is set before the first set-point is given, which would be late on a slow board.
        await servos.units.ensure()
        await check_points(angles)

    return ServoStream(session, check, send_points, hz, gap)
