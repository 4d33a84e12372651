"""Problem: one thing that is wrong with a project."""

from __future__ import annotations

from typing import Literal, TypeAlias

from msgspec import Struct

Severity: TypeAlias = Literal["error", "warning"]
"""`error`: a board cannot store it, or would run for ever; `warning`: a board does something else than was meant."""


class Problem(Struct, frozen=True):
    """One thing that is wrong with a project."""

    path: str
    """Where, in the names of the project file, such as `actions[3].steps[7].degree`; empty for all of it."""
    text: str
    severity: Severity
    fixable: bool = False
    """There is one right answer, and `fixed` gives it."""

    def __str__(self) -> str:
        """Return place and text."""
        return f"{self.path}: {self.text}" if self.path else self.text
