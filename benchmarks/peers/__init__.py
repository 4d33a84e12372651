"""The parser against those of other libraries, each on its own format: speed, and recall of intact frames.

A parser of another library is one small file here. One whose library is missing is left out, and reported.
"""

from __future__ import annotations

import gc
import logging
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import version

from benchmarks.measuring import Result
from benchmarks.peers import tables
from benchmarks.peers.damage import DAMAGES, Recall
from benchmarks.peers.ours import Ours, Textbook
from benchmarks.peers.peer import SIZES, Peer
from benchmarks.peers.row import Row, measure
from benchmarks.peers.speed import Pace
from benchmarks.peers.tables import Goal

PEERS = {
    "aioesphomeapi": ("esphome", ("Esphome", "EsphomeAlone")),
    "cobs": ("stuffed", ("Cobs",)),
    "cflib": ("cpx", ("CPX",)),
    "pymodbus": ("modbus", ("Socket", "RTU")),
    "dynamixel-sdk": ("dynamixel", ("Dynamixel",)),
    "pymavlink": ("mavlink", ("Mavlink",)),
    "moteus": ("moteus", ("Moteus",)),
    "zigpy-znp": ("znp", ("Znp",)),
    "pyubx2": ("ubx", ("UBX",)),
    "construct": ("declared", ("Construct",)),
}
"""What is installed, to the module here and the classes in it."""

TIMES, TIMES_AT = 10.0, (14, 186)
"""How many times as fast as each parser in pure Python that checks a sum, and for frames of which sizes."""
SLOWER = {14: 1.5, 186: 1.8}
"""At most how many times as slow as aioesphomeapi, which is compiled, by frame size."""


PACES = {False: Pace(9, 30.0, 3), True: Pace(3, 4.0, 1)}
"""How exactly to measure, and how for `--short`."""


def run(*, short: bool) -> Result:
    """Measure all that is installed; a goal missed is a failure."""
    logging.disable()  # several write a line for each damaged frame
    try:
        return _run(PACES[short], short=short)
    finally:
        gc.unfreeze()
        logging.disable(logging.NOTSET)


def _run(pace: Pace, *, short: bool) -> Result:
    peers, missing = installed()
    gc.freeze()  # or each would pay, now and then, for looking through what all the others have imported
    everybody: list[type[Peer]] = [Ours, *peers]
    measured = [measure(peer, size, pace, short=short) for size in SIZES for peer in everybody]
    ours = [row for row in measured if row is not None and row.peer is Ours]
    rows = [row for row in measured if row is not None and row.peer is not Ours]
    reached = goals(rows)
    return {
        "versions": {name: version(name) for name in PEERS if name not in missing},
        "missing": missing,
        "tables": [
            tables.who(peers, missing),
            tables.goals(reached),
            *(tables.speeds(size, [row for row in rows if row.size == size]) for size in SIZES),
            tables.by_chunk(rows),
            tables.dirty(rows),
            tables.recalls([*ours, *rows]),
        ],
        "rows": [row.figures for row in (*ours, *rows)],
        "wrong": [fault for row in ours for fault in _lost(row)],
        "slow": [f"{goal.text}: {goal.measured}" for goal in reached if not goal.met],
    }


def installed() -> tuple[list[type[Peer]], list[str]]:
    """Return the parsers that there are, and the libraries that are not."""
    peers: list[type[Peer]] = [Textbook]
    missing = []
    for name, (module, classes) in PEERS.items():
        try:
            loaded = import_module(f"{__name__}.{module}")
        except ImportError:
            missing.append(name)
        else:
            peers += [getattr(loaded, each) for each in classes]
    return peers, missing


def _lost(row: Row) -> Iterator[str]:
    for kind in DAMAGES:
        found: Recall = row.recall[kind]
        if found.found != found.intact:
            yield f"{found.found} of {found.intact} intact frames of {row.frame} bytes found ({kind})"


def goals(rows: list[Row]) -> list[Goal]:
    """Return the goals beside other parsers that can be measured with what is installed."""
    found = []
    for size in TIMES_AT:
        text = f"{TIMES:.0f} times as fast as each parser in pure Python that checks a sum, frames of {size} bytes"
        beside = [
            (row.best.times.ratio, row.peer.name) for row in rows if row.size == size and row.best and _alike(row)
        ]
        if beside:
            ratio, name = min(beside)
            found.append(Goal(text, f"{ratio:.1f} times, beside {name}", ratio >= TIMES))
    for size, most in SLOWER.items():
        text = f"at most {most} times as slow as aioesphomeapi, frames of {size} bytes"
        for row in rows:
            if row.peer.name == "aioesphomeapi" and row.size == size and row.best:
                slower = 1 / row.best.times.ratio
                found.append(Goal(text, f"{slower:.2f} times", slower <= most))
    return found


def _alike(row: Row) -> bool:
    return bool(row.peer.package) and row.peer.validates and not row.peer.compiled
