"""Results of comparing, planning and importing projects, and the progress of each."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, TypeAlias

from msgspec import Struct

from servolink.project.summary import plan_rows, plan_table, repr_with_counts

Phase: TypeAlias = Literal["reading", "saving", "marking", "clearing", "writing", "verifying", "finishing"]
"""`reading` and `saving` change nothing on the board; from `marking` on, the project id shows an import under way."""


class Progress(Struct, frozen=True):
    """Latest step of a transfer."""

    phase: Phase
    done: int
    total: int
    """Items of this phase. An import may have to write more items than expected at first."""
    item: str
    """Name such as "action 3"."""


ProgressCallback: TypeAlias = Callable[[Progress], None]


class Change(Struct, frozen=True):
    """Single difference: an addition (no `old`), a removal (no `new`) or a change."""

    what: str
    """Name such as "action 3" or "project id"."""
    old: Any = None
    """Action, Macro, JoystickTable, ServoParameter, or an id."""
    new: Any = None


class Memory(Struct, frozen=True):
    """Memory of the board before and after an import, in bytes. The protocol names no unit."""

    unit: int | None
    """Bytes per unit in the board's figures; None: unknown, bytes are assumed."""
    size: int | None
    """Total memory in bytes; None on boards without this value."""
    free_before: int
    free_after: int
    """Free memory after the import. Below 0, the project seems not to fit; only writing the project gives certainty."""

    @property
    def warning(self) -> str:
        """Reason why the project may not fit; empty if the project seems to fit."""
        if self.free_after >= 0:
            return ""
        needed = self.free_before - self.free_after
        unit = "assuming memory figures in bytes" if self.unit is None else f"counted in units of {self.unit:,} bytes"
        return (
            f"the project may not fit: {needed:,} bytes more than the present content; the board has "
            f"{self.free_before:,} bytes free, {unit}"
        )


class Plan(Struct, frozen=True):
    """Changes, cost and memory of an import."""

    changes: tuple[Change, ...]
    """Changes in the order of a project file."""
    inconsistencies: tuple[str, ...]
    """Faults repaired by an import too: "action 3 is listed more than once"."""
    requests: int
    """Requests of the whole import: backup, writing, verification."""
    wire_bytes: int
    """Bytes in both directions, on a line without damage."""
    seconds: float
    """Estimated duration, based on the time for reading the board; boards with slow storage take longer."""
    memory: Memory | None
    """Memory of the board; None if the board does not answer the query."""
    is_unfinished: bool
    """Whether the board holds an unfinished import."""

    def __repr__(self) -> str:
        """Return the plan with the number of changes in place of all changes."""
        return repr_with_counts(self)

    def rows(self) -> Iterator[tuple[str, str, str]]:
        """Yield each change: the name of the record, what the board holds, and what it holds afterwards."""
        return plan_rows(self)

    def _repr_html_(self) -> str:
        """Return a table of the changes for notebooks."""
        return plan_table(self)

    @property
    def differs(self) -> bool:
        """Whether an import would change anything."""
        return bool(self.changes or self.inconsistencies)


class ApplyResult(Struct, frozen=True):
    """Outcome of an import."""

    changed: bool
    """False: the board held the project already, and nothing was written."""
    resumed: bool
    """Whether the import continued an interrupted import."""
    backup: Path | None
    """File with the board's content from before."""
    project_id_bits: Literal[32, 16, 0] | None = None
    """Number of project id bits kept by a board; None if nothing was written.

    With fewer than 32, an interrupted import is recognised only from this computer and at this address; with 0, only
    by the board's content, and two programs that import at the same time do not notice each other.
    """
