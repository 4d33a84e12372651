"""Bytes to typed packets and back: each of the 60, against the same packets declared with other tools."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.metadata import version
from statistics import median

from benchmarks.goals import Goal, at_least
from benchmarks.measuring import Comparison, Result, Table, in_turns, table, timed
from benchmarks.packet_codecs import Construct, Dataclasses, PacketCodec, plain
from benchmarks.samples import samples
from servolink.protocol.codec import Codec
from servolink.protocol.frame import HEADER_SIZE
from servolink.protocol.packet import Packet

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
        "tables": [_summary(ways)],
        "wrong": wrong,
        "goals": [*_beside_tools(ways)],
    }


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
    peer = Dataclasses.name
    for way in ("decoded", "encoded"):
        both = [each for each in ways if (each.peer, each.way) == (peer, way)]
        slower = [each for each in both if each.times.ratio < 1]
        names = ", ".join(each.packet for each in slower[:3]) + (", ..." if len(slower) > 3 else "")
        name = f"packets {way} faster than by {peer}" + (f"; not: {names}" if slower else "")
        yield at_least(name, len(both) - len(slower), len(both), f"{{:.0f}} of {len(both)}")
