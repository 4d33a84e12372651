"""Picture of `servolink watch`: state of a watched board, as rows for the width of a terminal."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from textwrap import wrap

from servolink.cli.screen.live import Line
from servolink.cli.screen.output import angle_text, cut, sized, text_width
from servolink.client import Alarm, ButtonEvent, RaisedAlarm, Servo, ServoReading
from servolink.connection import Stats
from servolink.errors import escape
from servolink.motion import Degrees, MotionLimits

SCALE = (-180.0, 180.0)
"""Degrees between which a servo without limits is drawn; the protocol's document gives no range."""

_COLUMNS = 37  # columns for all parts of a row except label and bar
_BETWEEN = 2  # of them, beside a bar
_ANGLE, _LEAST_ANGLE = 8, 5
_LEAST_BAR, _GOOD_BAR, _WIDEST_BAR = 8, 13, 61
_LEAST_LABEL, _WIDEST_LABEL = 5, 20
_STYLES = {"ready": "", "stopped": "cyan", "released": "yellow"}
_BAD = "bold red"
_SHOWN_ALARMS = 3
_FULL = 100  # percent


@dataclass
class Watched:
    """State of a watched board."""

    name: str
    hz: float
    stats: Stats
    alarms: Sequence[Alarm] = ()
    servo_ids: frozenset[int] = frozenset()
    """Of the servos to show; empty for all."""
    limits: MotionLimits = field(default_factory=MotionLimits)
    captions: Mapping[int, str] = field(default_factory=dict)
    begun: float = 0.0
    """When it began, on the clock of the event loop."""
    state: str = "connected"
    battery: float | None = None
    """Percent; None if the board does not say."""
    reading: ServoReading | None = None
    """The latest one."""
    seconds: float = 0.0
    """From the beginning to the latest reading."""
    missed: int = 0
    buttons: deque[tuple[float, ButtonEvent]] = field(default_factory=lambda: deque(maxlen=64))
    """The latest button events, with their seconds."""
    new_buttons: list[tuple[float, ButtonEvent]] = field(default_factory=list)
    """Button events since the reading before."""
    raised: deque[tuple[float, RaisedAlarm]] = field(default_factory=lambda: deque(maxlen=_SHOWN_ALARMS))
    """The latest alarms, with their seconds."""

    def take(self, reading: ServoReading) -> None:
        """Make `reading` the latest one."""
        self.reading = reading
        self.seconds = reading.seconds - self.begun
        self.missed += reading.missed
        self.raised.extend((self.seconds, each) for each in reading.alarms)

    def press(self, event: ButtonEvent, now: float) -> None:
        """Make `event` the latest button event."""
        self.buttons.append((now - self.begun, event))
        self.new_buttons.append(self.buttons[-1])

    @property
    def servos(self) -> list[Servo]:
        """The servos to show."""
        servos = self.reading.servos if self.reading else ()
        return [servo for servo in servos if not self.servo_ids or servo.servo_id in self.servo_ids]

    @property
    def skipped_bytes(self) -> int:
        """Bytes of noise on the line."""
        return self.stats.noise


def picture(watched: Watched, width: int, height: int, *, blocks: bool = True) -> list[Line]:
    """Return at most `height` lines of at most `width` columns; without `blocks`, bars are made of ASCII."""
    foot = [*_alarms(watched, width), *wrapped(f"{LEGEND}; q quits", width, "dim")]
    return picture_of_servos(watched, [*_head(watched, width)], foot, (width, height), blocks=blocks)


def picture_of_servos(
    watched: Watched, head: Sequence[Line], foot: Sequence[Line], size: tuple[int, int], *, blocks: bool
) -> list[Line]:
    """Return the servos as lines between `head` and `foot`, for a width and a height (`size`)."""
    (width, height), servos = size, watched.servos
    head, foot = [*head, ("", "")], [*foot]
    room = max(1, height - len(head) - len(foot) - 1)
    if len(servos) > room:
        room = max(1, room - 1)
        left = f"{len(servos) - room} more: a larger terminal shows them"
        foot.insert(0, (left, "dim"))
    table = _ServoTable(watched, width, blocks=blocks)
    lines = [*head, (table.header, "bold"), *map(table.line, servos[:room]), *foot]
    return [(cut(text, width), style) for text, style in lines[:height]]


LEGEND = f"bars: ±{SCALE[1]:g}° or the servo's limits; numbers are raw"


