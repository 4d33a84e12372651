"""Roster: boards that the broker knows, the latest state of each, and messages that cannot be read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import msgspec

from servolink.escaping import escape
from servolink.fleet.topics import MOST_BYTES, OFFLINE, ONLINE, UNREADABLE, BoardNow, LogLine, ServosNow

MOST_BOARDS = 5000
"""Boards that are kept; whoever may write to the broker could invent any number of them."""

_LONGEST_PULSE = 64
_STATE = msgspec.json.Decoder(BoardNow)
_SERVOS = msgspec.json.Decoder(ServosNow)
_LOG = msgspec.json.Decoder(LogLine)


@dataclass(slots=True)
class BoardSeen:
    """Known state of one board."""

    name: str
    is_online: bool = False
    """Whether its bridge is connected with the broker, as the broker says."""
    now: BoardNow | None = None
    """The latest state; None until one was received that can be read."""
    problem: str = ""
    """Why the latest state cannot be read; empty if it can."""
    heard: float = 0.0
    """When it last sent anything, in seconds of the clock of the event loop."""
    frames: int = 0
    """States of the servos that were received."""
    pulse: str | None = None
    """The latest word of its pulse, which shows how old a command is."""
    log: LogLine | None = None
    """The latest line of its log."""
    _servos: bytes = field(default=b"", repr=False)

    @property
    def servos(self) -> ServosNow | None:
        """The latest state of the servos; None if there is none that can be read."""
        try:
            return _SERVOS.decode(self._servos) if self._servos else None
        except UNREADABLE:
            return None

    def take(self, kind: str, payload: bytes, now: float) -> bool:
        """Take a message of this board. Return whether it changed anything but the state of the servos."""
        self.heard = now
        if kind == "servos":
            self._servos = payload  # decoded when it is shown: most frames never are
            self.frames += 1
            return False
        if kind == "pulse":
            self.pulse = payload.decode("ascii", "replace")[:_LONGEST_PULSE]
            return False
        if kind == "available":
            was, self.is_online = self.is_online, payload == ONLINE.encode()
            if was and not self.is_online:
                self.pulse = None  # another program may answer for the board now, and knows no words of this one
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
            self.now, self.problem = _STATE.decode(payload), ""
        except UNREADABLE as error:
            self.problem = f"its state cannot be read: {escape(str(error))[:200]}"

    def _take_log(self, payload: bytes) -> None:
        try:
            self.log = _LOG.decode(payload)
        except UNREADABLE:
            self.problem = "a line of its log cannot be read"


class Roster:
    """All boards that the broker tells of, by name."""

    def __init__(self) -> None:
        """Start without boards."""
        self._boards: dict[str, BoardSeen] = {}
        self.refused = 0
        """Messages of boards beyond the first 5,000, and those that are too long."""

    def get(self, name: str) -> BoardSeen | None:
        """Return what is known of a board; None if nothing is."""
        return self._boards.get(name)

    def __getitem__(self, name: str) -> BoardSeen:
        """Return what is known of a board. Raise KeyError if nothing is."""
        return self._boards[name]

    def __contains__(self, name: object) -> bool:
        """Return whether anything is known of a board."""
        return name in self._boards

    def __iter__(self) -> Iterator[BoardSeen]:
        """Yield the boards in the order of their names."""
        yield from (self._boards[name] for name in sorted(self._boards))

    def __len__(self) -> int:
        """Return how many boards are known, those that are away too."""
        return len(self._boards)

    @property
    def online(self) -> tuple[str, ...]:
        """The names of the boards that are connected, in their order."""
        return tuple(board.name for board in self if board.is_online)

    def hear_pulse(self, name: str, word: str) -> None:
        """Take a word of the pulse of a board, if that is known, which a result has brought."""
        if name in self._boards:
            self._boards[name].pulse = word[:_LONGEST_PULSE]

    def take(self, name: str, kind: str, payload: bytes, now: float) -> BoardSeen | None:
        """Take a message of a board. Return the board if anything but the state of its servos changed."""
        board = self._boards.get(name)
        if board is None:
            if not payload or (kind == "available" and payload != OFFLINE.encode() and payload != ONLINE.encode()):
                return None
            if len(self._boards) >= MOST_BOARDS:
                self.refused += 1
                return None
            board = self._boards[name] = BoardSeen(name)
        if len(payload) > MOST_BYTES:
            self.refused += 1
            return None
        if kind == "available" and not payload:  # somebody has removed the board from the broker
            del self._boards[name]
            return board
        return board if board.take(kind, payload, now) else None
