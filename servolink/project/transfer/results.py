"""What comparing, planning and importing projects comes to."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from msgspec import Struct

if TYPE_CHECKING:  # `Board` names these types, and loading it takes as long as loading all packets
    from pathlib import Path

Phase: TypeAlias = Literal["reading", "saving", "marking", "clearing", "writing", "verifying", "finishing"]
"""`reading` and `saving` change nothing on the board; from `marking` on it says that an import is under way."""


class Progress(Struct, frozen=True):
    """What has just been done."""

    phase: Phase
    done: int
    total: int
    """Items of this phase; what an import writes can turn out to be more."""
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


class Plan(Struct, frozen=True):
    """What would change on the board."""

    changes: tuple[Change, ...]
    """In the order of a project file."""
    inconsistencies: tuple[str, ...]
    """What else an import puts right: "action 3 is listed more than once"."""
    requests: int
    """Of the whole import: backup, writing, verification."""
    wire_bytes: int
    """In both directions, on a line without damage."""
    seconds: float
    """Estimated from the time that reading the board took."""
    memory_size: int | None
    """Bytes of the board's memory; None on boards that do not say."""
    free_before: int
    free_after: int
    """Below 0: it does not fit."""
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
        """Whether there is anything to do."""
        return bool(self.changes or self.inconsistencies)


class ApplyResult(Struct, frozen=True):
    """What an import did."""

    changed: bool
    """False: the board held the project already, and nothing was written."""
    resumed: bool
    """It went on with an import that had been interrupted."""
    backup: Path | None
    """What the board held before."""