def wrapped(text: str, width: int, style: str = "") -> Iterator[Line]:
    """Yield `text` in lines of `width` columns."""
    yield from ((line, style) for line in wrap(text, width))


def _head(watched: Watched, width: int) -> Iterator[Line]:
    """Yield connection and battery, what the line lost, and button events."""
    battery = "unknown" if watched.battery is None else f"{watched.battery:g} %"
    battery += " (implausible)" if (watched.battery or 0) > _FULL else ""
    line = f"{watched.state}  {watched.seconds:.1f} s  battery {battery}  {escape(watched.name)}"
    yield from islice(wrapped(line, width, "bold green" if watched.state == "connected" else _BAD), 2)
    stats = watched.stats
    counters = (
        f"{watched.hz:g} Hz, {watched.missed} missed; noise {watched.skipped_bytes} bytes; "
        f"{stats.late_responses} late, {stats.retries} repeated, {stats.reconnects} reconnects"
    )
    yield from wrapped(counters, width)
    latest = [f"{event.button_id} {event.kind} ({seconds:.1f} s)" for seconds, event in reversed(watched.buttons)]
    yield f"buttons: {', '.join(latest[:6]) or 'none'}", ""


def _alarms(watched: Watched, width: int) -> Iterator[Line]:
    for seconds, raised in watched.raised:
        yield from wrapped(f"{seconds:.1f} s  {raised}", width, _BAD)


class _ServoTable:
    """The lines of the servos; a narrow terminal has shorter bars, then none, then no captions."""

    def __init__(self, watched: Watched, width: int, *, blocks: bool) -> None:
        self._watched = watched
        self._full, self._zero, self._empty = "█│·" if blocks else "#|."
        label = max((text_width(self._label(servo)) for servo in watched.servos), default=0)
        room = width - _COLUMNS
        self._label_width = max(_LEAST_LABEL, min(label, _WIDEST_LABEL, room - _GOOD_BAR))
        bar = min(_WIDEST_BAR, (room - self._label_width - 1) // 2 * 2 + 1)  # odd: 0 is in the middle
        self._bar_width = bar if bar >= _LEAST_BAR else 0
        self._angle_width = _ANGLE
        if not self._bar_width:
            angle = max((len(angle_text(servo.angle)) for servo in watched.servos), default=0)
            self._angle_width = max(_LEAST_ANGLE, angle)
            room += _BETWEEN + _ANGLE - self._angle_width
            self._label_width = max(_LEAST_LABEL, min(label, _WIDEST_LABEL, room))

    @property
    def header(self) -> str:
        """The names of the columns."""
        return self._row("servo", "angle", "", "current", "temp.", "state")

    def line(self, servo: Servo) -> Line:
        """Return the line of a servo."""
        row = self._row(
            self._label(servo),
            angle_text(servo.angle),
            self._bar(servo),
            str(servo.current),
            str(servo.temperature),
            "doubtful" if servo.doubt else servo.state,
        )
        is_bad = any(alarm.is_bad(alarm.value_of(servo)) for alarm in self._watched.alarms)
        return row, _BAD if is_bad or servo.doubt else _STYLES[servo.state]

    def _row(self, label: str, angle: str, bar: str, current: str, temperature: str, state: str) -> str:
        drawn = f"{bar:{self._bar_width}}  " if self._bar_width else ""
        named = f"{sized(label, self._label_width)} {angle:>{self._angle_width}}"
        return f"{named}  {drawn}{current:>7}  {temperature:>5}  {state:8}"

    def _label(self, servo: Servo) -> str:
        caption = escape(self._watched.captions.get(servo.servo_id) or "")
        return f"{servo.servo_id:3} {caption}".rstrip()

    def _bar(self, servo: Servo) -> str:
        """Return a bar from 0 degrees, or from the end nearest to 0 degrees, to the angle."""
        if not self._bar_width or not isinstance(servo.angle, Degrees):
            return ""
        low, high = self._watched.limits.of(servo.servo_id) or SCALE
        if low >= high:
            low, high = SCALE
        last = self._bar_width - 1

        def place(degrees: float) -> int:
            return round((min(max(degrees, low), high) - low) / (high - low) * last)

        angle = int(servo.angle)
        start, end = sorted((place(0), place(angle)))
        cells = [self._full if start <= at <= end else self._empty for at in range(self._bar_width)]
        cells[place(0)] = self._zero
        if angle < low:
            cells[0] = "<"
        elif angle > high:
            cells[last] = ">"
        return "".join(cells)
