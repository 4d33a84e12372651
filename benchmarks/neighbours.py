"""How busy other programs keep the machine while something is measured."""

from __future__ import annotations

import os
import resource
from pathlib import Path
from time import perf_counter

_STAT = Path("/proc/stat")


class Neighbours:
    """Watches from its making on."""

    def __init__(self) -> None:
        """Begin."""
        self._began = perf_counter(), _idle(), _own()

    def note(self) -> str:
        """Say how much of the machine others had, as far as that can be known, for the notes of a table."""
        if not _STAT.exists():
            return "How busy other programs kept the machine is not known."
        began, idle, own = self._began
        whole = (perf_counter() - began) * (os.cpu_count() or 1)
        others = max(0.0, whole - (_idle() - idle) - (_own() - own)) / whole
        return f"Meanwhile other programs took {others:.0%} of all cores."


def _idle() -> float:
    """Return the seconds for which the cores have been idle in all."""
    if not _STAT.exists():
        return 0.0
    _, _, _, idle, waiting = map(int, _STAT.read_text(encoding="ascii").split(maxsplit=6)[1:6])
    return (idle + waiting) / os.sysconf("SC_CLK_TCK")


def _own() -> float:
    """Return the seconds of CPU of this process and of those it started that have ended."""
    used = (resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)
