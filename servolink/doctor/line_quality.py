"""How good the line is: what comes damaged, and how long answers take."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from servolink.client.connect import connect
from servolink.doctor import Finding
from servolink.errors import ConnectionLost, RequestTimeout
from servolink.protocol.frame import ByteOrder
from servolink.protocol.parser import PADDING
from servolink.protocol.settings import QueryMemorySizeRequest

QUESTIONS = 60
"""Of the shortest kind; nothing on the board changes."""

_PATIENCE = 0.5  # seconds for each answer


@dataclass(frozen=True, slots=True)
class Line:
    """What was seen while the board was asked QUESTIONS times, or until the connection ended."""

    received_bytes: int
    noise_bytes: int
    """Those that were part of no frame; the zeros that fill HID reports are not counted."""
    asked: int
    unanswered: int
    late: int
    """Answers that came after their time."""
    round_trips: Sequence[float]
    """Seconds, in the order of their questions."""
    ended: str = ""
    """What ended the connection before all was asked."""

    def percentile(self, percent: int) -> float | None:
        """Return the time that `percent` of the answers kept; None if there were none."""
        ordered = sorted(self.round_trips)
        return ordered[min(len(ordered) - 1, len(ordered) * percent // 100)] if ordered else None


async def measure(url: str, byte_order: ByteOrder) -> Line:
    """Ask the board at `url`, again and again; OpenError if it cannot be opened."""
    asked = unanswered = 0
    ended = ""
    async with connect(url, byte_order=byte_order, timeout=_PATIENCE, retries=0, angle_unit=None) as board:
        try:
            for asked in range(1, QUESTIONS + 1):  # noqa: B007 - how far it came is told
                try:
                    await board.request(QueryMemorySizeRequest())
                except RequestTimeout:
                    unanswered += 1
        except ConnectionLost as error:
            ended = str(error)
        stats = board.stats
        noise = sum(count for reason, count in stats.skipped.items() if reason != PADDING)
        return Line(
            stats.bytes_received, noise, asked, unanswered, stats.late_responses, tuple(stats.round_trips), ended
        )


def check_line(line: Line) -> Iterator[Finding]:
    """Find noise, missing answers and a connection that did not last."""
    if line.noise_bytes:
        share = 100 * line.noise_bytes / line.received_bytes
        yield Finding(
            "noise",
            f"{line.noise_bytes} of {line.received_bytes} received bytes ({share:.1f} %) were part of no frame",
            "the line damages bytes, or something else speaks on it",
            "try a shorter cable, another port without a hub, and another power supply for the servos; "
            "close other programs that use the port; run servolink doctor again",
        )
    if line.unanswered or line.late:
        yield Finding(
            "answers",
            f"{line.unanswered} of {line.asked} questions were not answered in {_PATIENCE:g} s"
            + (f", and {line.late} answers came late" if line.late else ""),
            "questions or answers get lost on the line" if line.noise_bytes else "the board is busy, or bytes get lost",
            "see to the noise first" if line.noise_bytes else "stop what the board is doing; check cable and power",
        )
    if line.ended:
        yield Finding(
            "connection",
            f"it ended after {line.asked} of {QUESTIONS} questions: {line.ended}",
            "the board has answered before, so the line is bad, or the board or its power is",
            "check cable, plugs and power; run servolink doctor again",
        )
