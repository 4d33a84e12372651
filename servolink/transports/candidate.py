"""A device that may be a board, as found without opening it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Candidate:
    """Where a board may be: `problem` says why it cannot be opened and what to do, empty if nothing is known."""

    url: str
    product: str = ""
    serial_number: str = ""
    problem: str = ""
