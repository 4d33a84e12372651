"""Roster: boards known to the broker, the latest state of each board, and unreadable messages."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec

from servolink.control import decode
from servolink.errors import escape
from servolink.fleet.topics import MOST_BYTES, OFFLINE, ONLINE, UNREADABLE, BoardNow, LogLine, ServosNow

MOST_BOARDS = 5000
"""Most boards kept; any writer at the broker could invent boards without limit."""
MOST_HELD = 64 * 1024 * 1024
"""Bytes of the latest messages of all boards together; a message beyond them is refused."""

LOW_BATTERY = 20.0
"""Percent below which a board needs help."""

_LONGEST_PULSE = 64
_KEPT = {"state", "servos", "log"}  # kinds of messages that are kept whole
_SERVOS = msgspec.json.Decoder(ServosNow)


@dataclass(slots=True)
class BoardSeen:
    """Known state of a board."""

    name: str
    is_online: bool = False
    """Whether the board's bridge is connected, as reported by the broker."""
    now: BoardNow | None = None
    """Latest readable state; None before the first."""
    problem: str = ""
    """Error of reading the latest state; empty for a readable state."""
    heard: float = 0.0
    """Time of the latest message, in seconds of the event loop's clock."""
    frames: int = 0
    """Number of servo states received."""
    pulse: str | None = None
    """Latest word of the board's pulse, which shows the age of a command."""
    log: LogLine | None = None
    """Latest line of the board's log."""
    held: dict[str, int] = field(default_factory=dict)
    """Bytes of the latest message of each kind."""
    _servos: bytes = field(default=b"", repr=False)

    @property
    def servos(self) -> ServosNow | None:
        """Latest state of the servos; None without a readable state."""
        try:
            return _SERVOS.decode(self._servos) if self._servos else None
        except UNREADABLE:
            return None

    @property
    def urgency(self) -> int:
        """Urgency of help: 0 for a lost or unreadable board, 1 for a problem, 2 for none, 3 for an absent board."""
        if not self.is_online:
            return 3
        if self.now is None or self.problem or self.now.connection != "connected":
            return 0
        low = self.now.battery_percent is not None and self.now.battery_percent < LOW_BATTERY
        return 1 if low or self.now.problems else 2

    def take(self, kind: str, payload: bytes, now: float) -> bool:
        """Take a message of this board. Return whether anything but the servo state changed."""
        self.heard = now
        if kind == "servos":
            self._servos = payload  # decoded on display: most frames are never shown
            self.frames += 1
            return False
        if kind == "pulse":
            self.pulse = payload.decode("ascii", "replace")[:_LONGEST_PULSE]
            return False
        if kind == "available":
            was, self.is_online = self.is_online, payload == ONLINE.encode()
            if was and not self.is_online:
                self.pulse = None  # another program may answer for the board now, without the words of this one
            return was != self.is_online
        if kind == "state":
            self._take_state(payload)
        elif kind == "log":
            self._take_log(payload)
        return True

    def _take_state(self, payload: bytes) -> None:
        if not payload:  # how a retained state is removed
            self.now, self.problem = None, ""
            return
        try:
            self.now, self.problem = decode(payload, BoardNow), ""
        except UNREADABLE as error:
            self.problem = f"its state cannot be read: {escape(str(error))[:200]}"

    def _take_log(self, payload: bytes) -> None:
        try:
            self.log = decode(payload, LogLine)
        except UNREADABLE:
            self.problem = "a line of its log cannot be read"


class Roster:
    """All boards reported by the broker, by name."""

    def __init__(self) -> None:
        self._boards: dict[str, BoardSeen] = {}
        self._names: list[str] = []  # kept in order: sorting thousands takes longer than all else for their list
        self._held = 0  # bytes of all latest messages
        self.refused = 0
        """Number of messages of boards beyond the first 5,000, and of messages beyond the size limits."""

    def get(self, name: str) -> BoardSeen | None:
        """Return the state of a board; None for an unknown board."""
        return self._boards.get(name)

    def __getitem__(self, name: str) -> BoardSeen:
        """Return the state of a board. Raise KeyError for an unknown board."""
        return self._boards[name]

    def __contains__(self, name: object) -> bool:
        """Return whether anything is known of a board."""
        return name in self._boards

    def __iter__(self) -> Iterator[BoardSeen]:
        """Yield the boards in the order of their names."""
        yield from [self._boards[name] for name in self._names]

    def __len__(self) -> int:
        """Return the number of known boards, absent boards included."""
        return len(self._boards)

    @property
    def online(self) -> tuple[str, ...]:
        """Names of the connected boards, in order."""
        return tuple(name for name in self._names if self._boards[name].is_online)

    def hear_pulse(self, name: str, word: str) -> None:
        """Take a word of a known board's pulse from a result."""
        if name in self._boards:
            self._boards[name].pulse = word[:_LONGEST_PULSE]

    def take(self, name: str, kind: str, payload: bytes, now: float) -> BoardSeen | None:
        """Take a message of a board. Return the board if anything but the servo state changed."""
        board = self._boards.get(name)
        if board is None:
            if not payload or (kind == "available" and payload != OFFLINE.encode() and payload != ONLINE.encode()):
                return None
            if len(self._boards) >= MOST_BOARDS:
                self.refused += 1
                return None
            board = self._boards[name] = BoardSeen(name)
            insort(self._names, name)
        grown = len(payload) - board.held.get(kind, 0) if kind in _KEPT else 0
        if len(payload) > MOST_BYTES or (grown > 0 and self._held + grown > MOST_HELD):
            self.refused += 1
            return None
        if kind == "available" and not payload:  # somebody has removed the board from the broker
            self._held -= sum(board.held.values())
            del self._boards[name]
            self._names.remove(name)
            return board
        if kind in _KEPT:
            board.held[kind] = len(payload)
            self._held += grown
        return board if board.take(kind, payload, now) else None
