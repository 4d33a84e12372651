"""What the parser alone makes of each line: intact frames found, damaged ones believed, and how late."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from random import Random

from benchmarks.measuring import Result, table
from servolink.connection import NestedFrameFilter
from servolink.protocol import (
    HEADER,
    HEADER_SIZE,
    ActionEntry,
    AddActionResponse,
    ButtonEventResponse,
    Codec,
    Frame,
    FrameParser,
    Packet,
    QueryActionListResponse,
    QueryMemorySizeResponse,
    QueryProjectIDResponse,
    QueryRemainPowerResponse,
    QueryServoResponse,
    ServoState,
    SetServoParameterResponse,
)
from tests.proofs.reliability.line import LINES, Direction, Line
from tests.proofs.reliability.witness import Witness

_LISTS = 0.2  # of mixed traffic
_LONGEST_LIST = 30
_CHUNK = 62  # bytes in a packet of a USB serial adapter
_FLOORS = {"short answers": 0.99997, "mixed with lists": 0.9998}
"""The best that was reached on the worst of these lines before there was this parser."""

_CODEC = Codec()
_SHORT: tuple[Callable[[Random], Packet], ...] = (
    lambda random: AddActionResponse(random.randrange(256)),
    lambda random: QueryRemainPowerResponse(random.randrange(1001)),
    lambda random: SetServoParameterResponse(random.randrange(1, 17), 1, random.randrange(2)),
    lambda random: QueryProjectIDResponse(random.randrange(1 << 31)),
    lambda random: ButtonEventResponse(random.randrange(1 << 16), 1),
    lambda random: QueryMemorySizeResponse(random.randrange(1 << 16), 1 << 16),
    lambda random: QueryServoResponse((ServoState(random.randrange(1, 17), random.randrange(181), 90, 400, 1, 1, 1),)),
)


class Listener:
    """A parser behind a line, with what was sent whole and what came out."""

    def __init__(self) -> None:
        """Begin to listen."""
        self.sent: Counter[Frame] = Counter()
        self.came: Counter[Frame] = Counter()
        self.passed: Counter[Frame] = Counter()
        """What of that a client takes."""
        self.damaged = 0
        self.delay = 0
        """Most bytes that came after an intact frame before it was found."""
        self._parser = FrameParser()
        self._carrier = NestedFrameFilter("little")
        self._witness = Witness()
        self._fed = 0

    def expect(self, frame: Frame, end: int) -> None:
        """Note that `frame` comes whole and ends at this byte of the stream."""
        self.sent[frame] += 1
        self._witness.expect(frame, end)

    def hear(self, chunk: bytes) -> None:
        """Take the next bytes."""
        self._fed += len(chunk)
        for frame in self._parser.feed(chunk):
            self.came[frame] += 1
            self.passed[frame] += not self._carrier.hides(frame)
            if (end := self._witness.recognise(frame)) is not None:
                self.delay = max(self.delay, self._fed - end)

    def finish(self) -> None:
        """Take the end of the stream."""
        self.came.update(self._parser.finish())


def listen(line: Line, draw: Callable[[Random], bytes], frames: int, seed: str) -> Listener:
    """Parse what arrives over `line` of so many frames that are drawn."""
    random = Random(seed)
    direction, listener = Direction(line, random), Listener()
    arrived, buffer, chunk = 0, b"", line.reports or _CHUNK
    for _ in range(frames):
        frame = draw(random)
        arriving, whole = direction.carry(frame)
        if whole:
            _, packet_id, _ = HEADER["little"].unpack_from(frame)
            listener.expect((packet_id, frame[HEADER_SIZE:-1]), arrived + arriving.index(frame) + len(frame))
        listener.damaged += not whole
        arrived += len(arriving)
        buffer += arriving
        while len(buffer) >= chunk:
            listener.hear(buffer[:chunk])
            buffer = buffer[chunk:]
    listener.hear(buffer)
    listener.finish()
    return listener


def short_answer(random: Random) -> bytes:
    """Draw an answer of at most 21 bytes."""
    return _CODEC.encode(random.choice(_SHORT)(random))


def _mixed(random: Random) -> bytes:
    return _list(random) if random.random() < _LISTS else short_answer(random)


def _list(random: Random) -> bytes:
    actions = (ActionEntry(at, f"action {random.randrange(1000)}") for at in range(random.randint(1, _LONGEST_LIST)))
    return _CODEC.encode(QueryActionListResponse(tuple(actions)))


def run(*, short: bool, seed: int = 1) -> Result:
    """Listen to 400,000 short and 300,000 mixed frames on each line; the parser has no clock, so no line stalls."""
    frames = {"short answers": 4_000 if short else 400_000, "mixed with lists": 2_000 if short else 300_000}
    rows, figures, wrong = [], {}, []
    for traffic, count in frames.items():
        for line in LINES:
            if line.stalls and not line.damages:
                continue
            draw = short_answer if traffic == "short answers" else _mixed
            heard = _figures(listen(line, draw, count, f"framing {seed} {line.name} {traffic}"))
            figures[f"{line.name}, {traffic}"] = heard
            rows.append(_row(line, traffic, heard))
            if heard["found"] < _FLOORS[traffic] * heard["intact"]:
                wrong.append(f"{line.name}, {traffic}: {heard['found']} of {heard['intact']} intact frames were found")
    quote = table(
        "what the parser finds on each line",
        ("line", "frames", "intact", "found", "recall", "damaged", "believed", "per million damaged", "latest"),
        rows,
        notes=[
            "`believed`: frames that came out beyond those that arrived whole",
            "`latest`: the most bytes between the end of an intact frame and its detection",
        ],
    )
    return {"tables": [quote], "wrong": wrong, "figures": figures}


def _figures(listener: Listener) -> dict[str, int]:
    found = (listener.sent & listener.came).total()
    return {
        "intact": listener.sent.total(),
        "found": found,
        "damaged": listener.damaged,
        "believed": listener.came.total() - found,
        "delay": listener.delay,
    }


def _row(line: Line, traffic: str, heard: dict[str, int]) -> tuple[str, ...]:
    damaged, believed = heard["damaged"], heard["believed"]
    return (
        line.name,
        traffic,
        f"{heard['intact']:,}",
        f"{heard['found']:,}",
        f"{heard['found'] / heard['intact']:.4%}",
        f"{damaged:,}",
        f"{believed:,}",
        f"{believed / damaged * 1e6:,.0f}" if damaged else "",
        f"{heard['delay']:,} B",
    )
