"""Journal of an import: facts for a later run to finish or undo the import, and to recognise the board."""

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
from servolink.protocol import STORED_TYPES, StoredType
from servolink.support import computed

JournalPhase: TypeAlias = Literal["writing", "clearing", "finishing", "finished"]
Digests: TypeAlias = "dict[str, str]"
"""Short digest of each record, by name such as "action 3"."""


class Journal(Struct, frozen=True, forbid_unknown_fields=True):
    """Record of an import, written before each step that needs a further step.

    The marker ties the journal to a board: during the import, the board's project id is the marker, at any port and on
    any computer. For boards that keep only a part of a project id, the tie is less certain.
    """

    marker: Annotated[int, Meta(ge=UNFINISHED.start, lt=UNFINISHED.stop)]
    """Marker of this run only: the next run of the same import uses another."""
    url: str
    """Address of the board during the import."""
    project_id: int
    """Project id of the project to write."""
    backup: str | None
    """File name of the backup of the board's content before; None for an import without a backup."""
    phase: JournalPhase = "writing"
    """`clearing`: the board may be without the marker, because clearing also deletes the project id. `finishing`: all
    records are written, and the project id is on the board or about to be. `finished`: confirmed by the board."""
    restores: str | None = None
    """Name of the backup to write, for a rollback: requested again before `finished`, the rollback continues."""
    project_id_bits: ProjectIDBits | None = None
    """Bits of a project id kept by the board, if fewer than 32. Nothing is written before the number is known and
    recorded."""
    constant_id: int = 0
    """Project id returned by a board that keeps no bits of a project id."""
    target: Digests = {}
    """Digests of all records to write, for a board that keeps fewer than 32 bits."""

    @property
    def has_written_all(self) -> bool:
        """Whether only the project id is left to write, or nothing."""
        return self.phase in ("finishing", "finished")

    def is_of(self, project_id: int, url: str) -> bool:
        """Return whether the board at `url` with this project id is in the middle of the import."""
        if self.marker == project_id:
            return True
        if self.url != url or self.phase == "finished" or self.project_id_bits == 0:
            return False
        if project_id == 0 and self.phase == "clearing":
            return True
        # Without `project_id_bits`, the run was interrupted just when the board turned out to keep only 16 bits.
        return is_cut(project_id, self.marker)

    def may_be_of(self, project_id: int, url: str) -> bool:
        """Return whether the journal is of a board without project ids at `url`: only the content tells more."""
        return self.project_id_bits == 0 and self.url == url and self.constant_id == project_id


def journal_of(journals: Iterable[Journal], project_id: int, url: str) -> Journal | None:
    """Return the journal of the unfinished import on the board with this project id, None without an import.

    A whole marker on the board outweighs all evidence from the address.
    """
    found = [journal for journal in journals if journal.is_of(project_id, url)]
    return next((journal for journal in found if journal.marker == project_id), found[0] if found else None)


def last_import(journals: Iterable[Journal], project_id: int, url: str) -> Journal | None:
    """Return the journal of the import that left this project id on the board at `url`; None if unknown."""
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


@computed
def by_content(
    journals: Iterable[Journal], content: Content, url: str, backups: dict[str, Digests], *, is_over: bool
) -> Journal | None:
    """Return the journal of an import to a board without project ids, recognised by address and content.

    `is_over` asks for a finished import: the board holds exactly the written records. Otherwise the board holds records
    from before, in `backups`, and written records, and at most one record torn by a loss of power.
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
    """Return the names of records not found in the same form in any of `sources`."""
    return [name for name, digest in found.items() if all(source.get(name) != digest for source in sources)]


def _digest(stored_type: StoredType[Any], record: Any) -> str:
    # `repr` tells all values apart, even captions of invalid text.
    text = repr(msgspec.structs.astuple(record)).encode("utf-8", "backslashreplace")
    return hashlib.blake2b(text, digest_size=6, person=stored_type.field.encode()[:16]).hexdigest()
