"""Many boards through one broker on one machine: how soon boards answer, start and stop."""

from __future__ import annotations

import asyncio
import os
import secrets
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from statistics import median
from time import perf_counter

from paho.mqtt.client import MQTTMessage
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from benchmarks.fleet_processes import broker, echo, workers
from benchmarks.fleet_worker import ECHO, MACRO, BareClient
from benchmarks.goals import Goal, at_most
from benchmarks.measuring import CORES, Result, Table, percentile, table
from servolink.fleet.access import parse_broker
from servolink.fleet.client import Fleet, connect

COUNTS = (10, 200)
HZ = 10.0
ROUND_TRIP = 2.5  # times that of bare paho-mqtt: a bridge hands messages to threads four times more
SPREAD = 0.02  # seconds between the first and the last start, 99 times in 100
_SETTLE = 1.0  # seconds until all boards send
_REPEATED, _PATIENCE = 0.9, 5.0  # seconds after which a stop is sent again, and until none is on its way


@dataclass
class Case:
    """What was measured with so many boards, in seconds."""

    boards: int
    stops: list[float] = field(default_factory=list)
    spreads: list[float] = field(default_factory=list)


def run(*, short: bool) -> Result:
    """Measure round trips, then each number of boards."""
    if CORES:
        os.sched_setaffinity(0, CORES)
    counts = (2, 10) if short else COUNTS
    with broker() as url:
        ours, bare, changes = asyncio.run(_round_trips(url, 200 if short else 5000))
        cases = [asyncio.run(_measure(url, count, 3 if short else 100)) for count in counts]
    return {
        "tables": [_trip_table(ours, bare, changes), _together_table(cases)],
        "goals": [*_goals(ours, bare, cases)],
        "cases": [asdict(case) for case in cases],
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


async def _measure(url: str, count: int, rounds: int) -> Case:
    case = Case(count)
    with workers(url, count, HZ):
        async with connect(url, groups={}, servos=True) as fleet:
            await fleet.list()
            await asyncio.sleep(_SETTLE)
            for _ in range(rounds):
                await _start_and_stop(fleet, case)
    return case


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
    ratio = percentile(ours, 50) / percentile(bare, 50)
    yield at_most("p50 of a command that reads over that of a bare message and its echo", ratio, ROUND_TRIP)
    most = cases[-1]
    name = f"between the first and the last start, 99 times in 100; {most.boards} boards"
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
            "A board has stopped when its servos say so. All boards send their states meanwhile, on one machine.",
        ],
    )
