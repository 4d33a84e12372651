"""Results of comparing, planning and importing projects, and the progress of doing so."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from msgspec import Struct

if TYPE_CHECKING:  # `Board` names these types, and loading it takes as long as loading all packets
    from pathlib import Path

Phase: TypeAlias = Literal["reading", "saving", "marking", "clearing", "writing", "verifying", "finishing"]
"""`reading` and `saving` change nothing on the board; from `marking` on it says that an import is under way."""


class Progress(Struct, frozen=True):
    """The latest step."""

    phase: Phase
    done: int
    total: int
    """Items of this phase. An import may have to write more than its first total."""
    item: str
    """Such as "action 3"."""


ProgressCallback: TypeAlias = Callable[[Progress], None]


def ignore_progress(progress: Progress) -> None:
    """Ignore progress."""


class Change(Struct, frozen=True):
    """One thing that is added (no `old`), removed (no `new`) or changed."""

    what: str
    """Such as "action 3" or "project id"."""
    old: Any = None
    """An Action, Macro, JoystickTable, ServoParameter, or an id."""
    new: Any = None


class Memory(Struct, frozen=True):
    """The board's memory before and after an import, in bytes. The protocol names no unit."""

    unit: int | None
    """Bytes in the unit in which the board counts; None: unknown, bytes are assumed."""
    size: int | None
    """Total memory; None on boards that do not return this value."""
    free_before: int
    free_after: int
    """Below 0: the project seems not to fit. Only writing it shows whether that is so."""

    @property
    def warning(self) -> str:
        """Why the project may not fit; empty if it seems to fit."""
        if self.free_after >= 0:
            return ""
        needed = self.free_before - self.free_after
        unit = (
            "if the board counts its memory in bytes, which is not known"
            if self.unit is None
            else f"counted in units of {self.unit:,} bytes"
        )
        return (
            f"the project may not fit: it takes {needed:,} bytes more than what is on the board, which has "
            f"{self.free_before:,} bytes free, {unit}"
        )


class Plan(Struct, frozen=True):
    """What would change on the board."""

    changes: tuple[Change, ...]
    """In the order of a project file."""
    inconsistencies: tuple[str, ...]
    """Faults that an import repairs too: "action 3 is listed more than once"."""
    requests: int
    """Of the whole import: backup, writing, verification."""
    wire_bytes: int
    """In both directions, on a line without damage."""
    seconds: float
    """Estimated from the time that reading the board took; boards that store slowly take longer."""
    memory: Memory | None
    """Memory of the board; None if the board does not answer the query."""
    is_unfinished: bool
    """The board holds an unfinished import."""

    def __repr__(self) -> str:
        """Return the plan with the number of changes, not all of them."""
        from servolink.project.summary import repr_with_counts

        return repr_with_counts(self)

    def _repr_html_(self) -> str:
        """Return a table of the changes, which notebooks show."""
        from servolink.project.summary import plan_table

        return plan_table(self)

    @property
    def differs(self) -> bool:
        """Whether an import would change anything."""
        return bool(self.changes or self.inconsistencies)


class ApplyResult(Struct, frozen=True):
    """The outcome of an import."""

    changed: bool
    """False: the board held the project already, and nothing was written."""
    resumed: bool
    """It continued an import that had been interrupted."""
    backup: Path | None
    """The file with what the board held before."""
    project_id_bits: Literal[32, 16, 0] | None = None
    """How many bits of a project id the board keeps; None if nothing was written.

    With fewer than 32, an interrupted import is recognised only from this computer and at this address; with 0, only
    by what is on the board, and two programs that import at the same time do not notice each other.
    """
