"""The parser against those of other libraries, each on its own format: speed, and recall of intact frames.

A parser of another library is one small file here. One whose library is missing is left out, and reported.
"""

from __future__ import annotations

import gc
import logging
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import version

from benchmarks.goals import Goal, at_least, at_most
from benchmarks.measuring import Result
from benchmarks.peers import tables
from benchmarks.peers.damage import DAMAGES, Recall
from benchmarks.peers.ours import Ours, Textbook
from benchmarks.peers.peer import SIZES, Peer
from benchmarks.peers.row import Row, measure
from benchmarks.peers.speed import Pace, Speed

PEERS = {
    "aioesphomeapi": ("esphome", ("Esphome",)),
    "cobs": ("stuffed", ("Cobs",)),
    "cflib": ("cpx", ("CPX",)),
    "pymodbus": ("modbus", ("Socket", "RTU")),
    "dynamixel-sdk": ("dynamixel", ("Dynamixel",)),
    "pymavlink": ("mavlink", ("Mavlink",)),
    "construct": ("declared", ("Construct",)),
}
"""What is installed, to the module here and the classes in it."""

TIMES = 10.0
"""How many times as fast as each parser in pure Python that checks a sum, with objects beside those that make some."""
SLOWER = {14: 1.5, 186: 1.8}
"""At most how many times as slow as aioesphomeapi, which is compiled, by frame size, in chunks of 4 KiB."""

PACES = {False: Pace(7, 8.0, 2), True: Pace(1, 0.5, 1)}
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
    return {
        "versions": {name: version(name) for name in PEERS if name not in missing},
        "missing": missing,
        "tables": [
            tables.who(peers, missing),
            tables.results(ours, rows),
        ],
        "rows": [row.figures for row in (*ours, *rows)],
        "wrong": [fault for row in ours for fault in _lost(row)],
        "goals": goals(rows),
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
    for size in SIZES:
        beside = [(_alike(row.peer, row.best), row) for row in rows if row.size == size and row.best and _slow(row)]
        if beside:
            ratio, row = min(beside, key=lambda each: each[0])
            typed = ", both with objects" if row.peer.builds else ""
            name = f"parsers in pure Python that check a sum, {size} bytes; the nearest is {row.peer.name}{typed}"
            found.append(at_least(name, ratio, TIMES, "{:.1f}x its speed"))
    slower = "{:.2f}x its time"
    for row in rows:
        if row.peer.name == "aioesphomeapi" and row.size in SLOWER:
            name = f"aioesphomeapi (Cython, no checksum), {row.size} bytes"
            if row.best:
                found.append(at_most(f"{name}, 4 KiB", 1 / row.best.times.ratio, SLOWER[row.size], slower))
    return found


def _slow(row: Row) -> bool:
    """Return whether a parser is of the kind that ours is to be many times as fast as."""
    return bool(row.peer.package) and row.peer.validates and not row.peer.compiled


def _alike(peer: type[Peer], speed: Speed) -> float:
    """Return how many times faster ours is when it does as much: with objects beside those that make some."""
    return speed.typed.ratio if peer.builds else speed.times.ratio
