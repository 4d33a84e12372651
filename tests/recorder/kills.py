"""Recorders that are killed at any moment, and the time that is missing then: `python -m tests.recorder.kills 200`."""

from __future__ import annotations

import random
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from mcap.reader import make_reader

from servolink.recorder.reading import Recording
from servolink.recorder.repairing import repair
from tests import processes

LONGEST_LOSS = 1.0
"""Seconds that a killed recorder may lose, on a machine that does little else."""
_AT_ONCE = 2
_HZ = 50


def loss(path: Path) -> float:
    """Kill a recorder, repair the recording, and return the seconds missing at its end. Raise AssertionError."""
    command = (sys.executable, "-m", "servolink", "record", str(path), "--board", "virtual://", "--hz", f"{_HZ}")
    recorder = processes.start(command)
    processes.until(lambda: path.exists() and path.stat().st_size >= 12_000)
    time.sleep(random.uniform(0.0, 1.5))  # it is killed at any moment between two flushes
    killed = time.time_ns()
    recorder.kill()
    processes.finish(recorder)
    entries = list(Recording(path).entries())
    assert repair(path).messages == len(entries) > _HZ
    with path.open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) == len(entries)
    return (killed - entries[-1].time) / 1e9


def losses(folder: Path, count: int) -> list[float]:
    """Return the seconds missing after each of `count` kills, the least first."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return sorted(pool.map(loss, (folder / f"{number}.mcap" for number in range(count))))


def main() -> int:
    """Kill as many recorders as the argument says; 1 if one of them has lost more than a second."""
    with tempfile.TemporaryDirectory() as folder:
        lost = losses(Path(folder), int(sys.argv[1]))
    processes.sessions.close()
    print(f"{len(lost)} kills: {lost[len(lost) // 2]:.2f} s missing at the median, {lost[-1]:.2f} s at most")
    return int(lost[-1] > LONGEST_LOSS)


if __name__ == "__main__":
    sys.exit(main())
