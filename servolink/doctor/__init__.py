"""Find out why a board does not work, or works badly."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """One reason why a board does not work, or works badly."""

    check: str
    """Which check found it, in one or two words that never change."""
    observation: str
    meaning: str
    remedy: str
    """Commands to type or things to do, one step a line."""
