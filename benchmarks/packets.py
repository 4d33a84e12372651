"""Bytes to typed packets and back: each of the 60, against the same packets declared with other tools."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib.metadata import version
from statistics import median
from struct import Struct

from benchmarks.goals import Goal, at_least
from benchmarks.measuring import Comparison, Result, Table, compare, in_turns, table, timed
from benchmarks.packet_codecs import Construct, Dataclasses, PacketCodec, plain
from benchmarks.samples import samples
from benchmarks.streams import TYPICAL, chunks
from benchmarks.textbook import TextbookParser
from servolink.protocol.codec import Codec
from servolink.protocol.frame import HEADER_SIZE
from servolink.protocol.packet import Packet
from servolink.protocol.parser import FrameParser

RECORDS_OF = {14: (0, Struct(">IB")), 186: (1, Struct(">BhhhhBB")), 3611: (2, Struct(">i32s"))}
"""By frame size: where the records begin in the content, and what they are."""
_PEERS: tuple[type[PacketCodec], ...] = (Dataclasses, Construct)


@dataclass(frozen=True)
class Pace:
    """How exactly to measure."""

    rounds: int
    ms: float
    """CPU milliseconds of each side in a round, about."""


@dataclass(frozen=True)
class Way:
    """One packet, decoded or encoded, by ours and by another."""

    packet: str
    peer: str
    way: str
    content: int
    """Bytes."""
    times: Comparison
    """How many times faster ours is; nanoseconds."""


def run(*, short: bool) -> Result:
    """Measure everything; a packet that comes out different is wrong, a goal missed is slow."""
    pace = Pace(3, 0.2) if short else Pace(9, 2.0)
    typical = [_typical(size, packet, short=short) for size, packet in TYPICAL.items()]
    peers, missing = _installed()
    wrong = [fault for peer in peers for fault in _differences(peer)]
    ways = [
        way
        for packet in samples()
        for way in _ways(packet, [peer for peer in peers if peer.knows(packet.packet_id)], pace)
    ]
    return {
        "versions": {peer.package: version(peer.package) for peer in peers if peer.package},
        "missing": missing,
        "tables": [_typical_table(typical), _summary(ways)],
        "typical": typical,
        "wrong": wrong,
        "goals": [*_beside_tools(ways)],
    }


def _typical(size: int, packet: Packet, *, short: bool) -> Result:
    """Measure decoding alone against tuples, and whole streams against the textbook's parser and dataclasses."""
    rounds, total = (3, 1 << 15) if short else (11, 1 << 20)
    frame = Codec("big").encode(packet)
    count = total // size
    content = frame[HEADER_SIZE:-1]
    found = compare(_decoding(packet.packet_id, content, count), _unpacking(size, content, count), rounds)
    pieces = chunks(frame * count, 4096)
    theirs = Dataclasses().decode
    whole = in_turns(
        [
            lambda: _stream(FrameParser("big").feed, Codec("big").decode, pieces),
            lambda: _stream(TextbookParser("big").feed, theirs, pieces),
        ],
        rounds,
    )
    return {
        "frame": size,
        "frames": count,
        "packets_per_second": round(count / median(whole[0]) * 1e9),
        "times_textbook": Comparison.of(*whole).ratio,
        **asdict(found),
        "times_of_tuples": 1 / found.ratio,
    }


def _decoding(packet_id: int, content: bytes, count: int) -> Callable[[], None]:
    decode_one = Codec("big").decode

    def decode() -> None:
        for _ in range(count):
            decode_one(packet_id, content)

    return decode


def _unpacking(size: int, content: bytes, count: int) -> Callable[[], None]:
    start, record = RECORDS_OF[size]

    def unpack() -> None:
        for _ in range(count):
            list(record.iter_unpack(content[start:]))

    return unpack


def _stream(
    feed: Callable[[bytes], list[tuple[int, bytes]]], decode: Callable[[int, bytes], object], pieces: list[bytes]
) -> Callable[[], None]:
    def parse() -> None:
        for piece in pieces:
            for packet_id, content in feed(piece):
                decode(packet_id, content)

    return parse


def _installed() -> tuple[list[PacketCodec], list[str]]:
    """Return the peers that there are, and the packages that are not."""
    peers, missing = [], []
    for peer in _PEERS:
        try:
            peers.append(peer())
        except ModuleNotFoundError:
            missing.append(peer.package)
    return peers, sorted({*missing})


