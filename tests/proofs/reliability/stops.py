"""A stop at every point of every kind of movement, through every door: nothing moves after it.

A point is a moment right before or after a packet, in either direction, or a time; a stop at each is a run of its own,
with a new robot.
"""

from __future__ import annotations

import logging
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import product
from random import Random
from typing import NamedTuple

from benchmarks.measuring import Result, table
from tests.proofs.reliability.stop_doors import MOVEMENTS, REAL
from tests.proofs.reliability.stop_line import FATES
from tests.proofs.reliability.stop_scene import TIMES, Scene, Witness, live

MOST_POINTS = 1000
"""More than any movement has: a seed is the number of a scene, times this, and the number of a point."""
_SHORT, _SHORT_FATES = 5, 1  # points of each scene whose stop arrives, and of others
_REAL = 2  # points of each scene in real time
_PROGRESS = 100  # scenes between two signs of life


def _scenes() -> Iterator[Scene]:
    virtual = [door for door in MOVEMENTS if door not in REAL]
    pairs = [(door, door) for door in virtual]
    pairs += [(mover, stopper) for mover, stopper in product(virtual, repeat=2) if "board" not in {mover, stopper}]
    real = [(mover, door) for door in sorted(REAL) for mover in (door, "library")]
    for (mover, stopper), fate in (*product(dict.fromkeys(pairs), FATES), *product(real, ("arrives",))):
        yield from (Scene(mover, stopper, movement, fate) for movement in MOVEMENTS[mover])


SCENES = tuple(_scenes())
"""Each movement of each door, with the stop of each door, and with each fate of the stop."""


class Explored(NamedTuple):
    """What came of the stops in one scene."""

    scene: Scene
    stops: Counter[str]
    """How they ended."""
    faults: list[str]


def explore(number: int, most: int | None = None) -> Explored:
    """Stop at all points of a scene, or at `most` of them."""
    scene = SCENES[number]
    whole = _relived(scene)
    found = Explored(scene, Counter(), [f"seed {number * MOST_POINTS}: {fault}" for fault in whole.faults])
    if whole.movement != "done":
        found.faults.append(f"seed {number * MOST_POINTS}: the movement ends as {whole.movement} without a stop")
    points = range(1, whole.points + TIMES + 1)
    for point in points if most is None else Random(str(scene)).sample(points, min(most, len(points))):
        seen = _relived(scene, point, whole)
        found.stops[seen.stop if seen.stop in {"confirmed", "not reached"} else "not confirmed"] += 1
        found.faults.extend(f"seed {number * MOST_POINTS + point}: {scene}: {fault}" for fault in seen.faults)
    return found


def relive_stop(seed: int) -> tuple[Scene, Witness]:
    """Live through the scene and the point of a seed."""
    number, point = divmod(seed, MOST_POINTS)
    scene = SCENES[number]
    whole = _relived(scene)
    return scene, _relived(scene, point, whole) if point else whole


def run(*, short: bool) -> Result:
    """Stop at all points (short: at some) of all scenes."""
    counts: defaultdict[str, Counter[str]] = defaultdict(Counter)
    faults: list[str] = []
    numbers = [number for number, scene in enumerate(SCENES) if not short or _is_in_short(scene)]
    with ProcessPoolExecutor(initializer=logging.disable) as processes:
        for at, found in enumerate(processes.map(partial(_explore, short=short), numbers, chunksize=4), 1):
            scene = found.scene
            for row in (
                f"moved by {scene.mover}",
                f"stopped by {scene.stopper}",
                scene.movement,
                f"a stop {scene.fate}",
            ):
                counts[row].update(found.stops)
            faults += found.faults
            if at % _PROGRESS == 0:
                sys.stderr.write(f"{at} of {len(numbers)} scenes, {len(faults)} faults\n")
    names = ("confirmed", "not confirmed")
    rows = [(row, f"{count.total():,}", *(f"{count[name]:,}" for name in names)) for row, count in counts.items()]
    quote = table(
        f"Stops at points of movements, {len(numbers)} scenes",
        ("scene", "stops", *names),
        rows,
        notes=[
            "nothing asked for before a stop was sent after it, and no servo turned once it was confirmed"
            if not faults
            else f"{len(faults)} faults",
            "a command, a model or a fleet hears of no stop: its motions within 20 ms after that of another are new",
        ],
    )
    figures = {
        "scenes": len(numbers),
        "faults": len(faults),
        "stops": {row: dict(each) for row, each in counts.items()},
    }
    return {"tables": [quote], "wrong": faults[:20], "figures": figures}


def _explore(number: int, *, short: bool) -> Explored:
    scene = SCENES[number]
    most = _REAL if scene.is_real else None
    return explore(number, (_SHORT if scene.fate == "arrives" else _SHORT_FATES) if short else most)


def _is_in_short(scene: Scene) -> bool:
    """Return whether a scene is worth its time: other fates are those of the hub, whoever asks for the stop."""
    if scene.is_real:
        return False
    return scene.mover == scene.stopper if scene.fate == "arrives" else scene.mover in {"board", "control interface"}


def _relived(scene: Scene, point: int | None = None, whole: Witness | None = None) -> Witness:
    try:
        return live(scene, point, whole)
    except Exception as error:  # noqa: BLE001 - a fault like others, with its seed
        return Witness(faults=[f"it ends in {type(error).__name__}: {error}"])
