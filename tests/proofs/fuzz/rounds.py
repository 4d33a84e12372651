"""One turn of one target: so many seconds of plain mutation, or of a coverage-guided fuzzer."""

from __future__ import annotations

import importlib.util
import re
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from tests import processes
from tests.proofs.fuzz.mutation import Mutations
from tests.proofs.fuzz.targets import TARGETS, Target, seeds

GUIDED = importlib.util.find_spec("atheris") is not None
"""Whether the coverage-guided fuzzer is installed: `pip install atheris`."""

_AT_ONCE = 64  # inputs between two looks at the clock
_MEMORY = 1024  # MiB, at which an input counts as one that leaks
_HANG = 30  # seconds
_STARTING = 600  # seconds at most, with the inputs of the corpus
_EXECUTED = re.compile(r"stat::number_of_executed_units: (\d+)")
_COVERAGE = re.compile(r"cov: (\d+) ft: (\d+) corp: \d+/")


@dataclass(frozen=True)
class Turn:
    """What came of it."""

    inputs: int
    seconds: float
    finding: str = ""
    """The input, in hex, for which something did not hold, and what."""
    edges: int = 0
    """Of the instrumented code, reached by the corpus; guided only."""
    features: int = 0


def mutated(name: str, seconds: float, seed: int, most: int | None = None) -> Turn:
    """Run a target with mutations of its seeds for so long, or so many inputs."""
    target: Target = TARGETS[name]
    source = Mutations(seeds(name), target.longest, seed)
    begun, inputs = perf_counter(), 0
    while (spent := perf_counter() - begun) < seconds and (most is None or inputs < most):
        for _ in range(_AT_ONCE):
            data = source.next()
            if finding := _finding(target.check, data):
                return Turn(inputs, spent, finding)
            inputs += 1
    return Turn(inputs, spent)


def guided(name: str, seconds: float, corpus: Path) -> Turn:
    """Run a target under atheris for so long; the corpus stays in its folder for the next turn."""
    folder = corpus / name
    if not folder.is_dir():
        folder.mkdir(parents=True)
        for number, seed in enumerate(seeds(name)):
            (folder / f"seed-{number}").write_bytes(seed)
    options = [
        f"-max_total_time={max(1, round(seconds))}",
        f"-max_len={TARGETS[name].longest}",
        f"-artifact_prefix={corpus}/{name}-",
        f"-rss_limit_mb={_MEMORY}",
        f"-timeout={_HANG}",
        "-print_final_stats=1",
        "-len_control=0",
        "-reload=0",
    ]
    command = [sys.executable, "-m", "tests.proofs.fuzz.guided", name, *options, str(folder)]
    begun = perf_counter()
    ended = processes.run(command, limit=2 * seconds + _STARTING)
    executed = _EXECUTED.search(ended.stderr)
    coverage = _COVERAGE.findall(ended.stderr)
    edges, features = map(int, coverage[-1]) if coverage else (0, 0)
    finding = "" if ended.returncode == 0 else ended.stderr[-4000:]
    return Turn(int(executed[1]) if executed else 0, perf_counter() - begun, finding, edges, features)


def _finding(check: Callable[[bytes], None], data: bytes) -> str:
    try:
        check(data)
    except Exception:  # noqa: BLE001 - whatever it is, it is a finding
        return f"{data.hex()}\n{traceback.format_exc()}"
    return ""
