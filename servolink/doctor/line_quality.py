"""Quality of the line: damaged bytes, missing responses and round trips."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle, islice

from servolink.connection import FENCES, SURE_COPIES, Connection, LineBytes, Tap, text_between
from servolink.doctor.finding import Finding
from servolink.errors import ConnectionLost, RequestTimeout, quote
from servolink.protocol import PACKETS, ButtonEventResponse, ByteOrder, QueryServoListRequest, Request, Response

ANSWERS_TWICE, LATE_COPIES = "answers twice", "late copies"
SETTINGS = {ANSWERS_TWICE: "answers_twice", LATE_COPIES: "late_copies"}
"""Setting of the address or profile that remedies a finding, by the name of the finding."""
REQUESTS = 60
"""Number of queries sent, without any change to the board."""

_BYTE_ORDERS: tuple[ByteOrder, ...] = ("little", "big")
_PATIENCE = 0.5  # seconds for each response, unless given
_ROUND_TRIPS = 4  # for a slow board, so many are allowed for each response
_LONGEST = 4.0  # seconds, after which a slow board is asked no more
_MOST_BYTES = 65536  # examined for text
_LISTENING = 3.5  # seconds from the first query, in which copies of responses may come
_STEP = 0.5  # seconds of listening between two looks
_MARKS, _MARK_BYTES = 8, 2  # so many places between frames have so few different bytes only by intention
_FEW = 2  # late responses tolerated, as caused by a short standstill of this computer


@dataclass(frozen=True, slots=True)
class LineCounts:
    """Counts of REQUESTS queries, or fewer if the connection ended early."""

    received_bytes: int
    noise_bytes: int
    """Bytes outside frames, without the zeros of HID reports."""
    requests: int
    unanswered: int
    """Queries without any response before the end."""
    late: int
    """Responses after the allowed time."""
    round_trips: Sequence[float]
    """Seconds, in the order of the queries."""
    ended: str = ""
    """Reason why the connection ended early; empty for a full measurement."""
    patience: float = _PATIENCE
    """Seconds allowed for each response."""
    repeated: int = 0
    """Second responses to a query."""
    copies: int = 0
    """Responses that came again later."""
    text: str = ""
    """Beginning of readable text between frames; empty without any."""
    echoes: int = 0
    """Requests that came back."""
    unasked: Sequence[int] = ()
    """Packet ids of responses that nobody had asked for."""
    received: bytes = b""
    """First bytes received."""
    byte_order: ByteOrder = "little"

    def percentile(self, percent: int) -> float | None:
        """Return the time within which `percent` of the responses came; None without responses."""
        ordered = sorted(self.round_trips)
        return ordered[min(len(ordered) - 1, len(ordered) * percent // 100)] if ordered else None


class _LineRecording(Tap):
    """Keeps the first bytes received, and which responses were asked for."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.asked = Counter[int]()

    def sent(self, data: bytes) -> None:
        """Note the response to what is sent."""
        self.asked.update(frame.packet_id + 1 for order in _BYTE_ORDERS for frame in LineBytes(data, order).frames())

    def received(self, data: bytes) -> None:
        """Keep bytes from the board."""
        self.data += data[: _MOST_BYTES - len(self.data)]

    def copies(self, byte_order: ByteOrder) -> int:
        """Return how many equal responses came beyond the requests for them."""
        frames = LineBytes(bytes(self.data), byte_order).frames()
        heard = Counter((frame.packet_id, bytes(self.data[frame.start : frame.end])) for frame in frames)
        asked = self.asked
        return sum(max(0, count - asked[each]) for (each, _), count in heard.items() if each in asked)


