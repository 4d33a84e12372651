"""The journal of one import: what a later run needs to go on with it, or to undo it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct

from servolink.project.model import UNFINISHED

JournalPhase: TypeAlias = Literal["writing", "clearing", "finishing", "finished"]


class Journal(Struct, frozen=True, forbid_unknown_fields=True):
    """Written before each step after which another step must follow.

    The marker is what makes it the journal of a board: the board's project id is the marker while the import is
    under way, wherever and to whichever computer it is plugged in.
    """

    marker: Annotated[int, Meta(ge=UNFINISHED.start, lt=UNFINISHED.stop)]
    """Of this run alone: the next one that goes on with the import takes another."""
    url: str
    """Where the board was."""
    project_id: int
    """Of the project that is written."""
    backup: str | None
    """The name of the file with what the board held before; none if it was told to do without."""
    phase: JournalPhase = "writing"
    """`clearing`: the board may be without the marker, because it deletes its project id too. `finishing`: all is
    written, and the board has the project id, or is about to get it. `finished`: it has said so."""
    restores: str | None = None
    """The name of the backup that is written, if this is a rollback: asked for again before it was `finished`, it goes
    on."""

    @property
    def has_written_all(self) -> bool:
        """Whether what is left is the project id, or nothing."""
        return self.phase in ("finishing", "finished")


def is_unfinished(project_id: int) -> bool:
    """Tell whether a project id says that an import is under way."""
    return project_id in UNFINISHED


def journal_of(journals: Iterable[Journal], project_id: int, url: str) -> Journal | None:
    """Return the journal of the import that the board with this project id is in the middle of, if there is one."""
    for journal in journals:
        if journal.marker == project_id:
            return journal
        if project_id == 0 and journal.phase == "clearing" and journal.url == url:
            return journal
    return None


def last_import(journals: Iterable[Journal], project_id: int, url: str) -> Journal | None:
    """Return the journal of the import that left this project id on the board at `url`, if it is known."""
    return next(
        (one for one in journals if one.has_written_all and (one.url, one.project_id) == (url, project_id)), None
    )
