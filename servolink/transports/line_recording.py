"""Recordings of what passes through a transport, one JSON object a line, and transports that play them."""

from __future__ import annotations

import asyncio
import json
import math
from bisect import bisect_right
from collections import deque
from collections.abc import Awaitable
from pathlib import Path
from typing import NamedTuple, TextIO

from servolink.errors import ConnectionLost, OpenError
from servolink.escaping import quote
from servolink.files import MIB, read_file, reason
from servolink.transports.address import Address
from servolink.transports.base import Transport
from servolink.transports.foreign import contained
from servolink.transports.lifecycle import BaseTransport, WrappedTransport


class RecordingTransport(WrappedTransport):
    """Records both directions with times.

    A line is `{"t": seconds since opening, "sent": hex}`, or `"received": hex`, or `"lost": text` as the last one.
    Each is handed to the system before the next, so that a crash loses one line at most.
    """

    is_recorded = True

    def __init__(self, inner: Transport, path: str | Path) -> None:
        """Record `inner` to a new file at `path`."""
        super().__init__(contained(inner))
        self._path = Path(path)
        self._file: TextIO | None = None
        self._start = 0.0

    def data(self, chunk: bytes, /) -> None:
        """Record `chunk` and pass it on."""
        self._write("received", chunk.hex())
        super().data(chunk)

    async def _open(self) -> None:
        """Create the file, then open the wrapped transport; an existing file is never overwritten."""
        try:
            self._file = self._path.open("x", encoding="ascii", buffering=1)
        except FileExistsError as error:
            raise OpenError(f"{self._path} exists already; remove it or record to another file") from error
        except (OSError, ValueError) as error:
            raise OpenError(f"cannot record to {self._path}: {error}; choose another file") from error
        self._start = asyncio.get_running_loop().time()
        try:
            await super()._open()
        except BaseException:
            self._close_file()
            self._path.unlink(missing_ok=True)
            raise

    def _send(self, data: bytes) -> Awaitable[None] | None:
        if data:
            self._write("sent", data.hex())
        if self._was_ended():  # because the recording could not be written
            raise self._lost()
        return super()._send(data)

    def _abort(self) -> None:
        if self._error is not None:
            self._write("lost", str(self._error))
        self._close_file()
        super()._abort()

    def _write(self, what: str, text: str) -> None:
        if self._file is None:
            return
        seconds = round(asyncio.get_running_loop().time() - self._start, 6)
        try:
            self._file.write(json.dumps({"t": seconds, what: text}) + "\n")
        except OSError as error:  # a recording with a hole would mislead its readers
            self._close_file()
            self._break(f"{self._path} cannot be written: {error}")

    def _close_file(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError:
                return  # the disk is full, as the write before has reported


class _RecordedLine(NamedTuple):
    number: int
    seconds: float
    what: str
    text: str
    data: bytes


class ReplayTransport(BaseTransport):
    """A board that answers from a recording.

    A recorded answer comes once everything sent before it has been sent again, as much later as in the recording,
    or at once without `timing`. How sends are cut does not matter; a differing byte ends the connection.
    """

    is_recorded = True

    def __init__(self, path: str | Path, *, timing: bool = True, url: str = "") -> None:
        """Play the recording at `path`."""
        super().__init__(url or f"replay://{path}")
        self._path = Path(path)
        self._timing = timing
        self._sends: list[_RecordedLine] = []
        self._ends: list[int] = []  # of each send, in all that is to be sent
        self._expected = bytearray()
        self._said = 0  # bytes
        self._done = 0  # sends
        self._coming: deque[tuple[int, _RecordedLine]] = deque()  # from the board, each after a number of sends
        self._shift = 0.0  # from the recording's time to the loop's
        self._timer: asyncio.Handle | None = None

    async def _open(self) -> None:
        """Read the recording; OpenError names the invalid line."""
        for line in _read(self._path):
            if line.what == "sent":
                self._sends.append(line)
                self._expected += line.data
                self._ends.append(len(self._expected))
            else:
                self._coming.append((len(self._sends), line))
        self._shift = asyncio.get_running_loop().time()
        self._arm()

    def _send(self, data: bytes) -> None:
        """Compare `data` with the recording; ConnectionLost names the line that differs."""
        before, self._said = self._said, self._said + len(data)
        if self._expected[before : self._said] != data:
            error = self._mismatch(data, before)
            self._lose(error)
            raise error
        done = bisect_right(self._ends, self._said)
        if done > self._done:  # the rest of the recording moves along with the last complete send
            self._done = done
            self._shift = asyncio.get_running_loop().time() - self._sends[done - 1].seconds
        self._arm()

    async def _close(self) -> None:
        """There is nothing to free."""

    def _abort(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _arm(self) -> None:
        """Set the timer for the next chunk, unless the program has to send something before."""
        if self._timer is None and self._coming and self._coming[0][0] <= self._done:
            loop = asyncio.get_running_loop()
            due = self._coming[0][1].seconds + self._shift if self._timing else loop.time()
            self._timer = loop.call_at(due, self._play) if due > loop.time() else loop.call_soon(self._play)

    def _play(self) -> None:
        self._timer = None
        _, line = self._coming.popleft()
        if line.what == "lost":
            self._lose(ConnectionLost(f"{self.url}: line {line.number}: {line.text}"))
        else:
            self._deliver(line.data)
            if self._stage != "ended":  # by the receiver
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
        return ConnectionLost(f"{self.url}: the program went another way: {reason}")


_LARGEST = 256 * MIB
"""The largest recording that is replayed: days of ordinary use."""


def _read(path: Path) -> list[_RecordedLine]:
    try:
        lines = read_file(path, _LARGEST).split(b"\n")
    except (OSError, ValueError) as error:
        raise OpenError(f"cannot read the recording {path}: {reason(error)}") from error
    read: list[_RecordedLine] = []
    for number, text in enumerate(lines[:-1], 1):  # after the last newline is nothing, or a line cut by a crash
        try:
            read.append(_parse(number, text, read[-1].seconds if read else 0.0))
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise OpenError(f"{path}, line {number}: not a line of a recording: {str(error)[:200]}") from error
    return read


def _parse(number: int, text: bytes, earliest: float) -> _RecordedLine:
    entry = json.loads(text)
    if not isinstance(entry, dict) or len(entry) != 2 or "t" not in entry:
        raise ValueError('expected {"t": seconds, "sent" or "received" or "lost": text}')
    (what,) = entry.keys() - {"t"}
    seconds = float(entry["t"])
    if not earliest <= seconds < math.inf:
        raise ValueError(f"its time must be from {earliest:g} on, as the lines are in order")
    if what not in ("sent", "received", "lost") or not isinstance(entry[what], str):
        raise ValueError(f'expected "sent", "received" or "lost" with a text, not {quote(what)}')
    return _RecordedLine(number, seconds, what, entry[what], b"" if what == "lost" else bytes.fromhex(entry[what]))


def from_address(address: Address) -> ReplayTransport:
    """Make the transport for `replay:///path/to/file.jsonl?timing=1`; `servolink.recorder.replaying` has all others."""
    timing = address.flag("timing", default=True)
    address.refuse_unknown()
    return ReplayTransport(address.host + address.path, timing=timing, url=address.url)
