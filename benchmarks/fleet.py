"""Many boards through one broker on one machine: what arrives, how soon boards answer and stop, and what it costs."""

from __future__ import annotations

import asyncio
import os
import secrets
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from statistics import median
from time import perf_counter, process_time

import msgspec
from msgspec import Struct
from paho.mqtt.client import MQTTMessage
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from benchmarks.fleet_processes import Worker, broker, echo, workers
from benchmarks.fleet_worker import ECHO, MACRO, BareClient
from benchmarks.goals import Goal, at_least, at_most
from benchmarks.measuring import CORES, Result, Table, percentile, table
from servolink.fleet.access import parse_broker
from servolink.fleet.client import Fleet, connect
from servolink.fleet.publish_packets import Received

COUNTS = (1, 10, 50, 200)
HZ = 10.0
DELIVERED = 99.0  # percent of the samples
ROUND_TRIP = 2.0  # times that of bare paho-mqtt
STOPPED = 0.3  # seconds until the last board has stopped, 99 times in 100
SPREAD = 0.02  # seconds between the first and the last start, 99 times in 100
_SETTLE = 1.0  # seconds until all boards send
_REPEATED, _PATIENCE = 0.9, 5.0  # seconds after which a stop is sent again, and until none is on its way


class _Sample(Struct):
    number: int
    missed: int


@dataclass
class Samples:
    """The states of servos that came from the boards."""

    received: int = 0
    lost: int = 0
    """Sent by a board and not received: gaps of the numbers."""
    left_out: int = 0
    """Read and not sent, because the network was slow."""
    _latest: dict[str, int] = field(default_factory=dict)

    def take(self, topic: str, payload: bytes) -> None:
        """Count a message."""
        sample = msgspec.json.decode(payload, type=_Sample)
        before = self._latest.get(topic)
        self._latest[topic] = sample.number
        if before is None:
            return
        self.received += 1
        self.lost += max(0, sample.number - before - 1)
        self.left_out += sample.missed


@dataclass
class Case:
    """What was measured with so many boards."""

    boards: int
    seconds: float = 0.0
    samples: Samples = field(default_factory=Samples)
    cpu: float = 0.0
    """Of the processes with the boards, as a share of a core."""
    cpu_of_watcher: float = 0.0
    memory: float = 0.0
    """Bytes of the processes with the boards."""
    stops: list[float] = field(default_factory=list)
    spreads: list[float] = field(default_factory=list)

    @property
    def delivered(self) -> float:
        """Percent of the samples that arrived: of those that were read, and of those that the rate asks for."""
        samples = self.samples
        read = samples.received + samples.lost + samples.left_out
        return 100 * samples.received / max(1.0, read, self.boards * HZ * self.seconds)


def run(*, short: bool) -> Result:
    """Measure round trips, then each number of boards."""
    if CORES:
        os.sched_setaffinity(0, CORES)
    counts = (1, 10) if short else COUNTS
    with broker() as url:
        ours, bare, changes = asyncio.run(_round_trips(url, 200 if short else 5000))
        seconds, rounds = (2.0, 3) if short else (30.0, 100)
        cases = [asyncio.run(_measure(url, count, seconds, rounds)) for count in counts]
    wrong = [f"{case.boards} boards: no sample came" for case in cases if not case.samples.received]
    return {
        "tables": [_trip_table(ours, bare, changes), _sample_table(cases), _together_table(cases)],
        "goals": [*_goals(ours, bare, cases)],
        "wrong": wrong,
        "cases": [
            {
                "boards": case.boards,
                "delivered_percent": case.delivered,
                "lost": case.samples.lost,
                "left_out": case.samples.left_out,
                "cpu_per_board": case.cpu / case.boards,
                "memory_per_board": case.memory / case.boards,
                "stops": case.stops,
                "spreads": case.spreads,
            }
            for case in cases
        ],
    }


# --- round trips ------------------------------------------------------------------------------------------------------


