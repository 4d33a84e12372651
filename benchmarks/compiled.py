"""The compiled loops: the parser beside pure Python and a parser made with Cython, and records beside bare tuples."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from statistics import median
from types import ModuleType
from typing import Any

from benchmarks.loading import loops, use, using
from benchmarks.measuring import Comparison, Result, Table, in_turns, table
from benchmarks.packets import RECORDS_OF, TIMES_OF_TUPLES
from benchmarks.peers import installed
from benchmarks.peers.ours import Ours
from benchmarks.peers.peer import Peer
from benchmarks.streams import TYPICAL, chunks, dirty
from servolink.protocol.codec import Codec
from servolink.protocol.frame import HEADER_SIZE
from servolink.protocol.parser import FrameParser

CHUNKS = (64, 4096)
AHEAD = (14, 186)
"""Frame sizes, in chunks of 4 KiB, on which the compiled parser is to be ahead of aioesphomeapi."""

Side = Callable[[], Callable[[], object]]


def run(*, short: bool) -> Result:
    """Measure everything that can be compiled and is installed; a goal missed is a failure."""
    rounds, total = (3, 1 << 16) if short else (11, 1 << 20)
    module, origin = loops()
    if module is None:
        print(f"nothing is compiled here: {origin}")
        return {"tables": [], "compiled": origin}
    peers = [peer for peer in installed()[0] if peer.package == "aioesphomeapi"]
    with using(module):
        speeds = [_speed(module, peers, size, chunk, rounds, total) for size in TYPICAL for chunk in CHUNKS]
        damaged = [_damaged(module, size, rounds, total) for size in TYPICAL]
        records = [_records(module, size, rounds, total) for size in TYPICAL]
    return {
        "versions": {peer.package: version(peer.package) for peer in peers},
        "compiled": origin,
        "tables": [_speed_table(speeds, peers), _damaged_table(damaged), _record_table(records)],
        "parser": speeds,
        "dirty": damaged,
        "records": records,
        "slow": [*_behind(speeds), *_above(records)],
    }


def _using(module: ModuleType | None, side: Side) -> Side:
    """Return `side` as it is with these loops."""

    def prepare() -> Callable[[], object]:
        use(module)
        return side()

    return prepare


def _speed(
    module: ModuleType, peers: list[type[Peer]], size: int, chunk: int, rounds: int, total: int
) -> dict[str, Any]:
    """Return the nanoseconds for each frame of a clean stream: pure Python, compiled, and the others."""
    sides: list[Side] = []
    counts: list[int] = []
    kinds: list[type[Peer]] = [Ours, Ours, *peers]
    for kind in kinds:
        frame = kind.frame(size, 7) or b""
        counts.append(total // len(frame))
        sides.append(_feeding(kind, chunks(frame * counts[-1], chunk)))
    sides[:2] = _using(None, sides[0]), _using(module, sides[1])
    times = [[ns / count for ns in row] for row, count in zip(in_turns(sides, rounds), counts, strict=True)]
    return {
        "frame": size,
        "chunk": chunk,
        "ns": dict(zip(["pure", "compiled", *(peer.name for peer in peers)], map(median, times), strict=True)),
        "times_pure": Comparison.of(times[1], times[0]).ratio,
        "times": {peer.name: Comparison.of(times[1], row).ratio for peer, row in zip(peers, times[2:], strict=True)},
    }


def _feeding(kind: type[Peer], pieces: list[bytes]) -> Side:
    def prepare() -> Callable[[], object]:
        kind().feed(b"".join(pieces[:2]))  # lays out again what `use` has forgotten
        feed = kind().feed

        def work() -> None:
            for piece in pieces:
                feed(piece)

        return work

    return prepare


def _damaged(module: ModuleType, size: int, rounds: int, total: int) -> dict[str, Any]:
    """Return the nanoseconds for each frame of a stream of which one frame in 20 is damaged, both ways."""
    stream = dirty(size, total)
    frames = len(FrameParser().feed(stream))
    side = _feeding(Ours, chunks(stream, 4096))
    pure, fast = in_turns([_using(None, side), _using(module, side)], rounds)
    return {
        "frame": size,
        "pure": median(pure) / frames,
        "compiled": median(fast) / frames,
        "times_pure": Comparison.of(fast, pure).ratio,
    }


def _records(module: ModuleType, size: int, rounds: int, total: int) -> dict[str, Any]:
    """Return the nanoseconds of a packet: bare tuples, and decoded both ways."""
    packet = TYPICAL[size]
    packet_id, content = packet.packet_id, Codec("big").encode(packet)[HEADER_SIZE:-1]
    start, record = RECORDS_OF[size]
    count = total // size

    def decoding() -> Callable[[], object]:
        decode = Codec("big").decode
        return _often(lambda: decode(packet_id, content), count)

    def unpacking() -> Callable[[], object]:
        return _often(lambda: list(record.iter_unpack(content[start:])), count)

    times = in_turns([_using(None, decoding), _using(module, decoding), unpacking], rounds)
    pure, fast, tuples = ([ns / count for ns in row] for row in times)
    return {
        "frame": size,
        "pure": median(pure),
        "compiled": median(fast),
        "tuples": median(tuples),
        "times_of_tuples": {"pure": Comparison.of(tuples, pure).ratio, "compiled": Comparison.of(tuples, fast).ratio},
    }


def _often(work: Callable[[], object], count: int) -> Callable[[], object]:
    def repeat() -> None:
        for _ in range(count):
            work()

    return repeat


def _speed_table(speeds: list[dict[str, Any]], peers: list[type[Peer]]) -> Table:
    names = [peer.name for peer in peers]
    return table(
        "Parser, ns for each frame: pure Python, compiled, and others on their own format",
        ("frame", "chunk", "pure", "compiled", *names, "times pure", *(f"times {name}" for name in names)),
        [
            (
                case["frame"],
                case["chunk"],
                *(f"{ns:,.0f}" for ns in case["ns"].values()),
                f"{case['times_pure']:.1f}x",
                *(f"{case['times'][name]:.2f}x" for name in names),
            )
            for case in speeds
        ],
        [
            (
                "servolink checks id, length and checksum and finds the frames behind damage; aioesphomeapi's "
                "plain-text framer, made with Cython, splits by length and ends the connection at the first wrong byte."
            )
        ]
        if peers
        else ["aioesphomeapi is not installed: `pip install -e '.[bench]'`."],
    )


def _damaged_table(damaged: list[dict[str, Any]]) -> Table:
    return table(
        "The same with one frame in 20 damaged, in chunks of 4 KiB",
        ("frame", "pure", "compiled", "times pure"),
        [
            (case["frame"], f"{case['pure']:,.0f}", f"{case['compiled']:,.0f}", f"{case['times_pure']:.1f}x")
            for case in damaged
        ],
    )


def _record_table(records: list[dict[str, Any]]) -> Table:
    return table(
        "Contents to typed packets, ns, and how many times as long as the bare tuples of `struct.iter_unpack`",
        ("frame", "tuples", "pure", "compiled", "pure, times", "compiled, times"),
        [
            (
                case["frame"],
                *(f"{case[way]:,.0f}" for way in ("tuples", "pure", "compiled")),
                *(f"{case['times_of_tuples'][way]:.2f}" for way in ("pure", "compiled")),
            )
            for case in records
        ],
    )


def _behind(speeds: list[dict[str, Any]]) -> list[str]:
    return [
        f"{1 / ratio:.2f} times as long as {name} for a frame of {case['frame']} bytes, which was to be overtaken"
        for case in speeds
        if case["chunk"] == 4096 and case["frame"] in AHEAD
        for name, ratio in case["times"].items()
        if name == "aioesphomeapi" and ratio < 1
    ]


def _above(records: list[dict[str, Any]]) -> list[str]:
    times = next(case["times_of_tuples"]["compiled"] for case in records if case["frame"] == 186)
    if times <= TIMES_OF_TUPLES:
        return []
    return [f"the state of 16 servos takes {times:.2f} times as long as bare tuples, the goal is {TIMES_OF_TUPLES}"]
