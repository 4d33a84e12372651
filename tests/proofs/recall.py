"""How many intact frames of a noisy, padded, truncated, bit-flipped stream are found: all of them.

And how many of one that is worse than any line: each damaged frame has the right sum.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass
from random import Random
from typing import Any

from benchmarks.measuring import Result, table
from benchmarks.streams import damaged_line, lucky_line
from benchmarks.textbook import TextbookParser
from servolink.protocol import ByteOrder, Frame, FrameParser, encode_frame

_PER_STREAM = 2000  # intact frames in one stream; each has its own seed and byte order


@dataclass
class Recall:
    """What was sent intact, and what came out."""

    intact: int = 0
    found: int = 0
    false: int = 0
    """Frames that came out and were not sent: damaged ones whose sum is right by chance."""
    disordered: int = 0
    """Streams whose frames came out in another order."""

    @property
    def complete(self) -> bool:
        """Whether every intact frame was found, in its place."""
        return self.found == self.intact and not self.disordered

    def add(self, sent: list[bytes], frames: list[Frame], byte_order: ByteOrder) -> None:
        """Count one stream."""
        came = [encode_frame(*frame, byte_order) for frame in frames]
        found = (Counter(sent) & Counter(came)).total()
        self.intact += len(sent)
        self.found += found
        self.false += len(came) - found
        rest = iter(came)
        self.disordered += not all(frame in rest for frame in sent)


Line = Callable[[Random, int, ByteOrder], tuple[bytes, list[bytes]]]
"""Makes a stream with so many intact frames."""


def measure(parser: type[Any], intact: int, seed: int = 1, line: Line = damaged_line) -> Recall:
    """Feed streams with at least `intact` intact frames, randomly cut, to parsers of this class."""
    recall = Recall()
    while recall.intact < intact:
        random = Random(seed)
        byte_order: ByteOrder = "big" if seed % 2 else "little"
        stream, sent = line(random, _PER_STREAM, byte_order)
        parse, frames, at = parser(byte_order), [], 0
        longest = random.choice((1, 9, 200, 5000, 100_000))
        while at < len(stream):
            size = random.randint(1, longest)
            frames += parse.feed(stream[at : at + size])
            at += size
        if isinstance(parse, FrameParser):
            frames += parse.finish()
        recall.add(sent, frames, byte_order)
        seed += 1
    return recall


def run(*, short: bool) -> Result:
    """Measure 400,000 intact frames; anything but all of them is a failure."""
    intact = 10_000 if short else 400_000
    ours, theirs = measure(FrameParser, intact), measure(TextbookParser, min(intact, 40_000))
    lucky, theirs_lucky = (
        measure(kind, min(intact, 40_000), line=lucky_line) for kind in (FrameParser, TextbookParser)
    )
    quote = table(
        "Recall of intact frames on a damaged stream of all packets",
        ("parser", "damage", "intact", "found", "recall", "false frames"),
        [
            (name, damage, f"{r.intact:,}", f"{r.found:,}", f"{r.found / r.intact:.4%}", f"{r.false:,}")
            for name, damage, r in (
                ("servolink", "of all kinds", ours),
                ("textbook", "of all kinds", theirs),
                ("servolink", "the sum is right", lucky),
                ("textbook", "the sum is right", theirs_lucky),
            )
        ],
        [
            (
                "The sum is right: each damaged frame has lost bytes and ends within what follows, with the right sum. "
                "By chance one in 256 does. The rest are several such frames inside each other."
            )
        ],
    )
    wrong = [] if ours.complete else [f"{ours.intact - ours.found} of {ours.intact} intact frames lost or out of place"]
    return {
        "tables": [quote],
        "servolink": asdict(ours),
        "textbook": asdict(theirs),
        "lucky": asdict(lucky),
        "wrong": wrong,
    }
