"""Search for the reasons why a board does not work, or works badly."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Finding:
    """Reason why a board does not work, with a remedy."""

    check: str
    """Name of the check, a word or two that never change."""
    observation: str
    meaning: str
    remedy: str
    """Commands to type or steps to take, each on a line."""
    is_harmless: bool = False
    """Whether programs work nevertheless."""
