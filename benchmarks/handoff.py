"""From a reading thread to the event loop: what a chunk costs in a burst, and how late one is that comes alone."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
from collections.abc import Callable
from statistics import median
from time import perf_counter_ns, process_time_ns

from benchmarks.goals import at_most
from benchmarks.handoff_ways import WAYS, Burst, Descriptor, NoThread, OurOwner, ToThread, Way
from benchmarks.loops import NewLoop, loops
from benchmarks.measuring import CORES, Result, Table, table
from benchmarks.neighbours import Neighbours

BURST_GOAL = 0.3
"""Microseconds of CPU per chunk."""
PACED_GOAL = 1.15
"""How many times the median delay of `add_reader`."""
_CHUNK = bytes(64)
_PACER = """
import os, random, sys, time
pause, rounds, *pipes = sys.argv[1:]
for _ in range(int(rounds)):
    random.shuffle(pipes)
    for pipe in pipes:
        time.sleep(float(pause))  # so that each chunk finds the reader waiting
        os.write(int(pipe), time.perf_counter_ns().to_bytes(8, "little"))
"""


def run(*, short: bool) -> Result:
    """Measure all ways on each loop."""
    result: Result = {"tables": [], "goals": [], "versions": {}, "cases": []}
    for name, new_loop in loops(result["versions"]):
        neighbours = Neighbours()
        bursts = _bursts(new_loop, 3 if short else 15, 2000 if short else 20_000)
        delays = _delays(new_loop, 100 if short else 3000)
        result["tables"].append(_table(name, bursts, delays, neighbours.note()))
        burst, paced = median(bursts[OurOwner]), median(delays[OurOwner]) / median(delays[NoThread])
        result["goals"] += [
            at_most(f"CPU per chunk of a burst, {name}", burst / 1000, BURST_GOAL, "{:.2f} µs"),
            at_most(f"delay of a chunk that comes alone over add_reader, {name}", paced, PACED_GOAL),
        ]
        result["cases"] += [
            {"loop": name, "way": way.name, "burst": bursts.get(way), "delays": sorted(delays[way])[:: len(WAYS) * 20]}
            for way in WAYS
        ]
    return result


def _bursts(new_loop: NewLoop, rounds: int, chunks: int) -> dict[type[Way], list[float]]:
    """Return the CPU nanoseconds per chunk of each round, for each way that has a thread."""
    found: dict[type[Way], list[float]] = {way: [] for way in WAYS if way is not NoThread}
    for _ in range(rounds):
        for way, costs in found.items():
            with asyncio.Runner(loop_factory=new_loop) as runner:
                costs.append(runner.run(_burst(way, chunks // 50 if way is ToThread else chunks)))
    return found


async def _burst(way: type[Way], chunks: int) -> float:
    over: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    missing = chunks * len(_CHUNK)

    def hear(chunk: bytes) -> None:
        nonlocal missing
        missing -= len(chunk)
        if not missing:
            over.set_result(process_time_ns())

    one = way(Burst(chunks, _CHUNK), hear)
    began = process_time_ns()
    await one.start()
    ended = await over
    await one.stop()
    return (ended - began) / chunks


def _delays(new_loop: NewLoop, times: int) -> dict[type[Way], list[int]]:
    """Return the nanoseconds from writing to hearing of rare chunks, which go to all ways in turns."""
    with asyncio.Runner(loop_factory=new_loop) as runner:
        return runner.run(_paced(times))


async def _paced(times: int) -> dict[type[Way], list[int]]:
    found: dict[type[Way], list[int]] = {way: [] for way in WAYS}
    pipes = [os.pipe() for _ in WAYS]
    ways = [way(Descriptor(read), _noting(found[way])) for way, (read, _) in zip(WAYS, pipes, strict=True)]
    for way in ways:
        await way.start()
    ends = [write for _, write in pipes]
    command = [sys.executable, "-c", _PACER, "0.001", str(times), *map(str, ends)]
    pacer = subprocess.Popen(command, pass_fds=ends)  # noqa: ASYNC220, S603 - our own program, begun once
    if CORES:
        os.sched_setaffinity(pacer.pid, {CORES[0]})
    await asyncio.to_thread(pacer.wait)
    await asyncio.sleep(0.1)  # for the last one
    await ways[0].stop()
    for end in ends:
        os.close(end)  # which wakes the threads
    for way in ways[1:]:
        await way.stop()
    for read, _ in pipes:
        os.close(read)
    return found


def _noting(delays: list[int]) -> Callable[[bytes], None]:
    def note(stamps: bytes) -> None:
        heard = perf_counter_ns()
        delays.extend(heard - int.from_bytes(stamps[at : at + 8], "little") for at in range(0, len(stamps), 8))

    return note


def _table(loop: str, bursts: dict[type[Way], list[float]], delays: dict[type[Way], list[int]], others: str) -> Table:
    def burst(way: type[Way]) -> tuple[str, str]:
        if way not in bursts:
            return "-", "-"
        costs = sorted(bursts[way])
        middle = median(costs)
        return f"{middle / 1000:.2f}", f"{(costs[len(costs) * 3 // 4] - costs[len(costs) // 4]) / 2 / middle:.0%}"

    def paced(way: type[Way]) -> tuple[str, ...]:
        ordered, least = sorted(delays[way]), median(delays[NoThread])
        late = [ordered[len(ordered) * percent // 100] for percent in (50, 99)]
        return (*(f"{delay / 1000:.1f}" for delay in late), f"{median(ordered) / least:.2f}x")

    return table(
        f"from a thread to the event loop, {loop}, µs",
        ("way", "burst, CPU per chunk", "spread", "alone, p50", "alone, p99", "p50 / add_reader"),
        [(way.name, *burst(way), *paced(way)) for way in WAYS],
        [
            f"Burst: chunks of {len(_CHUNK)} bytes are there at once; the cost includes reading and delivering them.",
            "Alone: another process writes to a pipe every millisecond, to each way in random order; until delivery.",
            "Spread: half the distance between the quartiles of the rounds.",
            others,
        ],
    )
