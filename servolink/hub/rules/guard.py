"""Guard: sees a servo that is stalled, or grows too hot, in the readings of a board. No clock, no board.

| state of a servo | meaning | left |
|---|---|---|
| unwatched | no motion is commanded, and none was for a second | with a motion |
| watched | a motion is commanded, or was until a second ago | with a suspect reading; with time |
| suspect | it stands still far behind its course, held and started | stalled, if it draws more too; else watched |
| stalled | told once | unwatched, by the stop; watched, with another reading |

A person who turns a held servo has commanded no motion, and stalls nothing. Currents are compared with quantiles of the
servo's own: any unit, zero and scale will do, as long as more is more.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from statistics import linear_regression, median

from msgspec import Struct

from servolink.boards import ServoNormal
from servolink.client import Alarm, AlarmWatch, Lasting, Servo
from servolink.motion import ServoWay

AFTERWARDS = 1.0
"""Seconds after a motion in which the servo is still watched."""
STALLED = 0.2
"""Seconds for which a servo that draws more than its normal must be suspect."""
STALLED_BY_LAG = 1.0
"""Seconds for which a servo must be suspect whose normal current is unknown, or says nothing."""
LEAST_LAG = 5
"""Degrees behind the course that never count as far, whatever a servo's normal is."""
EASED = 2
"""Most degrees by which a stalled servo is eased off."""
AHEAD = 60.0
"""Seconds by which a rising temperature is extrapolated."""

_LATE = 0.1  # seconds by which a reading, or the start of a servo, may be late
_STILL = 2  # degrees by which the readings of a servo that stands still differ
_PUSHED_BACK = 4  # degrees by which what stops a servo pushes it back before both stand still
_FEWEST_SUSPECT = 3  # readings: two may be of one stall of the line
_FEWEST, _MOST = 20, 500  # readings for a normal
_LONGEST_PAUSE = 1.5  # seconds between two readings, beyond which nothing was learnt meanwhile
_LONGEST_TREND, _SHORTEST_TREND = 60.0, 20.0  # seconds of temperatures
_TREND_LASTS = 3.0  # seconds for which a forecast must hold: one reading may be wrong


class Normal(Struct):
    """Currents and lags of a servo while nothing was suspect, learnt on the go; raw units, and degrees."""

    seconds: float
    """Seconds of learning."""
    latest: float
    """Time of the latest reading."""
    moving: deque[int]
    resting: deque[int]
    lags: deque[int]
    """Degrees between the servo and its last target, at rest."""

    @classmethod
    def new(cls, now: float) -> Normal:
        """Return the normal of a servo without readings."""
        return cls.made(0.0, now, (), (), ())

    @classmethod
    def made(cls, seconds: float, latest: float, *readings: Iterable[int]) -> Normal:
        """Return the normal of readings (moving, resting, lags)."""
        return cls(seconds, latest, *(deque(each, _MOST) for each in readings))

    @property
    def is_known(self) -> bool:
        """Whether currents say something: enough moving readings, and not all the same."""
        return len(self.moving) >= _FEWEST and len({*self.moving, *self.resting}) > 1

    @property
    def most_current(self) -> tuple[int, bool]:
        """The current below which nine of ten readings are, and whether it is the highest that the servo shows."""
        level = max(most for each in (self.moving, self.resting) if (most := ServoNormal.most(each)) is not None)
        return level, level >= max(self.moving)

    @property
    def most_lag(self) -> float:
        """The lag in degrees beyond which a servo is far behind its course."""
        most = ServoNormal.most(self.lags) if len(self.lags) >= _FEWEST else None
        return LEAST_LAG if most is None else max(LEAST_LAG, 1.5 * most + 2)


