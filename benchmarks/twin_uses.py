"""A body with physics: a board, an environment for learning and poses, beside bare MuJoCo with the same model."""

from __future__ import annotations

import math
from collections.abc import Callable
from importlib.resources import files
from random import Random
from statistics import median
from time import process_time
from typing import Any

from benchmarks.goals import Goal, at_least, at_most
from benchmarks.loops import installed
from benchmarks.measuring import Result, table
from servolink.twin.board import TwinBoard
from servolink.twin.body import Body, read_body
from servolink.twin.reach import REACHED, PosableFigure, load_figure
from servolink.twin.simulation import STEP, Physics, mujoco

DEMO = str(files("servolink") / "studio/demo.servolink.json")
LIMBS = {"left hand": (4, 5, 6), "right hand": (1, 2, 3), "left foot": range(12, 17), "right foot": range(7, 12)}
_FRAME = 0.02  # seconds from one look at the robot to the next


def run(*, short: bool) -> Result:
    """Advance the body of the demo project in turns, and move its hands and feet to random places."""
    body = read_body(DEMO)[1]
    frames, rounds = (100, 3) if short else (500, 9)
    cases: dict[str, Callable[[int], None]] = {"bare MuJoCo": _bare(body), "virtual board": _board(body)}
    versions: dict[str, str] = {}
    installed("mujoco", versions)
    if installed("gymnasium", versions):
        cases["environment"] = _environment()
    seconds: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(rounds):
        for name, advance in cases.items():
            seconds[name].append(_cpu(advance, frames) / frames)
    bare = seconds["bare MuJoCo"]
    ratios = {name: median(map(float.__truediv__, times, bare)) for name, times in seconds.items()}
    per_second = {name: median(times) / _FRAME for name, times in seconds.items()}
    rows = [
        (name, f"{1 / median(times):,.0f}", f"{per_second[name]:.1%}", f"{ratios[name]:.2f}x")
        for name, times in seconds.items()
    ]
    places, answers = _reached(load_figure(DEMO), 25 if short else 100)
    share = sum(distance <= REACHED for _, distance in answers) / len(answers)
    milliseconds = sorted(1000 * took for took, _ in answers)
    p50, p95 = milliseconds[len(answers) // 2], milliseconds[len(answers) * 95 // 100]
    goals: list[Goal] = [
        at_most("CPU of a board with a body, of one core", per_second["virtual board"], 0.3, "{:.1%}"),
        at_least("random places reached within 3 mm", share, 0.95, "{:.1%}"),
        at_most("CPU of a reach, median", p50, 1.0, "{:.2f} ms"),
    ]
    if "environment" in ratios:
        goals.append(at_most("step of the environment over bare MuJoCo", ratios["environment"], 1.3))
    return {
        "tables": [
            table(
                "a humanoid with 16 servos",
                ("what", "frames of 20 ms/s", "of one core in real time", "over MuJoCo"),
                rows,
            ),
            table(
                "reach",
                ("places", "within 3 mm", "median, ms", "95th percentile, ms"),
                [(f"{places} random ones", f"{share:.1%}", f"{p50:.2f}", f"{p95:.1f}")],
                ["Each limb, from the pose with all servos at 0 to places of random angles within the limits."],
            ),
        ],
        "goals": goals,
        "versions": versions,
    }


def _cpu(work: Callable[[int], None], frames: int) -> float:
    start = process_time()
    work(frames)
    return process_time() - start


def _bare(body: Body) -> Callable[[int], None]:
    physics, step = Physics(body), mujoco().mj_step

    def advance(frames: int) -> None:
        for _ in range(frames):
            step(physics.model, physics.data, round(_FRAME / STEP))

    return advance


def _board(body: Body) -> Callable[[int], None]:
    board, frame = TwinBoard(body), 0

    def advance(frames: int) -> None:
        nonlocal frame
        for _ in range(frames):
            frame += 1
            board.advance(frame * _FRAME)
            for servo in board.servos.values():
                servo.state()

    return advance


def _environment() -> Callable[[int], None]:
    from servolink.twin.gym import TwinEnvironment

    environment = TwinEnvironment(DEMO)
    environment.reset(seed=0)
    limits = [part.limits for part, _ in environment.physics.body.drives.values()]
    standing: Any = [-2 * low / (high - low) - 1 for low, high in limits]

    def advance(frames: int) -> None:
        for _ in range(frames):
            environment.step(standing)

    return advance


def _reached(figure: PosableFigure, count: int) -> tuple[int, list[tuple[float, float]]]:
    """Return the number of places, and the CPU seconds and the distance of each."""
    random, found = Random(0), []
    limits = {servo: part.limits for servo, (part, _) in read_body(DEMO)[1].drives.items()}
    for part, servos in LIMBS.items():
        for _ in range(count):
            place = figure.place(part, {servo: math.degrees(random.uniform(*limits[servo])) for servo in servos})
            start = process_time()
            pose = figure.reach({part: place})
            found.append((process_time() - start, pose.distances[part]))
    return len(found), found
