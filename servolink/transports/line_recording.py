"""Recordings of the bytes of a transport, in lines of JSON, and transports to replay recordings."""

from __future__ import annotations

import asyncio
import json
import math
from bisect import bisect_right
from collections import deque
from collections.abc import Awaitable
from pathlib import Path
from typing import NamedTuple, TextIO

from servolink.errors import ConnectionLost, OpenError, quote
from servolink.support import MIB, call_at, read_file, reason
from servolink.transports.address import Address
from servolink.transports.base import Transport
from servolink.transports.foreign import contained
from servolink.transports.lifecycle import BaseTransport, WrappedTransport


class RecordingTransport(WrappedTransport):
    """Transport with a recording of both directions, with times.

    A line is `{"t": seconds since opening, "sent": hex}`, with `"received": hex` for received bytes and `"lost": text`
    at the end. Each line is written before the next, so that a crash loses at most one line.
    """

    is_recorded = True

    def __init__(self, inner: Transport, path: str | Path) -> None:
        """Record the bytes of `inner` in a new file at `path`."""
        super().__init__(contained(inner))
        self._path = Path(path)
        self._file: TextIO | None = None
        self._start = 0.0

    def data(self, chunk: bytes, /) -> None:
        """Record `chunk` and pass the bytes to the receiver."""
        self._write("received", chunk.hex())
        super().data(chunk)

    async def _open(self) -> None:
        """Create the file, then open the wrapped transport. Raise OpenError for an existing file."""
        try:
            self._file = self._path.open("x", encoding="ascii", buffering=1)
        except FileExistsError as error:
            raise OpenError(f"{self._path} exists already; remove the file or record to another file") from error
        except (OSError, ValueError) as error:
            raise OpenError(f"cannot record to {self._path}: {reason(error)}; choose another file") from error
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
        if self._was_ended():  # because writing the recording failed
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
        except OSError as error:  # a recording with a gap would mislead its readers
            self._close_file()
            self._break(f"{self._path} cannot be written: {reason(error)}")

    def _close_file(self) -> None:
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError:
                return  # the disk is full, as reported by the previous write


class _RecordedLine(NamedTuple):
    number: int
    seconds: float
    what: str
    text: str
    data: bytes


class ReplayTransport(BaseTransport):
    """Transport with the responses of a board from a recording.

    A recorded response arrives after all bytes sent earlier in the recording have been sent again, with the recorded
    delay, or without `timing` immediately. The division into sends is ignored; a different byte ends the connection.
    """

    is_recorded = True

    def __init__(self, path: str | Path, *, timing: bool = True, url: str = "") -> None:
        """Prepare to play the recording at `path`."""
        super().__init__(url or f"replay://{path}")
        self._path = Path(path)
        self._timing = timing
        self._sends: list[_RecordedLine] = []
        self._ends: list[int] = []  # position after each send, in all bytes to be sent
        self._expected = bytearray()
        self._sent = 0  # bytes sent so far
        self._done = 0  # sends completed so far
        self._coming: deque[tuple[int, _RecordedLine]] = deque()  # lines of the board, each after a number of sends
        self._shift = 0.0  # seconds from the time of the recording to the time of the loop
        self._timer: asyncio.Handle | None = None

    @classmethod
    def from_address(cls, address: Address) -> ReplayTransport:
        """Return the transport for `replay:///path/to/file.jsonl?timing=1`; the recorder has one for MCAP files."""
        timing = address.flag("timing", default=True)
        address.refuse_unknown()
        return cls(address.host + address.path, timing=timing, url=address.url)

    async def _open(self) -> None:
        """Read the recording. Raise OpenError, with the number of an invalid line."""
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
        """Compare `data` with the recording. Raise ConnectionLost, with the number of the first different line."""
        before, self._sent = self._sent, self._sent + len(data)
        if self._expected[before : self._sent] != data:
            error = self._mismatch(data, before)
            self._lose(error)
            raise error
        done = bisect_right(self._ends, self._sent)
        if done > self._done:  # the rest of the recording follows the time of the last complete send
            self._done = done
            self._shift = asyncio.get_running_loop().time() - self._sends[done - 1].seconds
        self._arm()

    async def _close(self) -> None:
        """Do nothing: a recording occupies no port."""

    def _abort(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _arm(self) -> None:
        """Set the timer for the next chunk, unless the program must send first."""
        if self._timer is None and self._coming and self._coming[0][0] <= self._done:
            loop = asyncio.get_running_loop()
            due = self._coming[0][1].seconds + self._shift if self._timing else loop.time()
            self._timer = call_at(loop, due, self._play) if due > loop.time() else loop.call_soon(self._play)

    def _play(self) -> None:
        self._timer = None
        _, line = self._coming.popleft()
        if line.what == "lost":
            self._lose(ConnectionLost(f"{self.url}: line {line.number}: {line.text}"))
        else:
            self._deliver(line.data)
            if self._stage != "ended":  # the receiver may close the transport
                self._arm()

    def _mismatch(self, data: bytes, before: int) -> ConnectionLost:
        expected = self._expected[before:]
        same = next(
            (i for i, (one, other) in enumerate(zip(expected, data, strict=False)) if one != other), len(expected)
        )
        received = f"got {data[same : same + 32].hex()}"
        if same == len(expected):
            reason = f"nothing more was sent in the recording, {received}"
        else:
            index = bisect_right(self._ends, before + same)
            rest = self._expected[before + same : self._ends[index]][:32]
            reason = f"line {self._sends[index].number}: expected {rest.hex()}, {received}"
        return ConnectionLost(f"{self.url}: the program sent bytes different from the recording: {reason}")


_LARGEST = 256 * MIB
"""Most bytes of a recording for replay: days of ordinary use."""


def _read(path: Path) -> list[_RecordedLine]:
    try:
        lines = read_file(path, _LARGEST).split(b"\n")
    except (OSError, ValueError) as error:
        raise OpenError(f"cannot read the recording {path}: {reason(error)}") from error
    read: list[_RecordedLine] = []
    for number, text in enumerate(
        lines[:-1], 1
    ):  # the last newline is followed by nothing, or by a line cut in a crash
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
        raise ValueError(f"the time must be at least {earliest:g}, as lines are in order of time")
    if what not in ("sent", "received", "lost") or not isinstance(entry[what], str):
        raise ValueError(f'expected "sent", "received" or "lost" with a text, not {quote(what)}')
    return _RecordedLine(number, seconds, what, entry[what], b"" if what == "lost" else bytes.fromhex(entry[what]))
