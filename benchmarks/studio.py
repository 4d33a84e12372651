"""The studio in Chromium: whether it keeps up with the robot, and how long a hand on the mouse waits."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from statistics import median
from time import perf_counter
from typing import Any

from benchmarks.goals import Goal, at_least, at_most
from benchmarks.measuring import CORES, Result, Table, table
from benchmarks.studio_hands import KEYFRAMES, Waits, drag_keyframes, drag_slider, store_keyframes
from benchmarks.studio_place import Place, address_of, chromium, page_of, started, studio
from benchmarks.studio_tabs import PAGES, TABS, Frozen, Tabs, freeze, watch

HZ = 50
_WARM = 3000  # milliseconds until a page has loaded and compiled everything


@dataclass(frozen=True)
class _Extent:
    """How long things are measured."""

    watch: float
    """Seconds in which no reading may be missed."""
    some: float
    """Seconds of everything else."""
    starts: int
    moves: int
    """Of the mouse."""


_LONG = _Extent(watch=60, some=15, starts=9, moves=600)
_SHORT = _Extent(watch=3, some=2, starts=2, moves=60)


@dataclass(frozen=True)
class _Watched:
    """One page that shows the robot."""

    readings: int
    missed: int
    longest: float
    """Milliseconds between two readings."""
    cpu: float
    """Share of a core that the server used."""
    memory: float
    """MB of the server."""


def run(*, short: bool) -> Result:
    """Measure a studio with one page, then with twenty, then with one that is frozen."""
    if CORES:
        os.sched_setaffinity(0, set(CORES))  # the browser alone needs more than one
    extent = _SHORT if short else _LONG
    with studio() as place, chromium() as browser:
        starts = [_start() for _ in range(extent.starts)]
        with page_of(browser, place.url) as page:
            watched = _watch(place, page, extent)
        with page_of(browser, place.url) as page:
            slider = drag_slider(place, page, extent.moves)
        store_keyframes()
        with page_of(browser, place.url) as page:
            keyframes = drag_keyframes(page, extent.moves)
        tabs = watch(place, browser, HZ, extent.some)
        frozen = freeze(place, browser, extent.some)
        versions = {"Chromium": browser.version}
    waits = {"slider": slider, "keyframes": keyframes}
    return {
        "tables": [_table(watched, extent), _tabs_table(tabs, frozen)],
        "goals": [
            *_page_goals(watched, extent),
            *_waits_goals(waits),
            *_server_goals(starts, tabs, frozen),
        ],
        "versions": versions,
        "starts": starts,
        "waits": {name: each.all for name, each in waits.items()},
    }


def _start() -> float:
    """Return the seconds from the command until the address is printed."""
    began = perf_counter()
    with started("servolink", "studio", "--demo", "--no-browser") as program:
        address_of(program)
        return perf_counter() - began


def _watch(place: Place, page: Any, extent: _Extent) -> _Watched:
    """Look at the robot for a while."""
    page.wait_for_timeout(_WARM)
    page.evaluate("() => { probe.readings.length = 0 }")
    began, used = perf_counter(), place.cpu()
    page.wait_for_timeout(extent.watch * 1000)
    readings = page.evaluate("probe.readings")
    cpu = (place.cpu() - used) / (perf_counter() - began)
    times = [time for time, _ in readings]
    return _Watched(
        len(readings),
        sum(missed for _, missed in readings),
        max(late - early for early, late in pairwise(times)),
        cpu,
        place.memory(),
    )


def _page_goals(watched: _Watched, extent: _Extent) -> Iterator[Goal]:
    yield at_most(f"readings missed of 16 servos at {HZ} Hz in {extent.watch:g} s", watched.missed, 0, "{:.0f}")


def _waits_goals(waits: dict[str, Waits]) -> Iterator[Goal]:
    yield at_most(
        "from the slider until the board is sent its angle, 99 times in 100",
        waits["slider"].percentile(99),
        60,
        "{:.0f} ms",
    )
    yield at_most(
        f"from the mouse that drags one of {KEYFRAMES:,} keyframes to the screen, 99 times in 100",
        waits["keyframes"].percentile(99),
        50,
        "{:.0f} ms",
    )


def _server_goals(starts: list[float], tabs: Tabs, frozen: Frozen) -> Iterator[Goal]:
    yield at_most("from the command to the address", median(starts), 1.5, "{:.2f} s")
    yield at_least(f"readings per second that each of {TABS} tabs gets", tabs.readings, 0.9 * HZ, "{:.1f}")
    yield at_most(
        "from the last beat of a frozen tab until the robot is stopped", frozen.stopped * 1000, 400, "{:.0f} ms"
    )


def _table(watched: _Watched, extent: _Extent) -> Table:
    return table(
        f"One page that shows 16 servos at {HZ} Hz, for {extent.watch:g} s",
        ("readings", "missed", "longest time between two, ms", "CPU of the server", "memory of the server, MB"),
        [(watched.readings, watched.missed, f"{watched.longest:.0f}", f"{watched.cpu:.1%}", f"{watched.memory:.0f}")],
        [
            "The server is the studio with its hub; the virtual board is in another process, at a TCP address.",
            "Chromium has no graphics card here: it calculates every pixel, and the figure is drawn flat.",
        ],
    )


def _tabs_table(tabs: Tabs, frozen: Frozen) -> Table:
    return table(
        f"{TABS} tabs that show the servos at {HZ} Hz, and one that is frozen while it moves the robot",
        ("tabs", "readings per second, each", "CPU of the server", "memory of the server, MB"),
        [
            (TABS, f"{tabs.readings:.1f}", f"{tabs.cpu:.1%}", f"{tabs.memory:.0f}"),
            ("1, frozen", "-", f"{frozen.cpu:+.1%}", f"{frozen.memory:+.1f}"),
        ],
        [
            f"{PAGES} tabs are whole pages; the others are WebSockets that ask for the same and acknowledge it.",
            "The processes of the frozen tab are stopped by SIGSTOP. Its figures are over those of no tab.",
        ],
    )
