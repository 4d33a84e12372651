"""The journal of one import: what a later run needs to finish it, or to undo it, and how its board is recognised."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterable
from typing import Annotated, Any, Literal, TypeAlias

import msgspec
from msgspec import Meta, Struct

from servolink.project.model import UNFINISHED, Project, without_neutral
from servolink.project.transfer.marker import is_cut, is_same_id
from servolink.project.transfer.pinned import ProjectIDBits
from servolink.project.transfer.read import Content
from servolink.protocol.record_types import STORED_TYPES, StoredType

JournalPhase: TypeAlias = Literal["writing", "clearing", "finishing", "finished"]
Digests: TypeAlias = "dict[str, str]"
"""A short digest of each record, by its name such as "action 3"."""


class Journal(Struct, frozen=True, forbid_unknown_fields=True):
    """Record of an import, written before each step that needs a further step.

    The marker makes it the journal of one board: the board's project id is the marker during the import, wherever and
    to whichever computer it is plugged in. Of boards that keep less of a project id, less is certain.
    """

    marker: Annotated[int, Meta(ge=UNFINISHED.start, lt=UNFINISHED.stop)]
    """Of this run alone: the next one that continues the import takes another."""
    url: str
    """The address of the board."""
    project_id: int
    """Of the project that is written."""
    backup: str | None
    """The name of the file with what the board held before; None if it was told to do without."""
    phase: JournalPhase = "writing"
    """`clearing`: the board may be without the marker, because it deletes its project id too. `finishing`: everything
    is written, and the board has the project id, or is about to get it. `finished`: it has confirmed that."""
    restores: str | None = None
    """The name of the backup that is written, if this is a rollback: asked for again before it was `finished`, it
    continues."""
    project_id_bits: ProjectIDBits | None = None
    """How many bits of a project id the board keeps, if they are fewer than 32. Nothing is written before this is
    known and noted."""
    constant_id: int = 0
    """The number that a board returns which keeps no bits of a project id."""
    target: Digests = {}
    """The digests of what is written to a board that keeps fewer than 32 bits."""

    @property
    def has_written_all(self) -> bool:
        """Whether only the project id is left to write, or nothing."""
        return self.phase in ("finishing", "finished")

    def is_of(self, project_id: int, url: str) -> bool:
        """Return whether the board at `url` with this project id is in the middle of this import."""
        if self.marker == project_id:
            return True
        if self.url != url or self.phase == "finished" or self.project_id_bits == 0:
            return False
        if project_id == 0 and self.phase == "clearing":
            return True
        # Without `project_id_bits` it was interrupted just when the board turned out to keep only these.
        return is_cut(project_id, self.marker)

    def may_be_of(self, project_id: int, url: str) -> bool:
        """Return whether it is of a board without project ids that was at `url`: only its content tells more."""
        return self.project_id_bits == 0 and self.url == url and self.constant_id == project_id


def journal_of(journals: Iterable[Journal], project_id: int, url: str) -> Journal | None:
    """Return the journal of the import that the board with this project id is in the middle of, if there is one.

    A marker that the board has whole outweighs all that the address suggests.
    """
    found = [journal for journal in journals if journal.is_of(project_id, url)]
    return next((journal for journal in found if journal.marker == project_id), found[0] if found else None)


def last_import(journals: Iterable[Journal], project_id: int, url: str) -> Journal | None:
    """Return the journal of the import that left this project id on the board at `url`, if it is known."""
    return next(
        (
            one
            for one in journals
            if one.has_written_all
            and one.url == url
            and one.project_id_bits != 0
            and is_same_id(project_id, one.project_id, one.project_id_bits)
        ),
        None,
    )


def by_content(
    journals: Iterable[Journal], content: Content, url: str, backups: dict[str, Digests], *, is_over: bool
) -> Journal | None:
    """Return the journal of an import to a board without project ids, recognised by its address and its content.

    `is_over` asks for one that has written everything: its board holds exactly what was written. Otherwise its board
    holds records from before, in `backups`, and written ones, and at most one that was torn when the power was lost.
    """
    found = digests_of(content.readable())
    for journal in journals:
        if not journal.may_be_of(content.project_id, url) or journal.has_written_all != is_over:
            continue
        if is_over and found == journal.target:
            return journal
        if not is_over:
            sources = [journal.target, backups.get(journal.backup or "", {})]
            unknown = strangers(found, sources)
            if len(unknown) <= 1 and all(any(name in source for source in sources) for name in unknown):
                return journal
    return None


def digests_of(project: Project) -> Digests:
    """Return the digests of all records of a project, neutral servo parameters aside."""
    project = msgspec.structs.replace(project, servo_parameters=tuple(without_neutral(project.servo_parameters)))
    return {
        f"{stored_type} {stored_type.id_of(record)}": _digest(stored_type, record)
        for stored_type in STORED_TYPES
        for record in stored_type.by_id(project).values()
    }


def strangers(found: Digests, sources: Collection[Digests]) -> list[str]:
    """Return the names of records that none of `sources` has in this form."""
    return [name for name, digest in found.items() if all(source.get(name) != digest for source in sources)]


def _digest(stored_type: StoredType[Any], record: Any) -> str:
    # `repr` tells all values apart, also captions that are not valid text.
    text = repr(msgspec.structs.astuple(record)).encode("utf-8", "backslashreplace")
    return hashlib.blake2b(text, digest_size=6, person=stored_type.field.encode()[:16]).hexdigest()