def _differences(peer: PacketCodec) -> Iterator[str]:
    """Yield the packets that a peer reads or writes differently: then the comparison would be none."""
    codec = Codec("big")
    for packet in filter(lambda packet: peer.knows(packet.packet_id), samples()):
        frame = codec.encode(packet)
        theirs = peer.decode(packet.packet_id, frame[HEADER_SIZE:-1])
        if plain(theirs) != plain(packet) or peer.encode(packet.packet_id, theirs) != frame:
            yield f"{peer.name} reads or writes {type(packet).__name__} differently"


def _ways(packet: Packet, peers: list[PacketCodec], pace: Pace) -> Iterator[Way]:
    packet_id, codec = packet.packet_id, Codec("big")
    content = codec.encode(packet)[HEADER_SIZE:-1]
    decoders: list[Callable[[], object]] = [lambda: codec.decode(packet_id, content)]
    encoders: list[Callable[[], object]] = [lambda: codec.encode(packet)]
    for peer in peers:
        theirs = peer.decode(packet_id, content)
        decoders.append(lambda peer=peer: peer.decode(packet_id, content))  # type: ignore[misc]
        encoders.append(lambda peer=peer, theirs=theirs: peer.encode(packet_id, theirs))  # type: ignore[misc]
    for way, sides in (("decoded", decoders), ("encoded", encoders)):
        ours, *others = _measured(sides, pace)
        for peer, times in zip(peers, others, strict=True):
            yield Way(type(packet).__name__, peer.name, way, len(content), Comparison.of(ours, times))


def _measured(sides: list[Callable[[], object]], pace: Pace) -> list[list[float]]:
    """Return the nanoseconds of one call of each side, in each round."""
    counts = [max(1, round(pace.ms * 1e6 / max(1, timed(_often(side, 20)) / 20))) for side in sides]
    works = [_often(side, count) for side, count in zip(sides, counts, strict=True)]
    times = in_turns([lambda work=work: work for work in works], pace.rounds)  # type: ignore[misc]
    return [[ns / count for ns in row] for row, count in zip(times, counts, strict=True)]


def _often(side: Callable[[], object], count: int) -> Callable[[], None]:
    def work() -> None:
        for _ in range(count):
            side()

    return work


def _typical_table(typical: list[Result]) -> Table:
    return table(
        "Bytes to typed packets, in chunks of 4 KiB, and decoding alone against the bare tuples of `iter_unpack`",
        ("frame", "packets/s", "times the textbook", "decode ns", "tuples ns", "times of tuples", "spread"),
        [
            (
                case["frame"],
                f"{case['packets_per_second']:,}",
                f"{case['times_textbook']:.1f}x",
                *(f"{case[side] / case['frames']:,.0f}" for side in ("ours", "theirs")),
                f"{case['times_of_tuples']:.2f}",
                f"{case['spread']:.0%}",
            )
            for case in typical
        ],
        [
            "A button event, the state of 16 servos, a list of 100 actions with their captions.",
            "The textbook: its parser, and frozen dataclasses from `struct`.",
            (
                "Tuples: the records alone. Decoding also finds the packet's class, checks count and length, decodes "
                "the captions and makes an object of each record and of the packet."
            ),
        ],
    )


def _summary(ways: list[Way]) -> Table:
    rows = []
    for way in ("decoded", "encoded"):
        for peer in dict.fromkeys(each.peer for each in ways):
            times = sorted(each.times.ratio for each in ways if (each.peer, each.way) == (peer, way))
            faster = sum(ratio > 1 for ratio in times)
            rows.append(
                (way, peer, faster, len(times), f"{times[0]:.2f}x", f"{median(times):.2f}x", f"{times[-1]:.2f}x")
            )
    return table(
        "How many times faster than other tools on each of the 60 packets",
        ("way", "against", "faster on", "of", "least", "median", "most"),
        rows,
        [
            "Dataclasses: frozen, with slots, from `struct` formats that are compiled once. construct: compiled.",
            "servolink checks what it encodes: type and range of each value, and each caption.",
        ],
    )


def _beside_tools(ways: list[Way]) -> Iterator[Goal]:
    for way in ("decoded", "encoded"):
        for peer in dict.fromkeys(each.peer for each in ways):
            both = [each for each in ways if (each.peer, each.way) == (peer, way)]
            slower = [each for each in both if each.times.ratio < 1]
            names = ", ".join(each.packet for each in slower[:3]) + (", ..." if len(slower) > 3 else "")
            name = f"packets {way} faster than by {peer}" + (f"; not: {names}" if slower else "")
            yield at_least(name, len(both) - len(slower), len(both), f"{{:.0f}} of {len(both)}")
