"""All that is measured of one parser on frames of one size."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.peers.damage import DAMAGES, Recall, damage, recall
from benchmarks.peers.ours import Ours
from benchmarks.peers.peer import Peer
from benchmarks.peers.speed import Pace, Speed, at_best

_INTACT = {14: 20_000, 186: 1500}  # frames sent, by size; some 300 KB and more


@dataclass(frozen=True)
class Row:
    """One parser, one size."""

    peer: type[Peer]
    size: int
    frame: int
    """Bytes of its own frame."""
    best: Speed | None
    """None where it finds less than half of the frames."""
    recall: dict[str, Recall]

    @property
    def figures(self) -> dict[str, Any]:
        """Return everything for JSON."""
        return {
            "parser": self.peer.name,
            "frame": self.frame,
            "speeds": {"best": asdict(self.best)} if self.best else {},
            "recall": {name: asdict(found) for name, found in self.recall.items()},
        }


def measure(peer: type[Peer], size: int, pace: Pace, *, short: bool) -> Row | None:
    """Measure one parser beside ours; None if its format has no frame of this size."""
    if (frame := peer.frame(size, 1)) is None:
        return None
    found = _recalls(peer, size, _INTACT[size] // (40 if short else 1))
    best = None if peer is Ours else at_best(peer, size, pace)  # ours is measured beside each of the others
    return Row(peer, size, len(frame), best, found)


def _recalls(peer: type[Peer], size: int, count: int) -> dict[str, Recall]:
    frames = [peer.frame(size, number) or b"" for number in range(count)]
    streams = {kind: damage(frames, size, kind) for kind in DAMAGES}
    return {kind: recall(peer, stream, stream.chunks_for(peer, 64)) for kind, stream in streams.items()}
