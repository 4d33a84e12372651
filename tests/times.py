"""Processor time of the tests of each room: `python -m tests.times` prints the table of docs/contributing.md.

Times are those of a processor that counts to ten million in a second, so that they can be compared between machines.
"""

from __future__ import annotations

import os
import re
import sys
import time
from pathlib import Path

from tests import processes

ROOT = Path(__file__).parents[1]
LONGEST = 1800  # seconds
TURNS = 10_000_000


def counted() -> float:
    """Return the processor seconds that a fixed loop takes."""
    began, total = time.process_time(), 0
    for number in range(TURNS):
        total += number * number % 7
    return time.process_time() - began


def measured(room: str) -> tuple[int, float]:
    """Return how many tests of a room have passed, and their processor seconds, with those of their programs."""
    command = (sys.executable, "-m", "pytest", "-q", "-n", "0", f"tests/{room}")
    before, loop = os.times(), counted()
    done = processes.run(command, cwd=ROOT, limit=LONGEST)
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    if (passed := re.search(r"(\d+) passed", done.stdout)) is None or done.returncode:
        raise SystemExit(f"{room}: {done.stdout}")
    return int(passed[1]), used * 2 / (loop + counted())


def main(rooms: list[str]) -> None:
    """Print the table of some rooms, or of all, the longest first."""
    own = {path.name for path in (ROOT / "servolink").iterdir() if (ROOT / "tests" / path.name).is_dir()}
    chosen = rooms or sorted(own - {"__pycache__"} | {"lab", "proofs"})
    found = sorted(((*measured(room), room) for room in chosen), key=lambda row: -row[1])
    print("| room | tests | processor seconds |\n|---|---:|---:|")
    for tests, seconds, room in found:
        print(f"| `{room}` | {tests:,} | {seconds:.0f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
