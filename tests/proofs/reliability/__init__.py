"""What a bad line, a bad board and a busy program do to a conversation: `python -m tests.proofs.reliability --help`.

Everything is drawn from seeds and runs in virtual time, unless it says otherwise. One seed is one history: lines are in
`line.py`, boards in `board.py`, what callers do in `conversation.py`, and what must not be in `checker.py`. A fault
is printed with its seed; `python -m tests.proofs.reliability --seed N` lives through it again and shows what led to it.
"""

from __future__ import annotations

from importlib import import_module

from benchmarks.measuring import Result

PARTS = (
    *("model", "simulation", "framing", "hidden", "sums", "stalls", "flood", "lossy", "reopening", "soak", "hub"),
    *("stops", "installation"),
)
"""Modules here, each with `run(*, short) -> Result`."""


def run(*, short: bool) -> Result:
    """Run all parts; the published figures come from longer runs of single parts."""
    return together({part: import_module(f"tests.proofs.reliability.{part}").run(short=short) for part in PARTS})


def together(parts: dict[str, Result]) -> Result:
    """Return one result for all parts."""
    return {
        "tables": [quote for part in parts.values() for quote in part["tables"]],
        "wrong": [f"{name}: {fault}" for name, part in parts.items() for fault in part["wrong"]],
        "parts": parts,
    }
