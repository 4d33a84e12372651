"""What the doctor says about one cause."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One reason why a board does not work, or works badly."""

    check: str
    """Which check found it, as one or two words that do not change."""
    seen: str
    means: str
    do: str
    """What to type or do, in as many lines as there are steps."""
