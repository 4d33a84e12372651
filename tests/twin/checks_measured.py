"""Measure the check of a movement before it is sent: `python -m tests.twin.checks_measured` prints milliseconds."""

from __future__ import annotations

import asyncio
import statistics
import time
from collections import Counter
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from servolink.project import Project, ProjectFile
from servolink.twin import Body, PhysicsProcess
from tests.twin.figures import template

MOVEMENTS = 200


async def measure(name: str, folder: Path) -> str:
    """Return the times of movements of two servos by up to 15 degrees in a second, from about rest."""
    figure, random = template(name).checked(), Random(1)
    path, ids = folder / f"{name}.servolink.json", tuple(Body.of(figure).drives)
    ProjectFile(Project(), figure=figure).write(path)
    process, took, verdicts = PhysicsProcess.checker(path), list[float](), Counter[str]()
    await process.check_move({}, {}, 1.0)
    for _ in range(MOVEMENTS):
        pose = {each: float(random.randint(-1, 1)) for each in ids}
        targets = {each: float(random.randint(-15, 15)) for each in random.sample(ids, 2)}
        begun = time.perf_counter()
        verdicts[(await process.check_move(pose, targets, 1.0)).verdict] += 1
        took.append(1000 * (time.perf_counter() - begun))
    await process.close()
    quantiles = statistics.quantiles(took, n=100)
    return f"{name}: median {quantiles[49]:.1f} ms, p99 {quantiles[98]:.1f} ms, {dict(verdicts)}"


def main() -> None:
    """Print the times for each figure."""
    with TemporaryDirectory() as folder:
        for name in ("arm-6", "quadruped-12", "hexapod-18", "humanoid-16"):
            print(asyncio.run(measure(name, Path(folder))), flush=True)


if __name__ == "__main__":
    main()
