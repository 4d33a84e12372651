"""Hours of use on a bad line, with a new connection every few hundred calls: nothing may grow, nothing be left."""

from __future__ import annotations

import asyncio
import gc
import os
import tty
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import cast

from benchmarks.measuring import Result, table
from servolink.transports import Faults, SerialTransport
from tests.proofs.reliability.board import Character, SimulatedBoard, Wire
from tests.proofs.reliability.clock import SimulatedLoop
from tests.proofs.reliability.history import DirectTransport
from tests.proofs.reliability.line import Line, bit_errors
from tests.proofs.reliability.process import Held, slope
from tests.proofs.reliability.stage import Scene, Stage

LINE = Line(
    "1 % of the frames damaged, cut or preceded by noise", Faults(flip=bit_errors(5e-5), cut=0.005), bursts=0.005
)
BOARD = Character("1 % of the responses late, 1 % of requests and of responses lost", late=0.01, lost=0.01)
_CALLERS = 2
_CALLS = 500  # to a connection
_WARM = 0.1  # share of the time in which memory may still grow
_LONG = 0.3  # hours after which memory that still grows is a leak and not what a program keeps of its latest past
_MOST_GROWTH = 2_000_000


class _Terminal:
    """A pseudo-terminal with the simulated board behind it, in real time."""

    def __init__(self) -> None:
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.name = os.ttyname(self._theirs)
        self._loop = asyncio.get_running_loop()

    @property
    def now(self) -> float:
        return self._loop.time()

    def bring(self, when: float, data: bytes) -> None:
        self._loop.call_at(when, os.write, self._ours, data)

    def lead_to(self, board: SimulatedBoard) -> None:
        self._loop.add_reader(self._ours, lambda: board.receive(os.read(self._ours, 65536)))

    def close(self) -> None:
        self._loop.remove_reader(self._ours)
        os.close(self._ours)
        os.close(self._theirs)


@asynccontextmanager
async def _stage(seed: int, *, virtual: bool) -> AsyncIterator[tuple[Stage, Wire]]:
    scene = Scene(seed, LINE, BOARD)
    loop = asyncio.get_running_loop()
    if virtual:
        simulated = cast("SimulatedLoop", loop)
        yield Stage(scene, simulated, lambda board: DirectTransport(board, simulated)), simulated
        return
    terminal = _Terminal()
    stage = Stage(scene, terminal, lambda board: SerialTransport(f"serial://{terminal.name}", terminal.name))
    terminal.lead_to(stage.board)
    try:
        yield stage, terminal
    finally:
        await asyncio.sleep(3)  # until all is written
        terminal.close()


async def _soak(hours: float, seed: int, *, virtual: bool) -> tuple[Stage, list[tuple[float, Held]]]:
    held: list[tuple[float, Held]] = []
    async with _stage(seed, virtual=virtual) as (stage, wire):
        begun = wire.now
        while wire.now < begun + 3600 * hours:
            await stage.connect()
            await stage.conversation.hold(_CALLERS, _CALLS)
            await stage.disconnect()
            stage.board.to_host.forget()
            await asyncio.sleep(max(0.0, stage.board.free_at - wire.now) + 0.1)
            gc.collect()
            held.append(((wire.now - begun) / 3600, Held.now()))
    return stage, held


def run(*, short: bool = False, hours: float = 2.0, virtual: bool = True, seed: int = 1) -> Result:
    """Soak for so many hours (short: some minutes of virtual ones)."""
    hours = 0.04 if short else hours
    with asyncio.Runner(loop_factory=SimulatedLoop if virtual else None) as runner:
        stage, held = runner.run(_soak(hours, seed, virtual=virtual))
    figures = _figures(hours, stage, held)
    where = "virtual time" if virtual else "real time, over a pseudo-terminal"
    quote = table(
        f"{hours:g} h of use in {where}",
        (
            "calls",
            "connections",
            "wrong",
            "damage accepted",
            "twice done",
            "memory grew by",
            "per hour",
            "descriptors",
            "threads",
            "tasks",
        ),
        [
            (
                f"{figures['calls']:,}",
                f"{figures['connections']:,}",
                len(stage.checker.faults),
                f"{figures['damage accepted']:,}",
                f"{figures['twice']:,}",
                f"{figures['growth'] / 1e6:+.2f} MB",
                f"{figures['slope'] / 1e6:+.3f} MB",
                *(f"{low} to {high}" for low, high in (figures["descriptors"], figures["threads"], figures["tasks"])),
            )
        ],
        notes=[f"{LINE.name}; {BOARD.name}; memory after the first tenth of the time"],
    )
    return {"tables": [quote], "wrong": _wrong(stage, figures), "figures": figures}


def _figures(hours: float, stage: Stage, held: list[tuple[float, Held]]) -> Result:
    warm = [(when, look) for when, look in held if when >= _WARM * hours] or held
    counts = stage.checker.counts
    return {
        "hours": hours,
        "calls": stage.conversation.steps,
        "connections": len(held) + counts["lost"],
        "damage accepted": counts["damage accepted"],
        "twice": counts["executed twice"],
        "counts": dict(counts),
        "growth": warm[-1][1].memory - warm[0][1].memory,
        "slope": slope([(when, float(look.memory)) for when, look in warm]),
        **{
            name: (min(getattr(look, name) for _, look in warm), max(getattr(look, name) for _, look in warm))
            for name in ("descriptors", "threads", "tasks")
        },
    }


def _wrong(stage: Stage, figures: Result) -> list[str]:
    wrong = stage.checker.faults[:20]
    for name in ("descriptors", "threads", "tasks"):
        low, high = figures[name]
        if low != high:
            wrong.append(f"{name} between connections went from {low} to {high}")
    if figures["hours"] >= _LONG and figures["growth"] > _MOST_GROWTH:
        wrong.append(f"memory grew by {figures['growth']} bytes")
    return wrong
