"""Line to a board during measurements: packets without repeats and without matching, so that losses show."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median
from types import TracebackType
from typing import Self

from servolink.boards import BoardSettings
from servolink.connection import LONG_PAUSE, LineBytes, NewsTimer, lost
from servolink.errors import ConnectionLost, DecodeError, OpenError, Reason
from servolink.protocol import ButtonEventResponse, Codec, Frame, FrameParser, LenientParser, Packet, Request, Response
from servolink.transports import Receiver, Transport

PATIENCE = 0.4
"""Seconds to wait for each response until round trips are known."""
TRIES = 6
"""Number of attempts before silence is counted as silence."""

_QUIET = 0.1  # seconds without a response, after which no more responses are expected
_LONGEST_SETTLING = 3.0  # seconds
_LATEST = 3.0  # seconds after which a response is no longer waited for
_LONGEST_WAIT = 10.0  # seconds for the responses to a burst, on a line that is never quiet

_BEGINNING, _LONGEST_FRAME = 4096, 4096
_MOST, _KEPT = 262_144, 65_536
"""Bytes of a direction before the oldest are dropped, and bytes kept then."""


class LineRecord:
    """Bytes received on a line, as far back as a verdict needs; places are counted from the first byte."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self.beginning = b""
        """First bytes received."""
        self.received = 0
        """Number of bytes received."""
        self.sent_at = 0.0
        """Time of the latest sending (loop time); 0 before the first."""
        self.pause = 0.0
        """Longest pause inside a frame, in seconds."""
        self._bytes = bytearray()
        self._heard_at = 0.0

    def add(self, chunk: bytes, now: float) -> None:
        """Take bytes received at `now` (loop time)."""
        pause, self._heard_at = now - self._heard_at, now
        if self.received and pause > max(self.pause, LONG_PAUSE) and self._ends_inside():
            self.pause = pause
        if len(self.beginning) < _BEGINNING:
            self.beginning += chunk[: _BEGINNING - len(self.beginning)]
        self.received += len(chunk)
        self._bytes += chunk
        if len(self._bytes) > _MOST:
            del self._bytes[:-_KEPT]

    def _ends_inside(self) -> bool:
        latest = bytes(self._bytes[-_LONGEST_FRAME:])
        return LineBytes(latest).ends_inside()

    def since(self, place: int) -> bytes:
        """Return what was received behind a place, as far as it is kept."""
        return bytes(self._bytes[max(0, len(self._bytes) - (self.received - place)) :])


class SharedTransport:
    """Transport that stays open between consecutive users: some boards reset on every opening."""

    def __init__(self, inner: Transport) -> None:
        """Share `inner`, not opened so far."""
        self._inner = inner
        self._receiver: Receiver | None = None
        self._is_open = False
        self._lost: ConnectionLost | None = None
        self.idle = 0.0
        """Seconds from the latest request to the end of the connection; 0 while it is open."""
        self.settings = BoardSettings()
        """Settings without which the board cannot be used, as far as they are known."""
        self.record = LineRecord()
        """Bytes received since the first opening."""

    @property
    def url(self) -> str:
        """Address of the shared transport."""
        return self._inner.url

    async def open(self, receiver: Receiver) -> None:
        """Pass everything to `receiver` until `close`. Raise OpenError for a failed opening or a lost transport."""
        if self._receiver is not None:
            raise OpenError(f"{self.url}: in use by another part of servolink", reason=Reason.IN_USE)
        if self._lost is not None:
            text = f"{self.url}: ended {self.idle:.1f} s after the latest request: {self._lost}"
            raise OpenError(text) from self._lost
        self._receiver = receiver
        if not self._is_open:
            try:
                await self._inner.open(self)
            except BaseException:
                self._receiver = None
                raise
            self._is_open = True

    async def send(self, data: bytes) -> None:
        """Send all of `data` to the board."""
        self.record.sent_at = asyncio.get_running_loop().time()
        await self._inner.send(data)

    async def close(self) -> None:
        """End the present use; the transport stays open."""
        receiver, self._receiver = self._receiver, None
        if receiver is not None:
            receiver.lost(None)

    async def free(self) -> None:
        """Close the transport itself."""
        await self.close()
        await self._inner.close()

    def data(self, chunk: bytes, /) -> None:
        """Pass on a chunk; bytes between two uses are only recorded."""
        self.record.add(chunk, asyncio.get_running_loop().time())
        if self._receiver is not None:
            self._receiver.data(chunk)

    def lost(self, error: Exception | None, /) -> None:
        """Pass on the end of the transport."""
        self.idle = asyncio.get_running_loop().time() - self.record.sent_at
        self._lost = error if isinstance(error, ConnectionLost) else ConnectionLost(f"{self.url}: closed")
        receiver, self._receiver = self._receiver, None
        if receiver is not None:
            receiver.lost(error)