class Stall(Struct, frozen=True):
    """Stalled servo, with the numbers that say so."""

    servo_id: int
    angle: int
    target: int
    lag: int
    """Degrees behind the course."""
    seconds: float
    """Seconds since the servo was first suspect."""
    current: float
    normal: int | None
    """Current below which nine of ten of its readings are; None if the lag alone says that it is stalled."""
    learnt: float
    """Seconds in which the normal was learnt."""
    reached: int | None = None
    """Angle of the servo before its latest turn; None for an unknown one, and for one in the direction of the push."""

    def eased(self, angle: int) -> int | None:
        """Return the angle to ease the servo off to from `angle`; None if it has moved, or without a way back."""
        if self.reached is None or abs(angle - self.angle) > EASED or (way := self.reached - angle) == 0:
            return None
        return angle + min(max(way, -EASED), EASED) if (way > 0) == (self.reached > self.angle) else None

    def __str__(self) -> str:
        """Return servo and numbers, such as `servo 3 is stalled: it stands at 41 degrees, ...`."""
        text = (
            f"servo {self.servo_id} is stalled: for {self.seconds:.1f} s it has stood at {self.angle} degrees, "
            f"{self.lag} behind its course to {self.target}"
        )
        if self.normal is None:
            return f"{text}; its normal current is not known, so the lag alone says this"
        return f"{text}, and draws {self.current:.0f}, normally at most {self.normal} (learnt over {self.learnt:.0f} s)"


class _Suspect(Struct):
    since: float
    angle: int
    """Where it stands."""
    sign: int
    """Sign of the way to its course, 1 or -1."""
    currents: list[int]


