"""Plays the board's side of a recording, and checks that the program says what it said then."""

from __future__ import annotations

import asyncio
import json
import math
from bisect import bisect_right
from collections import deque
from pathlib import Path
from typing import NamedTuple

from servolink.errors import ConnectionLost, OpenError
from servolink.printable import printable
from servolink.reading import read_file
from servolink.transports.address import Address
from servolink.transports.base import Receiver


class _Line(NamedTuple):
    number: int
    seconds: float
    what: str
    text: str
    data: bytes


class ReplayTransport:
    """A board that answers from a recording.

    What was received comes once everything that was sent before it has been sent again, as much later as then,
    or at once without `timing`. How sends are cut does not matter; a differing byte ends the connection.
    """

    def __init__(self, path: str | Path, *, timing: bool = True, url: str = "") -> None:
        """Play the recording at `path`."""
        self._path = Path(path)
        self._timing = timing
        self._url = url or f"replay://{path}"
        self._receiver: Receiver | None = None
        self._ended = False
        self._cause: ConnectionLost | None = None
        self._sends: list[_Line] = []
        self._ends: list[int] = []  # of each send, in all that is to be sent
        self._expected = bytearray()
        self._said = 0  # bytes
        self._done = 0  # sends
        self._coming: deque[tuple[int, _Line]] = deque()  # what the board said, each after so many sends
        self._shift = 0.0  # from the recording's time to the loop's
        self._timer: asyncio.Handle | None = None

    @property
    def url(self) -> str:
        """The address of the recording."""
        return self._url

    async def open(self, receiver: Receiver) -> None:
        """Read the recording; OpenError names the line that is none."""
        if self._receiver is not None or self._ended:
            raise OpenError(f"{printable(self.url)}: a transport is opened once; make another")
        self._receiver = receiver
        for line in _read(self._path):
            if line.what == "sent":
                self._sends.append(line)
                self._expected += line.data
                self._ends.append(len(self._expected))
            else:
                self._coming.append((len(self._sends), line))
        self._shift = asyncio.get_running_loop().time()
        self._arm()

    async def send(self, data: bytes) -> None:
        """Compare `data` with the recording; ConnectionLost names the line that differs."""
        if self._cause is not None:
            raise ConnectionLost(*self._cause.args) from self._cause
        if self._receiver is None or self._ended:
            raise ConnectionLost(f"{printable(self.url)}: it is {'closed' if self._ended else 'not open yet'}")
        before, self._said = self._said, self._said + len(data)
        if self._expected[before : self._said] != data:
            raise self._mismatch(data, before)
        done = bisect_right(self._ends, self._said)
        if done > self._done:
            self._done = done
            self._shift = asyncio.get_running_loop().time() - self._sends[done - 1].seconds
        self._arm()

    async def close(self) -> None:
        """End the replay."""
        self._end(None)

    def _arm(self) -> None:
        """Set the timer for the next chunk, if what has to be sent before it has been."""
        if self._timer is None and not self._ended and self._coming and self._coming[0][0] <= self._done:
            loop = asyncio.get_running_loop()
            due = self._coming[0][1].seconds + self._shift if self._timing else loop.time()
            self._timer = loop.call_at(due, self._play) if due > loop.time() else loop.call_soon(self._play)

    def _play(self) -> None:
        self._timer = None
        _, line = self._coming.popleft()
        if line.what == "lost":
            self._end(ConnectionLost(f"{printable(self.url)}: line {line.number}: {printable(line.text)}"))
        elif self._receiver is not None:
            self._receiver.data(line.data)
            self._arm()

    def _mismatch(self, data: bytes, before: int) -> ConnectionLost:
        wanted = self._expected[before:]
        same = next((i for i, (one, other) in enumerate(zip(wanted, data, strict=False)) if one != other), len(wanted))
        got = f"got {data[same : same + 32].hex()}"
        if same == len(wanted):
            reason = f"nothing more was sent in the recording, {got}"
        else:
            index = bisect_right(self._ends, before + same)
            rest = self._expected[before + same : self._ends[index]][:32]
            reason = f"line {self._sends[index].number}: expected {rest.hex()}, {got}"
        error = ConnectionLost(f"{printable(self.url)}: the program went another way: {reason}")
        self._end(error)
        return error

    def _end(self, error: ConnectionLost | None) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if not self._ended:
            self._ended, self._cause = True, error
            if self._receiver is not None:
                self._receiver.lost(error)


def _read(path: Path) -> list[_Line]:
    try:
        lines = read_file(path).split(b"\n")
    except (OSError, ValueError) as error:
        raise OpenError(f"cannot read the recording {printable(str(path))}: {printable(str(error))}") from error
    read: list[_Line] = []
    for number, text in enumerate(lines[:-1], 1):  # after the last newline is nothing, or what a crash left
        try:
            read.append(_parse(number, text, read[-1].seconds if read else 0.0))
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise OpenError(
                f"{printable(str(path))}, line {number}: no line of a recording: {printable(str(error))[:200]}"
            ) from error
    return read


def _parse(number: int, text: bytes, earliest: float) -> _Line:
    entry = json.loads(text)
    if not isinstance(entry, dict) or len(entry) != 2 or "t" not in entry:
        raise ValueError('expected {"t": seconds, "sent" or "received" or "lost": text}')
    (what,) = entry.keys() - {"t"}
    seconds = float(entry["t"])
    if not earliest <= seconds < math.inf:
        raise ValueError(f"its time must be from {earliest:g} on, as the lines are in order")
    if what not in ("sent", "received", "lost") or not isinstance(entry[what], str):
        raise ValueError(f"{what!r} is none of sent, received and lost, or no text")
    return _Line(number, seconds, what, entry[what], b"" if what == "lost" else bytes.fromhex(entry[what]))


def from_address(address: Address) -> ReplayTransport:
    """Make the transport for `replay:///path/to/file.jsonl?timing=1`."""
    timing = address.flag("timing", default=True)
    address.refuse_unknown()
    if not address.path or address.host or address.port:
        raise address.refusal("must name a file: replay:///path/to/file.jsonl")
    return ReplayTransport(address.path, timing=timing, url=address.url)
