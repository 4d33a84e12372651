"""What the parser alone makes of each line: intact frames found, damaged ones believed, and how late."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from random import Random

from benchmarks.measuring import Result, table
from benchmarks.reliability.line import LINES, Direction, Line
from benchmarks.reliability.witness import Witness
from servolink.protocol.codec import Codec
from servolink.protocol.editing import ActionEntry, AddActionResponse, QueryActionListResponse, QueryProjectIDResponse
from servolink.protocol.frame import HEADER_SIZE, Frame
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser
from servolink.protocol.servos import QueryServoResponse, ServoState, SetServoParameterResponse
from servolink.protocol.settings import QueryMemorySizeResponse, QueryRemainPowerResponse

_LISTS = 0.2  # of mixed traffic
_LONGEST_LIST = 30
_CHUNK = 62  # bytes in a packet of a USB serial adapter
_FLOORS = {"short answers": 0.99997, "mixed with lists": 0.9998}
"""The best that was reached on the worst of these lines before there was this parser."""

_SHORT: tuple[Callable[[Random], Packet], ...] = (
    lambda random: AddActionResponse(random.randrange(256)),
    lambda random: QueryRemainPowerResponse(random.randrange(1001)),
    lambda random: SetServoParameterResponse(random.randrange(1, 17), 1, random.randrange(2)),
    lambda random: QueryProjectIDResponse(random.randrange(1 << 31)),
    lambda random: ButtonEventResponse(random.randrange(1 << 16), 1),
    lambda random: QueryMemorySizeResponse(random.randrange(1 << 16), 1 << 16),
    lambda random: QueryServoResponse((ServoState(random.randrange(1, 17), random.randrange(181), 90, 400, 1, 1, 1),)),
)


@dataclass(slots=True)
class Found:
    """What was sent, and what came out."""

    intact: int
    found: int
    damaged: int
    believed: int
    """Frames that came out beyond those that arrived whole."""
    delay: int
    """Most bytes that came after an intact frame before it was found."""

    @property
    def recall(self) -> float:
        """The share of intact frames that were found."""
        return self.found / self.intact


class _Listener:
    """A parser behind a line, with what was sent whole and what came out."""

    def __init__(self) -> None:
        self.sent: Counter[Frame] = Counter()
        self.came: Counter[Frame] = Counter()
        self.delay = 0
        self._parser = FrameParser()
        self._witness = Witness()
        self._fed = 0

    def expect(self, frame: Frame, end: int) -> None:
        self.sent[frame] += 1
        self._witness.expect(frame, end)

    def hear(self, chunk: bytes) -> None:
        self._fed += len(chunk)
        for frame in self._parser.feed(chunk):
            self.came[frame] += 1
            if (end := self._witness.recognise(frame)) is not None:
                self.delay = max(self.delay, self._fed - end)

    def finish(self) -> None:
        self.came.update(self._parser.finish())


def listen(line: Line, frames: int, seed: int, *, lists: bool) -> Found:
    """Parse what arrives of so many frames over `line`."""
    random = Random(f"framing {seed} {line.name} {lists}")
    codec, direction, listener = Codec(), Direction(line, random), _Listener()
    arrived, damaged, buffer, chunk = 0, 0, b"", line.reports or _CHUNK
    for _ in range(frames):
        packet = _list(random) if lists and random.random() < _LISTS else random.choice(_SHORT)(random)
        frame = codec.encode(packet)
        arriving, whole = direction.carry(frame)
        if whole:
            end = arrived + arriving.index(frame) + len(frame)
            listener.expect((packet.packet_id, frame[HEADER_SIZE:-1]), end)
        damaged += not whole
        arrived += len(arriving)
        buffer += arriving
        while len(buffer) >= chunk:
            listener.hear(buffer[:chunk])
            buffer = buffer[chunk:]
    listener.hear(buffer)
    listener.finish()
    found = (listener.sent & listener.came).total()
    return Found(listener.sent.total(), found, damaged, listener.came.total() - found, listener.delay)


def _list(random: Random) -> Packet:
    actions = (ActionEntry(at, f"action {random.randrange(1000)}") for at in range(random.randint(1, _LONGEST_LIST)))
    return QueryActionListResponse(tuple(actions))


def run(*, short: bool, seed: int = 1) -> Result:
    """Listen to 400,000 short and 300,000 mixed frames on each line; the parser has no clock, so no line stalls."""
    frames = {"short answers": 4_000 if short else 400_000, "mixed with lists": 2_000 if short else 300_000}
    rows, figures, wrong = [], {}, []
    for traffic, count in frames.items():
        for line in LINES:
            if line.stalls and not line.damages:
                continue
            found = listen(line, count, seed, lists=traffic != "short answers")
            if found.recall < _FLOORS[traffic]:
                wrong.append(f"{line.name}, {traffic}: {found.intact - found.found} of {found.intact} not found")
            figures[f"{line.name}, {traffic}"] = {name: getattr(found, name) for name in Found.__slots__}
            rows.append(_row(line, traffic, found))
    shown = table(
        "what the parser makes of each line",
        ("line", "frames", "intact", "found", "recall", "damaged", "believed", "per million damaged", "latest"),
        rows,
        notes=[
            "`believed`: frames that came out beyond those that arrived whole",
            "`latest`: most bytes that came between the end of an intact frame and its being found",
        ],
    )
    return {"tables": [shown], "wrong": wrong, "figures": figures}


def _row(line: Line, traffic: str, found: Found) -> tuple[str, ...]:
    share = f"{found.believed / found.damaged * 1e6:,.0f}" if found.damaged else ""
    return (
        line.name,
        traffic,
        f"{found.intact:,}",
        f"{found.found:,}",
        f"{found.recall:.4%}",
        f"{found.damaged:,}",
        f"{found.believed:,}",
        share,
        f"{found.delay:,} B",
    )