class Guard:
    """Watches over servos. Readings are passed in with their time, in seconds of any clock that does not jump."""

    def __init__(self, hottest: int | None = None) -> None:
        """Warn before a raw temperature passes `hottest`; None for no warning."""
        self._hot = None if hottest is None else Alarm("temperature_raw", ">", hottest)
        self._alarms = AlarmWatch(() if self._hot is None else (self._hot,))
        self._trends: dict[int, deque[tuple[float, int]]] = {}
        self._heating = Lasting[int]()
        self._stalling = Lasting[int]()
        self._suspects: dict[int, _Suspect] = {}
        self._stands: dict[int, int] = {}  # where each servo has stood still, or moved last
        self._reached: dict[int, int] = {}  # the reading of each servo before it moved there
        self._normals: dict[int, Normal] = {}
        self.learnt = 0
        """Number of learnt readings."""

    def recall(self, kept: Mapping[int, ServoNormal], now: float, at: datetime) -> None:
        """Take over the normals of earlier runs; the time `now` is the moment `at`."""
        for servo_id, each in kept.items():
            latest = now - max(0.0, (at - each.learnt_at).total_seconds())
            self._normals[servo_id] = Normal.made(each.seconds, latest, each.moving, each.resting, each.lags)

    def kept(self, now: float, at: datetime) -> dict[int, ServoNormal]:
        """Return the normals for later runs; the time `now` is the moment `at`."""
        return {
            servo_id: ServoNormal.of(
                each.moving,
                each.resting,
                each.lags,
                seconds=each.seconds,
                learnt_at=at - timedelta(seconds=now - each.latest),
            )
            for servo_id, each in self._normals.items()
            if each.moving or each.resting
        }

    def normal(self, servo_id: int) -> Normal | None:
        """Return the normal of a servo; None before its first reading."""
        return self._normals.get(servo_id)

    def stalls(self, servos: Iterable[Servo], way_of: Callable[[int], ServoWay | None], now: float) -> Iterator[Stall]:
        """Take a reading; yield servos that have become stalled. `way_of` returns the latest movement of a servo."""
        for servo in servos:
            stall = None if servo.doubt else self._look(servo, way_of(servo.servo_id), now)
            if stall is not None:
                yield stall

    def warnings(self, servos: Sequence[Servo], now: float) -> Iterator[str]:
        """Take a reading; yield a text for each servo that has become too hot, or will be by its trend."""
        if self._hot is None:
            return
        yield from map(str, self._alarms.check(servos, now))
        for servo in servos:
            if text := self._heat(self._hot, servo, now):
                yield text

    def _look(self, servo: Servo, way: ServoWay | None, now: float) -> Stall | None:
        """Take the reading of a servo, and learn from it if nothing is suspect."""
        servo_id, angle = servo.servo_id, int(servo.angle)
        if (normal := self._normals.get(servo_id)) is None:
            normal = self._normals[servo_id] = Normal.new(now)
        is_still = abs(angle - self._stands.setdefault(servo_id, angle)) <= _STILL
        if not is_still:
            self._reached[servo_id], self._stands[servo_id] = self._stands[servo_id], angle
        is_commanded = way is not None and way.began <= now <= way.began + way.seconds + AFTERWARDS
        lag = 0 if way is None else _lag(way, angle, now)
        if (suspect := self._suspects.get(servo_id)) is not None:
            is_still = -_PUSHED_BACK <= (angle - suspect.angle) * suspect.sign <= _STILL
        is_suspect = servo.is_start and servo.is_hold and is_commanded and is_still and lag > normal.most_lag
        if not is_suspect or way is None:
            self._suspects.pop(servo_id, None)
            self._stalling.is_raised(servo_id, now, holds=False, seconds=0)
            self._learn(
                normal, servo, way if servo.is_hold and lag <= normal.most_lag else None, now, is_still=is_still
            )
            return None
        if suspect is None:
            suspect = _Suspect(now, self._stands[servo_id], 1 if way.at(now) > angle else -1, [])
            self._suspects[servo_id] = suspect
        suspect.currents.append(servo.current)
        current, level = median(suspect.currents), None
        draws_more = len(suspect.currents) >= _FEWEST_SUSPECT
        if normal.is_known:
            level, is_highest = normal.most_current
            draws_more = draws_more and (current > level or (is_highest and current == level))
        seconds = STALLED_BY_LAG if level is None else STALLED
        if now - suspect.since < seconds or not self._stalling.is_raised(servo_id, now, holds=draws_more, seconds=0):
            return None
        reached = self._reached.get(servo_id)
        if reached is not None and (angle - reached) * suspect.sign <= 0:
            reached = None
        return Stall(servo_id, angle, way.target, lag, now - suspect.since, current, level, normal.seconds, reached)

    def _learn(self, normal: Normal, servo: Servo, way: ServoWay | None, now: float, *, is_still: bool) -> None:
        """Add the reading of a servo that is not suspect to its normal."""
        if way is None or now < way.began:
            return
        over = now - way.began - way.seconds
        if over <= 0 and not is_still:
            normal.moving.append(servo.current)
        elif over > AFTERWARDS and servo.is_start:
            normal.resting.append(servo.current)
            normal.lags.append(abs(way.target - int(servo.angle)))
        else:
            return
        normal.seconds += min(now - normal.latest, _LONGEST_PAUSE)
        normal.latest = now
        self.learnt += 1

    def _heat(self, hot: Alarm, servo: Servo, now: float) -> str:
        """Return a text about a temperature that rises too high; empty for none, or if it was told."""
        servo_id, value = servo.servo_id, servo.temperature
        trend = self._trends.setdefault(servo_id, deque())
        if not trend or now - trend[-1][0] >= 1.0:
            trend.append((now, value))
        while trend[0][0] < now - _LONGEST_TREND:
            trend.popleft()
        seconds = math.inf
        if now - trend[0][0] >= _SHORTEST_TREND and not hot.is_bad(value):
            slope, offset = linear_regression(*zip(*trend, strict=True))
            seconds = (hot.limit - offset) / slope - now if slope > 0 else seconds
        if not self._heating.is_raised(servo_id, now, holds=seconds <= AHEAD, seconds=_TREND_LASTS):
            return ""
        return f"servo {servo_id}: temperature_raw is {value}, and passes {hot.limit} in {seconds:.0f} s by its trend"


def _lag(way: ServoWay, angle: int, now: float) -> int:
    """Return by how many degrees a servo is away from its course, which is allowed to be a little late."""
    low, high = sorted((way.at(max(way.began, now - _LATE)), way.at(now)))
    return max(round(low - angle), round(angle - high), 0)
