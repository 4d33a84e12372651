"""Story of a recording, line by line: commands with their senders and outcomes, and problems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from servolink.recorder.channels import CommandDone, Event, Message, PacketSeen, ProblemFound, ServosRead
from servolink.recorder.reading import GOOD, Entry, is_problem
from servolink.recorder.round_trips import RoundTrip, RoundTrips, response_name

LONGEST_TEXT = 400
"""Characters of the longest line; the omitted rest is in the file."""
_MOST_VALUES = 16  # values of a list shown in a line
_SILENCE = 1.0  # seconds without a response worth a line
_MISSED = 5  # consecutive missing readings of the servos worth a line


class StoryRow(NamedTuple):
    """Line of the story, with unescaped texts."""

    seconds: float
    who: str
    text: str
    is_problem: bool = False
    key: object = None
    """Consecutive lines with the same key are told as a single line; None for a separate line."""


class Story:
    """Tells entries in order as lines."""

    def __init__(self, *, hz: float = 0.0, packets: bool = False, silences: bool = True) -> None:
        """Report gaps in readings of the servos, expected `hz` times per second.

        `packets` tells every request with the response, not only commands. `silences` tells times without any packet of
        the board, visible only if packets of all kinds and servos are included.
        """
        self.silences: Counter[str] = Counter()
        """Number of silences of the board and of gaps in the readings."""
        self._longest_gap = max(_SILENCE, _MISSED / hz) if hz > 0 else 0.0
        self._packets = packets
        self._silences = silences
        self._trips = RoundTrips()
        self._read_at: float | None = None
        self._waiting_since: float | None = None  # time of the oldest request without a response

    def tell(self, entries: Iterable[Entry[Message]]) -> Iterator[StoryRow]:
        """Yield the lines; consecutive lines with equal keys become a single line."""
        return _in_short(self._lines(entries))

    def _lines(self, entries: Iterable[Entry[Message]]) -> Iterator[StoryRow]:
        last = 0.0
        for entry in entries:
            last = entry.seconds
            message = entry.message
            if isinstance(message, PacketSeen):
                yield from self._packet(entry.seconds, message)
            elif isinstance(message, ServosRead):
                yield from self._reading(entry.seconds)
            elif (line := _line(entry.seconds, message)) is not None:
                yield line
        if self._packets:
            yield from map(_trip_line, self._trips.finish())
        yield from self._silence(last)

    def _packet(self, seconds: float, message: PacketSeen) -> Iterator[StoryRow]:
        if message.noise or message.error:
            yield _damage(seconds, message)
            return
        if message.direction == "received":
            yield from self._silence(seconds)
        elif self._silences and self._waiting_since is None and response_name(message.packet):
            self._waiting_since = seconds
        if self._packets:
            yield from map(_trip_line, self._trips.take(seconds, message))

    def _silence(self, seconds: float) -> Iterator[StoryRow]:
        """Yield a line after a long silence of the board up to now."""
        since, self._waiting_since = self._waiting_since, None
        if since is not None and seconds - since > _SILENCE:
            self.silences["silences of the board"] += 1
            yield StoryRow(seconds, "board", f"nothing came in the last {duration(seconds - since)}", is_problem=True)

    def _reading(self, seconds: float) -> Iterator[StoryRow]:
        before, self._read_at = self._read_at, seconds
        if before is not None and 0 < self._longest_gap < seconds - before:
            self.silences["gaps in the readings"] += 1
            text = f"no reading of the servos in the last {duration(seconds - before)}"
            yield StoryRow(seconds, "board", text, is_problem=True)


def duration(seconds: float) -> str:
    """Return a duration in a notation for people."""
    if seconds >= 1:
        return f"{seconds:.1f} s"
    return f"{seconds * 1000:.0f} ms" if seconds >= 0.01 else f"{seconds * 1000:.1f} ms"


def _line(seconds: float, message: Message) -> StoryRow | None:
    if isinstance(message, CommandDone):
        return _command(seconds, message)
    if isinstance(message, Event):
        return _event(seconds, message)
    if isinstance(message, ProblemFound):
        count = f" ({message.count} messages of {message.channel} are missing)" if message.count else ""
        return StoryRow(seconds, "recorder", f"{message.kind}: {_cut(message.text)}{count}", is_problem=True)
    return None  # bytes: the packets tell the meaning


_OUTCOMES = {
    "answered": "answered in {time}",
    "rejected": "REJECTED by the board in {time}",
    "sent": "sent",
    "refused": "REFUSED, not sent",
    "unanswered": "NOT ANSWERED within {time}",
    "unknown": "OUTCOME UNKNOWN after {time}: the board may have obeyed or not",
    "failed": "FAILED, not sent",
}


def _command(seconds: float, message: CommandDone) -> StoryRow:
    outcome = _OUTCOMES[message.outcome].format(time=duration(message.seconds))
    reason = f": {message.reason}" if message.reason else ""
    if message.lease and message.lease not in (message.who, message.session):
        reason += f" (the lease had {message.lease})"
    is_bad = message.outcome not in GOOD
    text = f"{asked(message.packet, message.fields)}, {outcome}{_cut(reason)}"
    key = None if is_bad else (message.who, message.session, message.packet)
    return StoryRow(seconds, message.who or "program", text, is_problem=is_bad, key=key)


def _event(seconds: float, message: Event) -> StoryRow:
    if message.kind == "button":
        return StoryRow(seconds, "board", f"button {message.button_id} {message.what}")
    kind = "" if message.kind == message.what else f"{message.kind} "
    text = _cut(f"{kind}{message.what}{': ' if message.text else ''}{message.text}")
    return StoryRow(seconds, message.who or message.kind, text, is_problem=is_problem(message))


def _damage(seconds: float, message: PacketSeen) -> StoryRow:
    who = "board" if message.direction == "received" else "program"
    if message.error:
        name = message.packet or f"packet {message.packet_id}"
        return StoryRow(seconds, who, f"{name} cannot be read: {_cut(message.error)}", is_problem=True)
    text = f"{message.noise} bytes of noise: {message.data[:16].hex(' ')}"
    return StoryRow(seconds, who, text, is_problem=True, key=(who, "noise"))


def _trip_line(trip: RoundTrip) -> StoryRow:
    request = asked(trip.packet, trip.fields)
    if trip.response is None:
        is_bad = response_name(trip.packet) is not None
        return StoryRow(trip.seconds, "line", f"{request}, {'NOT ANSWERED' if is_bad else 'sent'}", is_problem=is_bad)
    if not trip.packet:
        return StoryRow(trip.seconds, "line", f"{asked(trip.response, trip.answer)}, without a request")
    answer = asked(trip.response, trip.answer).partition(" ")[2]
    took = duration(trip.took or 0.0)
    text = f"{request}, answered in {took}{': ' if answer else ''}{answer}"
    return StoryRow(trip.seconds, "line", _cut(text), key=("line", trip.packet))


def asked(packet: str, fields: Mapping[str, Any]) -> str:
    """Return a packet in a few words."""
    name = packet.removesuffix("Request").removesuffix("Response")
    return _cut(" ".join([name, *(_field(key, value) for key, value in fields.items())]))


def _field(name: str, value: Any) -> str:
    if not isinstance(value, (list, tuple)):
        return f"{name}={value!r}" if isinstance(value, str) else f"{name}={value}"
    if name == "steps" and (steps := _steps(value)):
        return steps
    if value and all(isinstance(one, dict) for one in value):
        return f"{name}: {len(value)}"
    return (
        f"{name}={','.join(str(one)[:40] for one in value[:_MOST_VALUES])}{_more(value)}" if value else f"{name}=none"
    )


def _steps(steps: Sequence[Any]) -> str:
    """Return the steps of a movement, with a common time given once; empty for any other list."""
    try:
        parts = [(f"{int(step['servo_id'])}={int(step['degree'])}", int(step["interval"]) / 100) for step in steps]
    except (TypeError, KeyError, ValueError):
        return ""
    times = {time for _, time in parts}
    shown = parts[:_MOST_VALUES]
    if len(times) > 1:
        return f"{', '.join(f'{target} in {duration(time)}' for target, time in shown)}{_more(steps)}"
    return f"{' '.join(target for target, _ in shown)}{_more(steps)} in {duration(times.pop())}" if times else ""


def _more(values: Sequence[Any]) -> str:
    left = len(values) - _MOST_VALUES
    return f" and {left} more" if left > 0 else ""


def _cut(text: str) -> str:
    return text if len(text) <= LONGEST_TEXT else f"{text[: LONGEST_TEXT - 3]}..."


def _in_short(lines: Iterable[StoryRow]) -> Iterator[StoryRow]:
    """Yield `lines`; of three or more consecutive lines with the same key, only the first and a count of the rest."""
    row: list[StoryRow] = []
    count = 0
    for line in lines:
        if row and line.key is not None and line.key == row[0].key:
            count += 1
            row = [row[0], line]
            continue
        yield from _row(row, count)
        row, count = [line], 1
    yield from _row(row, count)


def _row(row: list[StoryRow], count: int) -> Iterator[StoryRow]:
    if count <= 2:
        yield from row
    else:
        first, last = row
        yield first
        text = f"{count - 1} more like it, until {last.seconds:.3f} s"
        yield StoryRow(last.seconds, first.who, text, is_problem=first.is_problem)
