"""How long a program waits for servolink to be there: imports and commands, beside what Python itself needs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from statistics import median
from time import perf_counter

from benchmarks.goals import Goal, at_most
from benchmarks.measuring import Result, installed, table
from benchmarks.neighbours import Neighbours

BARE = "python -c pass"
_CONNECT, _ASYNCIO = "from servolink import connect", "import asyncio"
_SERVOS = "servolink servos --url virtual://"
GOALS = {
    ("servolink --help", BARE): 100,
    (_SERVOS, BARE): 200,
    (_CONNECT, _ASYNCIO): 100,
}
"""At most so many milliseconds of CPU more than what comes second."""
_IMPORTS = (_ASYNCIO, _CONNECT)
_PEERS = {"pymodbus": "import pymodbus.client", "moteus": "import moteus"}
_COMMANDS = ("servolink --help", _SERVOS)


def run(*, short: bool) -> Result:
    """Start everything in turns."""
    neighbours = Neighbours()
    versions: dict[str, str] = {}
    cases = _cases(versions)
    walls: dict[str, list[float]] = {name: [] for name in cases}
    cpus: dict[str, list[float]] = {name: [] for name in cases}
    for at in range(3 if short else 22):
        for name, command in cases.items():
            wall, cpu = _start(command)
            if at:  # the first one brings the files into memory, and compiles them
                walls[name].append(wall)
                cpus[name].append(cpu)
    times = {name: (median(walls[name]), median(cpus[name])) for name in cases}
    bare_wall, bare_cpu = times[BARE]
    quote = table(
        "from the start of Python to the end, ms",
        ("what", "time", "over bare Python", "CPU", "CPU over bare Python"),
        [
            (
                name,
                f"{wall_ms:.0f}",
                f"{wall_ms - bare_wall:.0f}",
                f"{cpu_ms:.0f}",
                f"{cpu_ms - bare_cpu:.0f}",
            )
            for name, (wall_ms, cpu_ms) in times.items()
        ],
        [
            "`connect` needs asyncio, so the goal counts what comes on top.",
            f"{neighbours.note()} So time is longer than CPU.",
        ],
    )
    return {"tables": [quote], "goals": _goals(times), "versions": versions, "wall": walls, "cpu": cpus}


def _goals(times: dict[str, tuple[float, float]]) -> list[Goal]:
    """Return the goals, all in CPU time, which a busy machine lengthens least."""
    return [
        at_most(f"CPU of `{name}` over `{base}`", times[name][1] - times[base][1], most, "{:.0f} ms")
        for (name, base), most in GOALS.items()
    ]


def _cases(versions: dict[str, str]) -> dict[str, list[str]]:
    imports = [*_IMPORTS, *(line for package, line in _PEERS.items() if installed(package, versions))]
    program = shutil.which("servolink", path=Path(sys.executable).parent) or "servolink"
    return (
        {BARE: [sys.executable, "-c", "pass"]}
        | {line: [sys.executable, "-c", line] for line in imports}
        | {line: [program, *line.split()[1:]] for line in _COMMANDS}
    )


def _start(command: list[str]) -> tuple[float, float]:
    """Return the milliseconds that pass and those of CPU until `command` has ended."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "SERVOLINK"))}
    began = perf_counter()
    started = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment)  # noqa: S603 - our own commands
    _, status, used = os.wait4(started.pid, 0)
    wall = perf_counter() - began
    started.returncode = os.waitstatus_to_exitcode(status)
    if started.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {started.returncode}")
    return wall * 1000, (used.ru_utime + used.ru_stime) * 1000
