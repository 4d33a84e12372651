"""The twin beside bare MuJoCo, and the forecast of the demo project with all its variations."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

from benchmarks.goals import at_least, at_most
from benchmarks.measuring import CORES, Result, table
from benchmarks.neighbours import Neighbours
from servolink.project.model import Project
from servolink.project.record_lookup import name_of
from servolink.protocol.records import Action, Macro
from servolink.twin.body import Body, read_body
from servolink.twin.forecast import VARIATIONS, forecast
from servolink.twin.simulation import STEP, TICK, Physics, Simulation, mujoco
from servolink.twin.trial import AS_WRITTEN, RunningTrial, run_seconds, run_trial, start

DEMO = Path(str(files("servolink.studio") / "demo.servolink.json"))
MOST = 1.3
"""Times the CPU of bare MuJoCo that a trial may take."""
MOST_SECONDS = 20.0
"""Seconds for the forecast of all actions and macros of the demo project, on two cores."""
LEAST_SPEED = 1 / 0.3
"""Times real time on one core: a body in real time takes at most 30 % of it."""

_STEPS = round(TICK / STEP)


def run(*, short: bool) -> Result:
    """Measure trials of each macro and bare MuJoCo with the same commands in turns, then a forecast."""
    neighbours = Neighbours()
    project, body = read_body(DEMO)
    physics = Physics(body)
    rows, ratios, speeds = list[tuple[str, ...]](), list[float](), list[float]()
    for macro in project.macros[:2] if short else project.macros:
        commands = _commands(physics, project, macro)
        simulated = len(commands) * TICK
        bare, ours = _alternately(physics, project, macro, commands, rounds=2 if short else 7)
        ratios.append(ours / bare)
        speeds.append(simulated / ours)
        speed = (f"{simulated / bare:.0f}x", f"{simulated / ours:.0f}x", f"{ours / bare:.2f}x")
        rows.append((name_of(macro), f"{simulated:.1f}", *speed))
    tables = [
        table(
            "Macros of the demo project on one core, in times of real time",
            ("macro", "simulated s", "bare MuJoCo", "trial", "ratio"),
            rows,
            [neighbours.note()],
        )
    ]
    took = _forecast(project, body, short=short)
    goals = [
        at_most("CPU of a trial beside bare MuJoCo with the same steps, median of all macros", median(ratios), MOST),
        at_least("slowest trial, beside real time", min(speeds), LEAST_SPEED, "{:.1f}x"),
    ]
    if not short:
        goals.append(at_most("forecast of the demo project with all variations", took, MOST_SECONDS, "{:.1f} s"))
    return {"tables": tables, "goals": goals, "forecast_seconds": took, "variations": len(VARIATIONS)}


def _commands(physics: Physics, project: Project, macro: Macro) -> list[Any]:
    """Return the commands of all servos in each tick of a trial."""
    trial = RunningTrial(physics, project, macro)
    while not trial.is_over:
        trial.advance()
    simulation: Simulation = start(physics, project, macro, AS_WRITTEN)
    found = []
    while simulation.now < trial.now:
        simulation.tick()
        found.append(physics.data.ctrl.copy())
    return found


def _alternately(
    physics: Physics, project: Project, macro: Macro, commands: list[Any], rounds: int
) -> tuple[float, float]:
    """Return the CPU seconds of bare MuJoCo and of a trial, each the median of some rounds."""
    step, model, data = mujoco().mj_step, physics.model, physics.data
    seconds = run_seconds(project, macro)
    bare, ours = list[float](), list[float]()
    for _ in range(rounds):
        physics.reset()
        began = process_time()
        for command in commands:
            data.ctrl[:] = command
            step(model, data, _STEPS)
        bare.append(process_time() - began)
        began = process_time()
        run_trial(physics, project, macro, AS_WRITTEN, seconds)
        ours.append(process_time() - began)
    return median(bare), median(ours)


def _forecast(project: Project, body: Body, *, short: bool) -> float:
    """Return the seconds of a forecast on all cores."""
    if CORES:
        os.sched_setaffinity(0, set(CORES))
    records: tuple[Action | Macro, ...] = project.macros[:1] if short else (*project.actions, *project.macros)
    began = perf_counter()
    found = forecast(project, body, records, processes=2)
    took = perf_counter() - began
    if any(one.fall is not None for one in found):
        raise RuntimeError("the demo project falls")
    return took
