"""All that is measured of one parser on frames of one size."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.peers.damage import DAMAGES, Recall, damage, recall
from benchmarks.peers.ours import Ours
from benchmarks.peers.peer import Peer
from benchmarks.peers.speed import Pace, Speed, at_best, dirty, in_chunks, of_many_kinds, of_one_kind
from benchmarks.streams import MIXES, chunks

CHUNKS = {"1": 1, "64": 64, "one frame": None, "4096": 4096, "65536": 65536}
"""Bytes in a chunk, by heading."""

MIX_CHUNKS = {name: CHUNKS[name] for name in ("64", "one frame", "4096")}
"""The same for streams of many kinds of frames: as single responses arrive, and bursts."""

_INTACT = {14: 20_000, 186: 1500, 3611: 200}  # frames sent, by size; some 300 KB and more


@dataclass(frozen=True)
class Row:
    """One parser, one size. Speeds are None where it finds less than half of the frames."""

    peer: type[Peer]
    size: int
    frame: int
    """Bytes of its own frame."""
    best: Speed | None
    dirty: Speed | None
    chunked: dict[str, Speed | None]
    recall: dict[str, Recall]
    back_to_back: dict[str, Recall]
    """Of one that is fed frame by frame: what it finds in chunks of 64 bytes."""

    @property
    def figures(self) -> dict[str, Any]:
        """Return everything for JSON."""
        speeds = {"best": self.best, "dirty": self.dirty, **self.chunked}
        return {
            "parser": self.peer.name,
            "frame": self.frame,
            "speeds": {name: asdict(speed) for name, speed in speeds.items() if speed is not None},
            "recall": {name: asdict(found) for name, found in self.recall.items()},
            "back_to_back": {name: asdict(found) for name, found in self.back_to_back.items()},
        }


@dataclass(frozen=True)
class Mix:
    """One parser on one stream of many kinds of frames."""

    peer: type[Peer]
    stream: str
    chunked: dict[str, Speed | None]

    @property
    def figures(self) -> dict[str, Any]:
        """Return everything for JSON."""
        speeds = {name: asdict(speed) for name, speed in self.chunked.items() if speed is not None}
        return {"parser": self.peer.name, "stream": self.stream, "speeds": speeds}


def measure_mix(peer: type[Peer], stream: str, pace: Pace) -> Mix | None:
    """Measure one parser beside ours on a stream of `MIXES`; None if its format has no such frames."""
    if any(peer.mixed(size, 1) is None for size in MIXES[stream]):
        return None
    frames = of_many_kinds(MIXES[stream])
    return Mix(peer, stream, {name: in_chunks(peer, frames, chunk, pace) for name, chunk in MIX_CHUNKS.items()})


def measure(peer: type[Peer], size: int, pace: Pace, *, short: bool) -> Row | None:
    """Measure one parser beside ours; None if its format has no frame of this size."""
    if (frame := peer.frame(size, 1)) is None:
        return None
    found, streamed = _recalls(peer, size, _INTACT[size] // (40 if short else 1)) if peer.delivers else ({}, {})
    if peer is Ours:  # which is measured beside each of the others
        return Row(peer, size, len(frame), None, None, {}, found, streamed)
    return Row(
        peer,
        size,
        len(frame),
        at_best(peer, size, pace),
        dirty(peer, size, pace) if peer.delivers else None,
        {
            name: in_chunks(peer, of_one_kind(size), chunk, pace)
            for name, chunk in (MIX_CHUNKS if short else CHUNKS).items()
        },
        found,
        streamed,
    )


def _recalls(peer: type[Peer], size: int, count: int) -> tuple[dict[str, Recall], dict[str, Recall]]:
    frames = [peer.frame(size, number) or b"" for number in range(count)]
    streams = {kind: damage(frames, size, kind) for kind in DAMAGES}
    found = {kind: recall(peer, stream, stream.chunks_for(peer, 64)) for kind, stream in streams.items()}
    if peer.feeding != "frames":
        return found, {}
    return found, {kind: recall(peer, stream, chunks(b"".join(stream.pieces), 64)) for kind, stream in streams.items()}