class TrialLine:
    """Sends packets, each once, and collects the responses."""

    def __init__(self, transport: SharedTransport, codec: Codec) -> None:
        """Speak as `codec` does. `async with` opens the line and ends the use of `transport`."""
        self._news = NewsTimer(lambda: self.received)
        self.codec = codec
        self.patience = PATIENCE
        """Seconds to wait for a response, and after the last response for another."""
        self.received = 0
        """Number of bytes received so far."""
        self.received_at = self._news.now
        """Time of the latest byte, on the clock of the event loop."""
        self.answered_at = 0.0
        """Time of the first response to the latest burst; 0 before."""
        self.contradictions: dict[int, str] = {}
        """Reasons why contents cannot be read, by packet id, of frames with a right checksum."""
        self.stalls = 0
        """Number of bursts with missing responses that no later response has proven lost: they may be late."""
        self._responded_at = self.received_at  # latest byte of a frame: neither text nor a button event
        self._transport = transport
        self._parser = (LenientParser if transport.settings.ignore_extra else FrameParser)(codec.byte_order)
        self._frames: list[Frame] = []
        self._received_frames: list[Frame] = []  # all frames since the latest burst began
        self._fences: list[Request[Response]] = []  # sent after the latest burst
        self._fence_kinds: deque[Request[Response]] = deque()

    async def __aenter__(self) -> Self:
        """Open the line, and wait for silence."""
        await self._transport.open(self)
        await self.settle()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the use of the transport."""
        await self._transport.close()

    def data(self, chunk: bytes, /) -> None:
        """Take bytes from the transport."""
        self.received += len(chunk)
        self.received_at = self._news.now
        frames = self._parser.feed(chunk)
        if self._parser.partial_frame or any(packet_id != ButtonEventResponse.packet_id for packet_id, _ in frames):
            self._responded_at = self.received_at
        self._frames += frames
        self._received_frames += frames
        self._news.tell()

    def lost(self, error: Exception | None, /) -> None:
        """End: the transport has ended."""
        self._news.fail(lost(self._transport.url, error))

    def use_fences(self, queries: Iterable[Request[Response]]) -> None:
        """Where a response is missing, wait until a later one has come: to one of `queries`, which the board answers.

        They take turns: a late response to the fence behind one burst is none to the fence behind the next.
        """
        self._fence_kinds = deque(queries)

    async def settle(self) -> None:
        """Wait until no response has come for a moment, so that later responses belong to later packets."""
        begun = self._news.now
        while await self._wait(min(begun + _LONGEST_SETTLING, max(begun, self._responded_at) + _QUIET)):
            pass
        self._frames.clear()

    async def send(self, packet: Packet) -> None:
        """Send a packet without waiting."""
        await self._transport.send(self.codec.encode(packet, unchecked=True))

    async def ask(self, request: Request[Response]) -> Frame | None:
        """Send `request` once, and return the frame of the response; None without a response in time."""
        frames = await self.burst([request])
        return frames[0] if frames else None

    async def answer(self, request: Request[Response]) -> Response | None:
        """Send `request` up to TRIES times, and return the first response; None without any."""
        for _ in range(TRIES):
            if (frame := await self.ask(request)) is not None:
                return self.decode(frame)
        return None

    def decode(self, frame: Frame) -> Response:
        """Return the response in an accepted frame."""
        response = self.codec.decode(*frame)
        assert isinstance(response, Response)  # noqa: S101 - its id is that of a response
        return response

    async def burst(self, requests: Sequence[Request[Response]]) -> list[Frame]:
        """Send all requests at once, and return the frames of the responses: at most one for each request.

        Waiting ends with the last response, or after `patience` without a frame. A fence is then sent, if there are any
        (see `use_fences`), and waiting goes on until it is answered: what is still missing is lost and not late.
        """
        self._fences.clear()
        self._frames.clear()
        self._received_frames.clear()
        self.answered_at = 0.0
        outstanding = list(requests)
        await self._transport.send(b"".join([self.codec.encode(each, unchecked=True) for each in requests]))
        found = await self._collect(outstanding)
        if outstanding and self._fence_kinds:
            self._fence_kinds.rotate()
            others = [kind for kind in self._fence_kinds if kind not in requests]
            found += await self._await_fence(outstanding, next(iter(others), self._fence_kinds[0]))
        answers = [frame for frame in found if any(self._answers(frame, each) for each in requests)]
        # A fence may be equal to a request: all that is missing then counts as requests.
        return answers[: max(0, len(requests) - sum(each in requests for each in outstanding))]

    async def _await_fence(self, outstanding: list[Request[Response]], fence: Request[Response]) -> list[Frame]:
        """Send `fence` until it is answered, and return all frames that answer what is outstanding."""
        end = self._news.now + (0 if self.stalls else _LATEST)
        found = list[Frame]()
        while not any(self._answers(frame, fence) for frame in found):
            if self._fences and self._news.now >= end:
                self.stalls += 1
                break
            self._fences.append(fence)
            outstanding.append(fence)
            await self.send(fence)
            found += await self._collect(outstanding, fence)
        return found

    async def _collect(
        self, outstanding: list[Request[Response]], until: Request[Response] | None = None
    ) -> list[Frame]:
        """Return the frames that answer `outstanding` requests, and remove those requests.

        Waiting ends when all are answered, or all equal to `until`, or after `patience` without a response.
        """
        begun, found = self._news.now, list[Frame]()
        while True:
            found += self._take(outstanding)
            if not outstanding or (until is not None and until not in outstanding):
                return found
            if not await self._wait(min(max(begun, self._responded_at) + self.patience, begun + _LONGEST_WAIT)):
                while self._parser.partial_frame:  # a damaged length may hold back the other frames
                    self._frames += self._parser.abandon_frame()
                return found + self._take(outstanding)

    def answered_in_order(self, requests: Sequence[Request[Response]]) -> bool:
        """Return whether `requests`, the latest burst, were answered in order and at most once each so far."""
        requests = [*requests, *self._fences]
        answers = [frame for frame in self._received_frames if any(self._answers(frame, each) for each in requests)]
        remaining = iter(requests)
        return all(any(self._answers(frame, each) for each in remaining) for frame in answers)

    def _take(self, outstanding: list[Request[Response]]) -> list[Frame]:
        """Return the new frames that answer `outstanding` requests, and remove the answered requests."""
        frames, self._frames = self._frames, []
        answers = []
        for frame in frames:
            request = next((each for each in outstanding if self._answers(frame, each)), None)
            if request is not None:
                outstanding.remove(request)
                answers.append(frame)
                self.answered_at = self.answered_at or self.received_at
        return answers

    def _answers(self, frame: Frame, request: Request[Response]) -> bool:
        if frame[0] != request.packet_id + 1:
            return False
        try:
            return request.accepts(self.decode(frame))
        except DecodeError as error:
            self.contradictions[frame[0]] = str(error)
            return False

    async def _wait(self, until: float) -> bool:
        """Return whether anything has come before `until` (loop time). Raise ConnectionLost if the line has ended."""
        before = self.received
        while self.received == before and self._news.now < until:
            await self._news.wait(until)
        return self.received > before


@dataclass(frozen=True, slots=True)
class Quality:
    """Losses and round trips of single queries on the line."""

    sendings: int
    round_trips: tuple[float, ...]
    """Seconds of each answered query."""

    @property
    def lost(self) -> int:
        """Number of queries without a response."""
        return self.sendings - len(self.round_trips)

    @property
    def loss(self) -> float:
        """Share of lost queries, 0 to 1."""
        return self.lost / self.sendings if self.sendings else 1.0

    @property
    def is_clean(self) -> bool:
        """Whether nothing was lost, so that silence comes from the board."""
        return not self.lost

    @property
    def round_trip(self) -> float:
        """Median round trip in seconds."""
        return median(self.round_trips) if self.round_trips else PATIENCE

    def __str__(self) -> str:
        """Return the loss as a text for people."""
        return f"{self.lost} of {self.sendings} single queries were lost"


_SINGLES = 40
_LONGEST_MEASURING = 15.0  # seconds
_SHORTEST_PATIENCE, _LONGEST_PATIENCE = 0.1, 2.0


async def measure_quality(line: TrialLine, queries: Sequence[Request[Response]]) -> Quality:
    """Send the first of `queries` many times, one at a time, and set fences and patience of `line`."""
    loop = asyncio.get_running_loop()
    query = queries[0]
    line.use_fences(queries)
    end = loop.time() + _LONGEST_MEASURING
    round_trips = []
    sendings = 0
    while sendings < _SINGLES and loop.time() < end:
        begun = loop.time()
        sendings += 1
        if await line.ask(query) is not None:
            round_trips.append(line.answered_at - begun)
    quality = Quality(sendings, tuple(round_trips))
    slowest = max(round_trips, default=PATIENCE)
    line.patience = max(_SHORTEST_PATIENCE, min(_LONGEST_PATIENCE, 2 * slowest))
    return quality
