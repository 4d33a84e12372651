"""Lines as they are met: what becomes of a frame on its way, and whether it is still whole in what arrives."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

from servolink.transports import Faults, LineFaults

STALL = 0.3
"""Seconds for which a stalled program does nothing."""
_LONGEST_BURST = 40
_NONE = Faults()


def bit_errors(rate: float) -> float:
    """Return the chance that a byte is damaged where each bit is wrong with the chance `rate`."""
    return 1 - (1 - rate) ** 8


@dataclass(frozen=True, slots=True)
class Line:
    """How bad a line is, in each direction."""

    name: str
    faults: Faults = _NONE
    bursts: float = 0.0
    """Chance of noise before a frame."""
    reports: int = 0
    """Frames travel in reports of so many bytes, the last one filled with zeros; 0: as they are."""
    lost: float = 0.0
    """Chance that a report is lost."""
    stalls: float = 0.0
    """Chance, per request, that the program does nothing for a while."""

    @property
    def damages(self) -> bool:
        """Whether bytes on it are changed, lost or made up."""
        return self.faults != _NONE or bool(self.bursts or self.lost)


LINES = (
    Line("clean"),
    Line("stalls of 300 ms", stalls=0.05),
    Line("bit errors 1e-4", Faults(flip=bit_errors(1e-4))),
    Line("bit errors 1e-3", Faults(flip=bit_errors(1e-3))),
    Line("bytes lost 1e-3", Faults(drop=1e-3)),
    Line("bytes inserted 1e-3, bursts 20 %", Faults(insert=1e-3), bursts=0.2),
    Line("HID, bit errors 1e-4", Faults(flip=bit_errors(1e-4)), reports=64),
    Line("HID, reports lost 1 %", reports=64, lost=0.01),
    Line("frames cut 5 %", Faults(cut=0.05)),
    Line(
        "all together",
        Faults(flip=bit_errors(1e-4), drop=2e-4, insert=2e-4, cut=0.02),
        bursts=0.05,
        reports=64,
        lost=0.005,
        stalls=0.02,
    ),
)


class Direction:
    """One direction of a line."""

    def __init__(self, line: Line, random: Random) -> None:
        """Draw the damage from `random`."""
        self._line = line
        self._random = random
        self._faults = LineFaults(line.faults, random.getrandbits(64))
        self._touched = line.damages or bool(line.reports)

    def carry(self, frame: bytes) -> tuple[bytes, bool]:
        """Return what arrives of `frame`, with noise and padding, and whether it is whole in it."""
        if not self._touched:
            return frame, True
        arriving = self._reports(frame) if self._line.reports else frame
        arriving = b"".join(piece for _, piece in self._faults.apply(arriving, 0.0))
        if self._line.bursts and self._random.random() < self._line.bursts:
            arriving = self._random.randbytes(self._random.randrange(1, _LONGEST_BURST)) + arriving
        return arriving, frame in arriving

    def _reports(self, frame: bytes) -> bytes:
        size = self._line.reports
        padded = frame + bytes(-len(frame) % size)
        if not self._line.lost:
            return padded
        kept = (padded[at : at + size] for at in range(0, len(padded), size))
        return b"".join(report for report in kept if self._random.random() >= self._line.lost)
