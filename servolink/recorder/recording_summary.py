"""Summary of a recording in figures: numbers of requests, durations, and problems."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any

from servolink.recorder.channels import CommandDone, Event, Message, PacketSeen, ProblemFound, RecordedServo, ServosRead
from servolink.recorder.reading import GOOD, Entry
from servolink.recorder.round_trips import RoundTrip, RoundTrips, Times, response_name

_MOST_NAMES = 200  # of packets or programs; a made-up file has any number

_FAILURES = {
    "rejected": "commands rejected by the board",
    "refused": "commands refused and not sent",
    "unanswered": "commands not answered",
    "unknown": "commands of unknown outcome",
    "failed": "commands that could not be sent",
}
_REPORTS = {
    "dropped": "gaps in the recording",
    "disk": "troubles with the disk",
    "line": "troubles on the line",
    "hub": "troubles with the hub",
    "servos": "troubles with reading the servos",
    "recorder": "troubles of the recorder",
}


class Requests:
    """Figures of all requests with the same packet."""

    def __init__(self) -> None:
        self.sent = 0
        self.unanswered = 0
        self.times = Times()


class ServoRange:
    """Ranges of the values reported by a servo."""

    def __init__(self, state: RecordedServo) -> None:
        self.caption = state.caption
        self.angles = [state.angle, state.angle]
        self.most_current = state.current_raw
        self.most_temperature = state.temperature_raw
        self.doubts = {state.doubt} - {""}

    def take(self, state: RecordedServo) -> None:
        """Take another report of the servo."""
        self.caption = state.caption or self.caption
        self.angles = [min(self.angles[0], state.angle), max(self.angles[1], state.angle)]
        self.most_current = max(self.most_current, state.current_raw)
        self.most_temperature = max(self.most_temperature, state.temperature_raw)
        self.doubts |= {state.doubt} - {""}


class Summary:
    """Figures of all entries passed through `over`."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.messages: Counter[str] = Counter()
        self.requests: dict[str, Requests] = {}
        self.outcomes: Counter[str] = Counter()
        """Numbers of commands by outcome."""
        self.programs: Counter[str] = Counter()
        """Commands by the name of the program."""
        self.problems: Counter[str] = Counter()
        self.noise = 0
        """Number of bytes outside of frames."""
        self.missed = 0
        """Readings of servos missing in the recording."""
        self.servos: dict[int, ServoRange] = {}
        self._trips = RoundTrips()

    def over(self, entries: Iterable[Entry[Message]]) -> Iterator[Entry[Message]]:
        """Yield `entries` unchanged, and count each."""
        for entry in entries:
            self.take(entry)
            yield entry
        self.finish()

    def take(self, entry: Entry[Message]) -> None:
        """Count a single entry of the recording."""
        self.seconds = max(self.seconds, entry.seconds)
        self.messages[entry.topic] += 1
        message = entry.message
        if isinstance(message, PacketSeen):
            self._packet(entry.seconds, message)
        elif isinstance(message, CommandDone):
            self.outcomes[message.outcome] += 1
            _count(self.programs, message.who or "program")
            if message.outcome not in GOOD:
                self.problems[_FAILURES[message.outcome]] += 1
        elif isinstance(message, ServosRead):
            self._servos(message)
        elif isinstance(message, ProblemFound):
            self.problems[_REPORTS[message.kind]] += 1
        elif isinstance(message, Event) and (message.kind == "alarm" or message.what == "lost"):
            self.problems["alarms" if message.kind == "alarm" else "losses of the connection"] += 1

    def finish(self) -> None:
        """Count requests never answered."""
        for trip in self._trips.finish():
            self._trip(trip)

    def as_dict(self) -> dict[str, Any]:
        """Return the figures as plain values; times in seconds."""
        return {
            "seconds": round(self.seconds, 6),
            "messages": dict(self.messages),
            "requests": {name: _described(each) for name, each in self.requests.items()},
            "outcomes": dict(self.outcomes),
            "programs": dict(self.programs),
            "problems": dict(self.problems),
            "noise_bytes": self.noise,
            "missed_readings": self.missed,
            "servos": {
                servo_id: {
                    "caption": each.caption,
                    "angles": [round(angle, 3) for angle in each.angles],
                    "most_current_raw": each.most_current,
                    "most_temperature_raw": each.most_temperature,
                    "doubts": sorted(each.doubts),
                }
                for servo_id, each in sorted(self.servos.items())
            },
        }

    def _packet(self, seconds: float, message: PacketSeen) -> None:
        if message.noise:
            self.noise += message.noise
            self.problems["noise on the line"] += 1
        elif message.error:
            self.problems["packets that cannot be read"] += 1
        else:
            for trip in self._trips.take(seconds, message):
                self._trip(trip)

    def _trip(self, trip: RoundTrip) -> None:
        if not trip.packet or (trip.packet not in self.requests and len(self.requests) >= _MOST_NAMES):
            return  # button events, and other packets without a request
        requests = self.requests.setdefault(trip.packet, Requests())
        requests.sent += 1
        if trip.took is not None:
            requests.times.add(trip.took)
        elif response_name(trip.packet):
            requests.unanswered += 1
            self.problems["requests not answered"] += 1

    def _servos(self, message: ServosRead) -> None:
        self.missed += message.missed
        for state in message.servos:
            if state.servo_id in self.servos:
                self.servos[state.servo_id].take(state)
            elif len(self.servos) < _MOST_NAMES:
                self.servos[state.servo_id] = ServoRange(state)


def _count(counter: Counter[str], name: str) -> None:
    if name in counter or len(counter) < _MOST_NAMES:
        counter[name] += 1


def _described(requests: Requests) -> dict[str, Any]:
    times = requests.times
    found = {
        "p50": times.percentile(50),
        "p99": times.percentile(99),
        "longest": times.longest if times.count else None,
    }
    return {
        "sent": requests.sent,
        "unanswered": requests.unanswered,
        "seconds": {name: value and round(value, 6) for name, value in found.items()},
    }
