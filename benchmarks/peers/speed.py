"""In turns: servolink's parser, alone and with objects, and one other, each on its own format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

from benchmarks.measuring import Comparison, in_turns, timed
from benchmarks.peers.ours import Ours, OursTyped
from benchmarks.peers.peer import Peer
from benchmarks.streams import chunks

_DIFFERENT = 64  # frames; a stream repeats them
_LONGEST = 1 << 24  # bytes of a stream
_STEADY = 0.1

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
    return _race(peer, lambda kind: _cut(kind, size, 4096 if kind.feeding == "chunks" else None), pace)


def _cut(peer: type[Peer], size: int, chunk: int | None) -> tuple[list[bytes], int]:
    """Return a stream of frames that differ in their contents only, cut as this parser is fed, and their number."""
    frames = [peer.frame(size, number) or b"" for number in range(_DIFFERENT)]
    if peer.feeding == "stream":
        return [b"".join(frames)], len(frames)
    if chunk is None:
        return frames, len(frames)
    frames *= -(-chunk // sum(map(len, frames)))
    return chunks(b"".join(frames), chunk), len(frames)


def _race(peer: type[Peer], stream: _Stream, pace: Pace) -> Speed | None:
    """Return None if a side finds less than half of the frames."""
    sides: list[Callable[[], Callable[[], None]]] = []
    counts: list[int] = []
    for kind in (Ours, OursTyped, peer):
        pieces, count = stream(kind)
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