async def _round_trips(url: str, times: int) -> tuple[list[float], list[float], list[float]]:
    """Return the seconds of queries of a board, of a message to a bare program and back, and of commands that change.

    They take turns.
    """
    ours: list[float] = []
    bare: list[float] = []
    changes: list[float] = []
    ready = {"servo": "all", "start": True, "hold": True}
    address = parse_broker(url)
    with workers(url, 1, 0.0) as _, echo(url):
        loop = asyncio.get_running_loop()
        echoes: asyncio.Queue[None] = asyncio.Queue()
        reply = f"bare/{secrets.token_hex(4)}"

        def take(_: MQTTMessage) -> None:
            loop.call_soon_threadsafe(echoes.put_nowait, None)

        client = BareClient(address, reply, take)
        async with connect(url, groups={}) as fleet:
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.ResponseTopic = reply
            payload = b'{"id":"12345678","method":"board.state"}'
            for at in range(-20, times):
                began = perf_counter()
                await fleet.call("bench0", "board.state")
                between = perf_counter()
                client.client.publish(ECHO, payload, 1, properties=properties)
                await echoes.get()
                echoed = perf_counter()
                await fleet.call("bench0", "servo.set", ready)
                if at >= 0:
                    ours.append(between - began)
                    bare.append(echoed - between)
                    changes.append(perf_counter() - echoed)
        client.close()
    return ours, bare, changes


# --- many boards ------------------------------------------------------------------------------------------------------


async def _measure(url: str, count: int, seconds: float, rounds: int) -> Case:
    case = Case(count)
    with workers(url, count, HZ) as processes:
        await _watch(url, processes, case, seconds)
        async with connect(url, groups={}) as fleet:
            await fleet.list()
            for _ in range(rounds):
                await _start_and_stop(fleet, case)
    return case


async def _watch(url: str, processes: list[Worker], case: Case, seconds: float) -> None:
    """Count the samples that come within `seconds`, and what they cost."""
    fleet = connect(url, groups={}, servos=True)
    receive, samples = fleet.controller.broker.on_message, case.samples

    def count(message: Received) -> None:
        if message.topic.endswith("/servos"):
            samples.take(message.topic, message.payload)
        receive(message)

    fleet.controller.broker.on_message = count
    async with fleet:
        await asyncio.sleep(_SETTLE)
        samples.received = samples.lost = samples.left_out = 0
        before, began, mine = [worker.used() for worker in processes], perf_counter(), process_time()
        await asyncio.sleep(seconds)
        case.seconds = perf_counter() - began
        case.samples = replace(samples)
    after = [worker.used() for worker in processes]
    case.cpu_of_watcher = (process_time() - mine) / case.seconds
    case.cpu = sum(one["cpu"] - two["cpu"] for one, two in zip(after, before, strict=True)) / case.seconds
    case.memory = sum(one["memory"] for one in after)


async def _start_and_stop(fleet: Fleet, case: Case) -> None:
    """Start all boards together, and stop them while they move."""
    await _hold_servos(fleet)
    ran = await fleet.run(MACRO)
    if len(ran.started) != case.boards:
        raise SystemExit(f"{len(ran.started)} of {case.boards} boards started: {list(ran.failed.values())[:3]}")
    case.spreads.append(ran.spread or 0.0)
    await _stop(fleet, case)


async def _hold_servos(fleet: Fleet) -> None:
    ready = {"servo": "all", "start": True, "hold": True}  # a stopped servo ignores movements
    await asyncio.gather(*(fleet.call(board, "servo.set", ready) for board in fleet.boards()))


async def _stop(fleet: Fleet, case: Case) -> None:
    stopped = await fleet.stop()
    if len(stopped.stopped) != case.boards:
        raise SystemExit(f"{len(stopped.stopped)} of {case.boards} boards stopped: {list(stopped.failed.values())[:3]}")
    case.stops.append(max(stopped.stopped.values()))
    if case.stops[-1] > _REPEATED:  # a stop that was sent again must not end the next round
        await asyncio.sleep(_PATIENCE)


