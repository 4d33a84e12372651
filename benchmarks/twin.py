"""The twin beside bare MuJoCo."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

from benchmarks.goals import at_most
from benchmarks.measuring import Result, table
from benchmarks.neighbours import Neighbours
from servolink.project.model import Project, name_of
from servolink.protocol.records import Macro
from servolink.twin.body import Body
from servolink.twin.simulation import STEP, TICK, Physics, Simulation, mujoco
from servolink.twin.trial import AS_WRITTEN, RunningTrial, run_seconds, run_trial, start

DEMO = Path(str(files("servolink.studio") / "demo.servolink.json"))
MOST = 1.3
"""Times the CPU of bare MuJoCo that a trial may take."""
_STEPS = round(TICK / STEP)


def run(*, short: bool) -> Result:
    """Measure trials of each macro and bare MuJoCo with the same commands in turns."""
    neighbours = Neighbours()
    project, body = Body.read(DEMO)
    physics = Physics(body)
    found = list[tuple[float, float, float, str]]()
    for macro in project.macros[:2] if short else project.macros:
        commands = _commands(physics, project, macro)
        simulated = len(commands) * TICK
        bare, ours = _alternately(physics, project, macro, commands, rounds=2 if short else 7)
        found.append((ours / bare, simulated / bare, simulated / ours, name_of(macro)))
    found.sort()
    chosen = [found[0], found[len(found) // 2], found[-1]]
    tables = [
        table(
            "Macros of the demo project on one core, in times of real time: the least ratio, the median and the most",
            ("macro", "bare MuJoCo", "trial", "ratio"),
            [(name, f"{bare:.0f}x", f"{ours:.0f}x", f"{ratio:.2f}x") for ratio, bare, ours, name in chosen],
            [neighbours.note()],
        )
    ]
    goals = [
        at_most(
            "CPU of a trial beside bare MuJoCo with the same steps, median of all macros",
            median([ratio for ratio, *_ in found]),
            MOST,
        ),
    ]
    return {"tables": tables, "goals": goals}


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
