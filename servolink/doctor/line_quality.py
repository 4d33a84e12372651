"""Quality of the line: damaged bytes, missing responses and round trips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from servolink.client.connect import connect
from servolink.doctor import Finding
from servolink.errors import ConnectionLost, RequestTimeout
from servolink.profiles.profile import BoardProfile
from servolink.protocol.frame import ByteOrder
from servolink.protocol.settings import QueryMemorySizeRequest

REQUESTS = 60
"""Number of queries sent, without any change to the board."""

_PATIENCE = 0.5  # seconds for each response, unless given
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

    def percentile(self, percent: int) -> float | None:
        """Return the time within which `percent` of the responses came; None without responses."""
        ordered = sorted(self.round_trips)
        return ordered[min(len(ordered) - 1, len(ordered) * percent // 100)] if ordered else None


async def measure(url: str, byte_order: ByteOrder, patience: float | None = None) -> LineCounts:
    """Query the board at `url` repeatedly, each time for `patience` seconds. Raise OpenError for a failed opening."""
    patience = patience or _PATIENCE
    requests = unanswered = 0
    ended = ""
    unknown = BoardProfile()  # a damaged profile is a separate finding
    async with connect(url, byte_order=byte_order, patience=patience, angle_unit=None, profile=unknown) as board:
        try:
            for requests in range(1, REQUESTS + 1):  # noqa: B007 - the result says how many there were
                try:
                    await board.request(QueryMemorySizeRequest())
                except RequestTimeout:
                    unanswered += 1
        except ConnectionLost as error:
            ended = str(error)
        stats = board.stats
        noise = stats.noise
        return LineCounts(
            stats.bytes_received,
            noise,
            requests,
            unanswered,
            stats.late_responses,
            tuple(stats.round_trips),
            ended,
            patience,
        )


def check_line(line: LineCounts) -> Iterator[Finding]:
    """Find noise, missing responses and an early end of the connection."""
    if line.noise_bytes:
        share = 100 * line.noise_bytes / line.received_bytes
        yield Finding(
            "noise",
            f"{line.noise_bytes} of {line.received_bytes} received bytes ({share:.1f} %) were outside frames",
            "the line damages bytes, or another device or program uses the line",
            "try a shorter cable, another port without a hub, and a separate power supply for the servos\n"
            "close other programs on the port\nservolink doctor",
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
            "check cable, plugs and power\nservolink doctor",
        )