# --- figures ----------------------------------------------------------------------------------------------------------


def _goals(ours: list[float], bare: list[float], cases: list[Case]) -> Iterator[Goal]:
    for percent in (50, 99):
        ratio = percentile(ours, percent) / percentile(bare, percent)
        yield at_most(f"p{percent} of a command that reads over that of a bare message and its echo", ratio, ROUND_TRIP)
    most = cases[-1]
    where = f"{most.boards} boards"
    yield at_least(f"samples at {HZ:g} Hz that arrive; {where}", most.delivered, DELIVERED, "{:.2f} %")
    name = f"from a stop until the last board has stopped, 99 times in 100; {where}"
    yield at_most(name, 1000 * percentile(most.stops, 99), 1000 * STOPPED, "{:.0f} ms")
    name = f"between the first and the last start, 99 times in 100; {where}"
    yield at_most(name, 1000 * percentile(most.spreads, 99), 1000 * SPREAD, "{:.1f} ms")


def _trip_table(ours: list[float], bare: list[float], changes: list[float]) -> Table:
    rows = [
        (name, *(f"{1000 * percentile(times, percent):.2f}" for percent in (50, 99)))
        for name, times in (
            ("bare paho-mqtt: a message and its echo", bare),
            ("a command that reads (`board.state`), and its result", ours),
            ("a command that changes (`servo.set`), and its result", changes),
        )
    ]
    ratios = [f"{percentile(ours, percent) / percentile(bare, percent):.2f}x" for percent in (50, 99)]
    return table(
        "A command and its result, one at a time, through mosquitto on the same machine",
        ("", "p50, ms", "p99, ms"),
        [*rows[:2], ("times as long", *ratios), rows[2]],
        [
            f"{len(ours):,} of each, in turns; all messages with QoS 1. Times are wall-clock times.",
            "A command goes through the bridge of the board and its hub, and is noted in a file before it is done.",
            "For one that changes something the disk itself is waited for, which takes as long as the disk does.",
        ],
    )


def _sample_table(cases: list[Case]) -> Table:
    rows = [
        (
            case.boards,
            f"{case.samples.received / case.seconds:,.0f}",
            f"{case.delivered:.2f} %",
            case.samples.lost,
            case.samples.left_out,
            f"{100 * case.cpu / case.boards:.2f} %",
            f"{100 * case.cpu_of_watcher:.0f} %",
            f"{case.memory / case.boards / 1e6:.1f}",
        )
        for case in cases
    ]
    return table(
        f"Boards of 16 servos that send their states at {HZ:g} Hz to one program",
        ("boards", "samples/s", "arrived", "lost", "left out", "CPU per board", "CPU of the program", "MB per board"),
        rows,
        [
            f"{cases[-1].seconds:.0f} s each; virtual boards with their hubs and bridges, at most 50 in a process.",
            "CPU is a share of one core. Lost samples are gaps of the numbers, left out is what a slow network costs.",
            "The memory of a process without boards counts, too.",
        ],
    )


def _together_table(cases: list[Case]) -> Table:
    rows = [
        (
            case.boards,
            *(f"{1000 * value:.1f}" for value in (median(case.spreads), percentile(case.spreads, 99))),
            *(f"{1000 * value:.0f}" for value in (median(case.stops), percentile(case.stops, 99))),
        )
        for case in cases
    ]
    return table(
        "All boards start a macro together, and are stopped while they move",
        ("boards", "starts within, p50, ms", "p99", "all stopped after, p50, ms", "p99"),
        rows,
        [
            f"{len(cases[-1].spreads)} rounds each. Starts are compared by the clock of the machine that boards name.",
            "A board has stopped when its servos say so. All boards, the broker and the program are on one machine,",
            "while all boards send their states.",
        ],
    )
