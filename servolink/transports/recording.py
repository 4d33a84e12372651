"""Writes down what passes through a transport, a JSON object a line, for `replay://` and for people."""

from __future__ import annotations

import asyncio
import json
import math
from bisect import bisect_right
from collections import deque
from pathlib import Path
from typing import NamedTuple, TextIO

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import escape
from servolink.files import read_file
from servolink.transports.address import Address
from servolink.transports.base import Receiver, Transport
from servolink.transports.lifecycle import WrappedTransport


class RecordingTransport(WrappedTransport):
    """Records both directions with times.

    A line is `{"t": seconds since opening, "sent": hex}`, or `"received": hex`, or `"lost": text` as the last one.
    Each is on its way to the disk before the next, so that a crash loses one line at most.
    """

    def __init__(self, inner: Transport, path: str | Path) -> None:
        """Record `inner` to a new file at `path`."""
        super().__init__(inner)
        self._path = Path(path)
        self._file: TextIO | None = None
        self._start = 0.0

    async def open(self, receiver: Receiver) -> None:
        """Make the file, then open the wrapped transport; a file that is there already is an OpenError."""
        self._check_unused()
        try:
            self._file = self._path.open("x", encoding="ascii", buffering=1)
        except FileExistsError as error:
            raise OpenError(f"{self._shown()} exists already; remove it or record to another file") from error
        except (OSError, ValueError) as error:
            raise OpenError(f"cannot record to {self._shown()}: {escape(str(error))}; choose another file") from error
        self._start = asyncio.get_running_loop().time()
        try:
            await super().open(receiver)
        except BaseException:
            self._close_file()
            self._path.unlink(missing_ok=True)
            raise

    async def send(self, data: bytes) -> None:
        """Record and send all of `data`."""
        self._check_open()
        if data:
            self._write("sent", data.hex())
        await super().send(data)

    def data(self, chunk: bytes, /) -> None:
        """Record `chunk` and pass it on."""
        self._write("received", chunk.hex())
        super().data(chunk)

    def _end(self, error: Exception | None) -> None:
        if error is not None:
            self._write("lost", str(error))
        self._close_file()
        super()._end(error)

    def _write(self, what: str, text: str) -> None:
        if self._file is None:
            return
        seconds = round(asyncio.get_running_loop().time() - self._start, 6)
        try:
            self._file.write(json.dumps({"t": seconds, what: text}) + "\n")
        except OSError as error:  # going on with a hole in the recording would mislead whoever reads it
            self._close_file()
            self._break(f"{self._shown()} cannot be written: {escape(str(error))}")

    def _close_file(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError:
                return  # the disk is full, which the write before has told

    def _shown(self) -> str:
        return escape(str(self._path))


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
            raise OpenError(f"{escape(self.url)}: a transport is opened once; make another")
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
            raise ConnectionLost(f"{escape(self.url)}: it is {'closed' if self._ended else 'not open yet'}")
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
            self._end(ConnectionLost(f"{escape(self.url)}: line {line.number}: {escape(line.text)}"))
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
        error = ConnectionLost(f"{escape(self.url)}: the program went another way: {reason}")
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
        raise OpenError(f"cannot read the recording {escape(str(path))}: {escape(str(error))}") from error
    read: list[_Line] = []
    for number, text in enumerate(lines[:-1], 1):  # after the last newline is nothing, or what a crash left
        try:
            read.append(_parse(number, text, read[-1].seconds if read else 0.0))
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise OpenError(
                f"{escape(str(path))}, line {number}: no line of a recording: {escape(str(error))[:200]}"
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
