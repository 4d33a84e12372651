"""How many intact frames of a noisy, padded, truncated, bit-flipped stream are found: all of them."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass
from random import Random
from typing import Any

from benchmarks.measuring import Result, table
from benchmarks.streams import damaged_line
from benchmarks.textbook import TextbookParser
from servolink.protocol.frame import ByteOrder, Frame, encode_frame
from servolink.protocol.parser import FrameParser

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


def measure(parser: type[Any], intact: int, seed: int = 1) -> Recall:
    """Feed streams with at least `intact` intact frames, randomly cut, to parsers of this class."""
    recall = Recall()
    while recall.intact < intact:
        random = Random(seed)
        byte_order: ByteOrder = "big" if seed % 2 else "little"
        stream, sent = damaged_line(random, _PER_STREAM, byte_order)
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
    shown = table(
        "Recall of intact frames on a damaged stream of all packets",
        ("parser", "intact", "found", "recall", "false frames"),
        [
            (name, f"{r.intact:,}", f"{r.found:,}", f"{r.found / r.intact:.4%}", r.false)
            for name, r in (("servolink", ours), ("textbook", theirs))
        ],
    )
    wrong = [] if ours.complete else [f"{ours.intact - ours.found} of {ours.intact} intact frames lost or out of place"]
    return {"tables": [shown], "servolink": asdict(ours), "textbook": asdict(theirs), "wrong": wrong}
