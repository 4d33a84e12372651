"""What this process holds: memory, descriptors, threads, tasks."""

from __future__ import annotations

import asyncio
import os
import threading
from dataclasses import dataclass
from pathlib import Path

_PAGE = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 4096


@dataclass(frozen=True, slots=True)
class Held:
    """A moment's look at it."""

    memory: int
    """Bytes that are resident."""
    descriptors: int
    threads: int
    tasks: int

    @classmethod
    def now(cls) -> Held:
        """Look; on Linux only."""
        resident = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        descriptors = sum(1 for _ in Path("/proc/self/fd").iterdir())
        return cls(resident * _PAGE, descriptors, threading.active_count(), len(asyncio.all_tasks()))


def slope(points: list[tuple[float, float]]) -> float:
    """Return by how much the line of least squares through `points` rises per unit."""
    middle_x = sum(x for x, _ in points) / len(points)
    middle_y = sum(y for _, y in points) / len(points)
    spread = sum((x - middle_x) ** 2 for x, _ in points)
    return sum((x - middle_x) * (y - middle_y) for x, y in points) / spread if spread else 0.0
