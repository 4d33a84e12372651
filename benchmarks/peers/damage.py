"""The same kind of damage to streams of every format, and how many intact frames are found in it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from random import Random

from benchmarks.peers.peer import Peer
from benchmarks.streams import chunks

DAMAGES = {"noise": (True, False), "corruption": (False, True), "both": (True, True)}
"""By name: whether there is something between the frames, and whether bytes of the frames are replaced."""

_REPLACED = {14: 0.01, 186: 0.003}
"""Share of bytes, by frame size, so that most frames stay intact."""


@dataclass
class Damaged:
    """A stream in pieces, each a frame or what lies between two, and the frames of it that are intact."""

    pieces: list[bytes]
    intact: list[bytes]

    def chunks_for(self, peer: type[Peer], size: int) -> list[bytes]:
        """Return the stream in chunks of `size` bytes, or as this parser needs it."""
        if peer.feeding == "frames":
            return self.pieces
        stream = b"".join(self.pieces)
        return [stream] if peer.feeding == "stream" else chunks(stream, size)


@dataclass
class Recall:
    """What became of a damaged stream."""

    intact: int
    found: int
    false: int
    """Frames that came out and were not sent so."""

    @property
    def share(self) -> float:
        """Intact frames found."""
        return self.found / self.intact


def damage(frames: list[bytes], size: int, kind: str, seed: int = 1) -> Damaged:
    """Return `frames` with something in 40 % of the gaps, or bytes replaced, or both."""
    random = Random(seed)
    noisy, corrupt = DAMAGES[kind]
    pieces: list[bytes] = []
    intact: list[bytes] = []
    for frame in frames:
        if noisy and random.random() < 0.4:
            pieces.append(_between(random.choice(frames), random))
        sent = _corrupted(frame, _REPLACED[size], random) if corrupt else frame
        pieces.append(sent)
        if sent == frame:
            intact.append(frame)
    return Damaged(pieces, intact)


def _corrupted(frame: bytes, share: float, random: Random) -> bytes:
    changed = bytearray(frame)
    at = int(random.expovariate(share))  # how far it is to the next byte that is replaced
    while at < len(frame):
        changed[at] ^= random.randrange(1, 256)
        at += 1 + int(random.expovariate(share))
    return bytes(changed)


def _between(frame: bytes, random: Random) -> bytes:
    """Return noise, padding, or a part of a frame."""
    kind = random.randrange(4)
    if kind == 0:
        return random.randbytes(random.randrange(1, 40))
    if kind == 1:
        return bytes(random.randrange(1, 64))
    cut = random.randrange(1, len(frame))
    return frame[:cut] if kind == 2 else frame[cut:]


def recall(peer: type[Peer], damaged: Damaged, fed: list[bytes]) -> Recall:
    """Count what the parser finds in the damaged stream when it is fed like this."""
    parser, found = peer(), Counter[bytes]()
    for chunk in fed:
        found.update(map(parser.content, parser.feed(chunk)))
    alone = peer()  # what an intact frame is known by is what becomes of it on a clean line
    sent = Counter(alone.content(frame) for intact in damaged.intact for frame in alone.feed(intact))
    right = (sent & found).total()
    return Recall(sent.total(), right, found.total() - right)