async def measure(connection: Connection, patience: float | None = None) -> LineCounts:
    """Query the board of a contact repeatedly, each time for `patience` seconds."""
    stats, loop = connection.stats, asyncio.get_running_loop()
    begun, received, noise, late = loop.time(), stats.bytes_received, stats.noise, stats.late_responses
    over = connection.answers.over
    repeated, timeouts = stats.repeated, stats.timeouts
    patience = patience or max(_PATIENCE, _ROUND_TRIPS * (stats.round_trip(50) or 0.0))
    requests = unanswered = 0
    ended = ""
    recording, order = _LineRecording(), connection.codec.byte_order
    stop_recording = connection.taps.add(recording)
    try:
        # Different queries in turn: the response to one proves the other over, so nothing else is sent between.
        for requests, query in enumerate(islice(cycle(connection.answered[:2]), REQUESTS), 1):  # noqa: B007
            try:
                await connection.request(query, timeout=patience)
            except RequestTimeout:
                unanswered += 1
            if loop.time() > begun + _LONGEST:
                break
        while recording.copies(order) <= requests // 2 and not over.done() and loop.time() < begun + _LISTENING:
            await asyncio.wait((over,), timeout=_STEP)
    except ConnectionLost as error:
        ended = str(error)
    stop_recording()
    received_bytes = bytes(recording.data)
    queries = (*FENCES, QueryServoListRequest())
    asked = {query.packet_id + 1 for query in queries} | {ButtonEventResponse.packet_id, *recording.asked}
    frames = [PACKETS[frame.packet_id] for frame in LineBytes(received_bytes, order).frames() if frame.fits]
    copies = recording.copies(order)  # an opening in between takes them without counting
    is_copied = copies > requests // 2 and stats.repeated - repeated <= _FEW
    unasked = [each.packet_id for each in frames if issubclass(each, Response) and each.packet_id not in asked]
    return LineCounts(
        stats.bytes_received - received,
        stats.noise - noise,
        requests,
        unanswered,
        stats.late_responses - late,
        tuple(stats.round_trips)[-requests:],
        ended,
        patience,
        # After a timeout a query is sent again, and both sendings may be answered.
        max(0, stats.repeated - repeated - (stats.timeouts - timeouts)),
        max(0, stats.late_copies - len(unasked), copies if is_copied else 0),
        text_between(received_bytes, order),
        sum(issubclass(each, Request) for each in frames),
        unasked,
        received_bytes,
        order,
    )


def check_line(line: LineCounts) -> Iterator[Finding]:
    """Find noise, missing responses and an early end of the connection."""
    if line.copies >= SURE_COPIES:
        yield Finding(
            LATE_COPIES,
            f"{line.copies} responses came again later, unchanged",
            "an adapter, a bridge or the firmware repeats responses; without the setting, a program reads old angles "
            "until it has noticed that",
            "",
        )
    elif line.repeated > _FEW:
        yield Finding(
            ANSWERS_TWICE,
            f"{line.repeated} of {line.requests} queries were answered twice",
            "an adapter repeats what it receives, or the firmware sends each response twice; programs cannot tell "
            "whose response the second one is, unless they know of it",
            "",
        )
    if line.text:
        yield Finding(
            "text",
            f"{line.noise_bytes} of {line.received_bytes} received bytes were outside frames, and are text: "
            f"{quote(line.text)}",
            "the firmware writes messages on the line of the protocol; they take time, and do no other harm",
            "switch the messages off in the firmware, if you can",
        )
    elif line.noise_bytes:
        yield _noise(line)
    if len(line.unasked) > _FEW:
        yield Finding(
            "unasked",
            f"{len(line.unasked)} responses came that were not asked for, such as packet {line.unasked[0]}",
            "another program uses the board through the same bridge, or the board sends by itself; a response to "
            "another program may be taken for an answer",
            "close other programs on the board, or share it: servolink share",
        )
    if line.echoes > _FEW:
        yield Finding(
            "echoed requests",
            f"{line.echoes} requests came back from the line: an echo",
            "the line returns what is sent, as a two-wire bus or an adapter does; programs ignore it",
            "",
            is_harmless=True,
        )
    if line.unanswered or line.late > _FEW:
        yield Finding(
            "responses",
            f"{line.unanswered} of {line.requests} queries had no response in {line.patience:g} s"
            + (f", and {line.late} response{'s' * (line.late != 1)} came late" if line.late else ""),
            "frames are lost on the line" if line.noise_bytes else "the board is busy, or bytes are lost",
            "remove the noise first"
            if line.noise_bytes
            else "stop macros and motions of the board\ncheck cable and power",
        )
    if line.ended:
        yield Finding(
            "connection",
            f"the connection ended after {line.requests} of {REQUESTS} queries: {line.ended}",
            "the board responded before, so the cable is loose or the board lost power",
            "check cable, plugs and power",
        )


def _noise(line: LineCounts) -> Finding:
    """Report bytes outside frames by what they have in common, else as damage."""
    share = 100 * line.noise_bytes / line.received_bytes
    many = f"{line.noise_bytes} of {line.received_bytes} received bytes ({share:.1f} %) were outside frames"
    heard = LineBytes(line.received, line.byte_order)
    for mark in heard.marks():
        return Finding(mark.name, f"{many}: the line {mark.text}", mark.meaning, mark.remedy)
    spans = heard.unread()
    if len(spans) >= _MARKS and len({*b"".join(spans)}) <= _MARK_BYTES:
        return Finding(
            "noise",
            f"{many}: the same bytes between frames each time, {heard.first()}",
            "a bridge, or the firmware, marks the ends of frames; programs ignore that",
            "switch the marks off, or set the bridge to pass all bytes unchanged, if you can",
        )
    return Finding(
        "noise",
        f"{many}, first {heard.first()}" if spans else many,
        "the line damages bytes, or another device or program uses the line",
        "try a shorter cable, another port without a hub, and a separate power supply for the servos\n"
        "close other programs on the port",
    )
