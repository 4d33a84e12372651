"""A hand on the mouse in the page of the studio."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import cycle, islice
from time import perf_counter
from typing import Any

from benchmarks.studio_board import SERVOS
from benchmarks.studio_place import Place, Seen, shared_board
from servolink import sync
from servolink.project.build import build_project
from servolink.protocol.records import Action, Macro

KEYFRAMES = 1000
_SERVO = 2
_SWEEP = 150  # pixels, one way
_KEYFRAME_SECONDS = 0.1
_ZOOM = 8
_LOOKS = 50
"""How often the clocks are compared: the quickest one counts."""


@dataclass(frozen=True)
class Waits:
    """How long a person waited, milliseconds."""

    all: list[float]

    def percentile(self, percent: float) -> float:
        """Return a percentile; infinity if nothing was measured."""
        if not self.all:
            return float("inf")
        ordered = sorted(self.all)
        return ordered[min(len(ordered) - 1, int(len(ordered) * percent / 100))]


def drag_slider(place: Place, page: Any, moves: int) -> Waits:
    """Move the robot by a slider; return the times from each input until the board was sent it or a later one."""
    page.locator(".stage .seg").get_by_text("Robot").click()
    where = page.get_by_label(f"Target of servo {_SERVO},").bounding_box()
    x, y = where["x"] + where["width"] / 2, where["y"] + where["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.get_by_text("You have control").wait_for()
    place.seen_until_now()
    page.evaluate("() => { probe.inputs.length = 0 }")
    for at in _sweeps(x, moves):
        page.mouse.move(at, y)
        page.wait_for_timeout(15)
    page.wait_for_timeout(200)  # until the last one was sent
    offset, inputs, seen = clock_offset(page), page.evaluate("probe.inputs"), place.seen_until_now()
    page.mouse.up()
    return Waits(_until_sent([(offset + time / 1000, round(angle)) for time, angle in inputs], seen))


def _until_sent(inputs: Sequence[tuple[float, int]], seen: Iterable[Seen]) -> list[float]:
    """Return the milliseconds from each input until the board was sent it, or one that came after it."""
    waits: list[float] = []
    for sent, targets in seen:
        done = len(waits)
        for at in range(len(inputs) - 1, done - 1, -1):
            time, angle = inputs[at]
            if time <= sent and angle == targets.get(_SERVO):
                waits += [(sent - time) * 1000 for time, _ in inputs[done : at + 1]]
                break
    return waits


def drag_keyframes(page: Any, moves: int) -> Waits:
    """Drag one of many keyframes; return the times from each movement of the mouse until the page shows it."""
    page.get_by_role("link", name="Macros").click()
    page.locator(".clip").nth(KEYFRAMES - 1).wait_for(state="attached")
    page.evaluate(f"import('/state/timeline.js').then(({{ zoom }}) => {{ zoom.value = {_ZOOM} }})")
    where = page.locator(".clip").nth(KEYFRAMES // 50).bounding_box()
    x, y = where["x"] + where["width"] / 2, where["y"] + where["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for at in _sweeps(x, moves):
        page.mouse.move(at, y)
    page.mouse.up()
    return Waits(page.evaluate("probe.drags"))


def store_keyframes() -> None:
    """Make the board hold a macro of many keyframes."""
    poses = [
        Action.pose(name, dict.fromkeys(range(1, SERVOS + 1), angle), seconds=_KEYFRAME_SECONDS)
        for name, angle in (("up", 10), ("down", 0))
    ]
    with sync.connect(shared_board()) as board:
        board.apply_project(build_project(Macro.of("long", *poses, loop=KEYFRAMES // len(poses))))


def clock_offset(page: Any) -> float:
    """Return what is to be added to times of the page, in seconds, for the clock of this process."""
    looks: list[tuple[float, float]] = []
    for _ in range(_LOOKS):
        began = perf_counter()
        there = page.evaluate("performance.now()") / 1000
        ended = perf_counter()
        looks.append((ended - began, (began + ended) / 2 - there))
    return min(looks)[1]


def _sweeps(x: float, moves: int) -> Iterable[float]:
    """Yield places of the mouse, from side to side."""
    there = [x + step for step in range(0, _SWEEP, 3)]
    return islice(cycle(there + there[::-1]), moves)
