"""In turns: servolink's parser, alone and with objects, and one other, each on its own format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

from benchmarks.measuring import Comparison, in_turns, timed
from benchmarks.peers.damage import Damaged, damage
from benchmarks.peers.ours import Ours, OursTyped
from benchmarks.peers.peer import Peer
from benchmarks.streams import chunks

_DIFFERENT = 64  # frames of one kind; a stream repeats them
_MIXED = 264  # of many kinds
_LONGEST = 1 << 24  # bytes of a stream
_STEADY = 0.1

Frames = Callable[[type[Peer]], list[bytes]]
"""The frames of a stream in the format of a parser; a shorter list than its stream, which repeats them."""
_Stream = Callable[[type[Peer]], tuple[list[bytes], int]]
"""For a parser: what to feed it, cut as it is to be fed, and the frames that it can find in that."""


@dataclass(frozen=True)
class Pace:
    """How exactly to measure."""

    rounds: int
    ms: float
    """CPU milliseconds of each side in a round, about."""
    tries: int
    """How often to measure at most, until the spread is below 10 %; the steadiest is taken."""


@dataclass(frozen=True)
class Speed:
    """One parser beside ours, on frames of about the same size."""

    ns: float
    """For each frame that it found, its own CPU time."""
    ours_ns: float
    times: Comparison
    """How many times faster ours is."""
    typed: Comparison
    """The same for ours with typed objects."""


def at_best(peer: type[Peer], size: int, pace: Pace) -> Speed | None:
    """Measure on nothing but frames, in chunks of 4 KiB or, for the other, as it needs them."""
    frames = of_one_kind(size)
    return _race(peer, lambda kind: _cut(kind, frames(kind), 4096 if kind.feeding == "chunks" else None), pace)


def in_chunks(peer: type[Peer], frames: Frames, chunk: int | None, pace: Pace) -> Speed | None:
    """Measure on nothing but frames, in chunks of so many bytes or (None) of one frame, both sides alike."""
    if chunk is not None and peer.feeding == "stream":
        return None
    return _race(peer, lambda kind: _cut(kind, frames(kind), chunk), pace)


def of_one_kind(size: int) -> Frames:
    """Return frames of about `size` bytes that differ in their contents only."""
    return lambda kind: [kind.frame(size, number) or b"" for number in range(_DIFFERENT)]


def of_many_kinds(sizes: tuple[int, ...]) -> Frames:
    """Return frames of as many kinds as the format has, of these sizes in turns."""
    return lambda kind: [kind.mixed(sizes[number % len(sizes)], number) or b"" for number in range(_MIXED)]


def dirty(peer: type[Peer], size: int, pace: Pace) -> Speed | None:
    """Measure on frames with noise between them and bytes replaced."""
    return _race(peer, lambda kind: _dirty(kind, size), pace)


def _cut(peer: type[Peer], frames: list[bytes], chunk: int | None) -> tuple[list[bytes], int]:
    """Return the stream of these frames as this parser is fed, and their number."""
    if peer.feeding == "stream":
        return [b"".join(frames)], len(frames)
    if chunk is None:
        return frames, len(frames)
    frames *= -(-chunk // sum(map(len, frames)))
    return chunks(b"".join(frames), chunk), len(frames)


def _dirty(peer: type[Peer], size: int) -> tuple[list[bytes], int]:
    frames = [peer.frame(size, number) or b"" for number in range(_DIFFERENT * 8)]
    damaged: Damaged = damage(frames, size, "both")
    return damaged.chunks_for(peer, 4096), len(damaged.intact)


def _race(peer: type[Peer], stream: _Stream, pace: Pace) -> Speed | None:
    """Return None if a side finds less than half of the frames."""
    sides: list[Callable[[], Callable[[], None]]] = []
    counts: list[int] = []
    for kind in (Ours, OursTyped, peer):
        pieces, count = stream(kind)
        if kind.delivers:
            parser, sent = kind(), count
            count = sum(len(parser.feed(piece)) for piece in pieces)
            if count < sent / 2:
                return None
        took = timed(_feeding(kind, pieces)())
        repeat = max(1, min(round(pace.ms * 1e6 / max(1, took)), _LONGEST // sum(map(len, pieces))))
        if kind.feeding == "stream":
            sides.append(_feeding(kind, [b"".join(pieces) * repeat]))
        else:
            sides.append(_feeding(kind, pieces * repeat))
        counts.append(count * repeat)
    tries: list[Speed] = []
    while len(tries) < pace.tries and all(speed.times.spread > _STEADY for speed in tries):
        times = in_turns(sides, pace.rounds)
        ours, typed, theirs = ([ns / count for ns in row] for row, count in zip(times, counts, strict=True))
        tries.append(Speed(median(theirs), median(ours), Comparison.of(ours, theirs), Comparison.of(typed, theirs)))
    return min(tries, key=lambda speed: speed.times.spread)


def _feeding(peer: type[Peer], pieces: list[bytes]) -> Callable[[], Callable[[], None]]:
    def prepare() -> Callable[[], None]:
        feed = peer().feed

        def work() -> None:
            for piece in pieces:
                feed(piece)

        return work

    return prepare
