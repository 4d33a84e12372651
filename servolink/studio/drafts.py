"""Drafts: unwritten edits of a board's content, kept on this computer record by record.

Several pages may edit one draft, also those of several studios. Each record has a revision: a save that names an older
one is a conflict, and is refused with the version that is kept. Every save is on the disk before it is confirmed.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, cast

import msgspec
from msgspec import Meta, Struct

from servolink.errors import EncodeError, ProjectError, escape
from servolink.protocol import STORED_TYPES, convert, json_type
from servolink.support import MAX_SIZE, computed, is_name, lock, read_file, reason, user_folder, write_atomically

MOST_RECORDS = 4096
"""Most records in a draft, discarded edits included."""

Kind: TypeAlias = Literal[
    "servo_parameters", "actions", "macros", "joystick_tables", "active_joystick_table", "project_id"
]
"""A field of project files. The record of the last two is a number."""

_FORMS: dict[str, Any] = {
    kind.field: json_type(cast("type[Struct]", kind.record_class), unchecked=True) | None for kind in STORED_TYPES
}
_FORMS["active_joystick_table"] = int | None
_FORMS["project_id"] = int | None
_UNSEEN = (0, 0, 0)
_logger = logging.getLogger(__name__)


class Edit(Struct, frozen=True, forbid_unknown_fields=True):
    """Edit of a record by a page."""

    kind: Kind
    id: Annotated[int, Meta(ge=-(2**31), lt=2**32)]
    known: Annotated[int, Meta(ge=0)]
    """Revision known to the page, 0 for none."""
    base: Any = None
    """Content of the board at the first edit of the record, in the form of project files; null for nothing."""
    record: Any = None
    """Content that the board is to hold; null for nothing."""
    is_discarded: bool = False
    """Whether the edit is discarded, so that the content of the board stays."""


class Kept(Struct, frozen=True, forbid_unknown_fields=True):
    """Edit of a record, with revision and author."""

    kind: Kind
    id: int
    revision: int
    who: str
    base: Any = None
    record: Any = None
    is_discarded: bool = False


class _DraftFile(Struct, forbid_unknown_fields=True):
    """The file of a draft."""

    draft: Literal[1] = 1
    revision: int = 0
    records: list[Kept] = []


class Drafts:
    """Draft of a single board. ProjectError if the file cannot be read or written."""

    def __init__(self, board: str) -> None:
        """Keep the draft of the board with this name; folder and file are created on first use."""
        self._board = board
        self._turn = asyncio.Lock()
        self._told = 0  # revision up to which the pages of the studio know all edits
        self._seen = _UNSEEN

    async def kept(self) -> tuple[Kept, ...]:
        """Return all kept edits of the board."""
        async with self._turn:
            return tuple((await asyncio.to_thread(self._read)).records)

    async def news(self) -> tuple[Kept, ...]:
        """Return edits kept by other studios since the last call; edits of this studio may be among them."""
        async with self._turn:
            if self._seen == (now := _identity(draft_path(self._board))):
                return ()
            file = await asyncio.to_thread(self._read)
            told = self._told if self._told <= file.revision else 0  # a damaged draft was put aside
            self._seen, self._told = now, file.revision
        return tuple(one for one in file.records if one.revision > told)

    async def save(self, edits: list[Edit], who: str) -> tuple[tuple[Kept, ...], tuple[Kept, ...]]:
        """Keep the edits of `who`; return the kept edits, and the earlier edits of others that won.

        Raise EncodeError, which names the place, for anything but a record.
        """
        await computed(_check_all)(edits)
        async with self._turn:
            return await asyncio.to_thread(self._save_locked, edits, who)

    def _save_locked(self, edits: list[Edit], who: str) -> tuple[tuple[Kept, ...], tuple[Kept, ...]]:
        with _locked(draft_path(self._board).with_suffix(".lock")):
            return self._save(edits, who)

    def _save(self, edits: list[Edit], who: str) -> tuple[tuple[Kept, ...], tuple[Kept, ...]]:
        file = self._read()  # read each time: another studio of this board may have written the file
        is_told = file.revision == self._told
        records = {(one.kind, one.id): one for one in file.records}
        saved: list[Kept] = []
        conflicts: list[Kept] = []
        for edit in edits:
            before = records.get((edit.kind, edit.id))
            if before is not None and before.revision > edit.known and not _says_same(before, edit):
                conflicts.append(before)
                continue
            file.revision += 1
            base, record = (None, None) if edit.is_discarded else (edit.base, edit.record)
            kept = Kept(edit.kind, edit.id, file.revision, who, base, record, edit.is_discarded)
            records.pop((edit.kind, edit.id), None)  # so that the newest come last
            records[edit.kind, edit.id] = kept
            saved.append(kept)
        if saved:
            file.records = _fewer(list(records.values()))
            self._write(file)
            if is_told:  # otherwise `news` finds the edits of others, and these too
                self._told, self._seen = file.revision, _identity(draft_path(self._board))
        return tuple(saved), tuple(conflicts)

    def _read(self) -> _DraftFile:
        path = draft_path(self._board)
        try:
            return msgspec.convert(json.loads(read_file(path, MAX_SIZE)), _DraftFile)
        except FileNotFoundError:
            return _DraftFile()
        except OSError as error:
            raise ProjectError(f"{escape(str(path))}: the draft cannot be read: {reason(error)}") from error
        except (ValueError, RecursionError) as error:  # JSON and types raise subclasses of ValueError
            aside = path.with_suffix(".damaged")
            _logger.warning("%s is damaged (%s); it is kept as %s", escape(str(path)), error, escape(aside.name))
            try:
                path.replace(aside)
            except OSError as refusal:
                raise ProjectError(f"{escape(str(path))} is damaged, and cannot be moved: {reason(refusal)}") from error
            return _DraftFile()

    def _write(self, file: _DraftFile) -> None:
        path = draft_path(self._board)
        content = json.dumps(msgspec.to_builtins(file)).encode()  # ASCII: a caption may have bytes without a character
        if len(content) > MAX_SIZE:
            raise ProjectError(f"the draft is larger than {MAX_SIZE >> 20} MiB; write it to the board, or save it")
        try:
            write_atomically(path, content, private=True)
        except OSError as error:
            raise ProjectError(f"{escape(str(path))}: the draft cannot be kept: {reason(error)}") from error


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Lock the file and make other users of the lock wait. Raise ProjectError if locking is impossible."""
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with path.open("ab", buffering=0) as file:
            if not lock(file, wait=True):
                raise ProjectError(f"{escape(str(path))}: another studio is writing the draft for too long")
            yield
    except OSError as error:
        raise ProjectError(f"{escape(str(path))}: the draft cannot be kept: {reason(error)}") from error


def draft_path(board: str) -> Path:
    """Return the path of the draft of a board. Raise ProjectError for a user without a home."""
    try:
        return user_folder("data") / "drafts" / f"{file_name(board)}.json"
    except OSError as error:
        raise ProjectError(f"drafts cannot be kept: {reason(error)}") from error


def _identity(path: Path) -> tuple[int, int, int]:
    """Return values that differ after the file was written again."""
    with suppress(OSError):
        status = path.stat()
        return status.st_ino, status.st_mtime_ns, status.st_size
    return _UNSEEN


def file_name(board: str) -> str:
    """Return a name for files of a board, whatever characters the board's name has."""
    return board if is_name(board) else f"_{board.encode().hex()[:120]}"


def _check_all(edits: list[Edit]) -> None:
    for number, edit in enumerate(edits):
        _check(edit, f"edits[{number}]")


def _check(edit: Edit, place: str) -> None:
    for name in ("base", "record"):
        try:
            convert(getattr(edit, name), _FORMS[edit.kind])
        except EncodeError as error:
            raise EncodeError(error.text, f"{place}.{name}.{error.path}".removesuffix(".")) from None


def _says_same(kept: Kept, edit: Edit) -> bool:
    """Return whether both edits have the same result, so that their order does not matter."""
    return kept.is_discarded == edit.is_discarded and (kept.is_discarded or kept.record == edit.record)


def _fewer(records: list[Kept]) -> list[Kept]:
    """Return the records up to the limit, without the oldest of the discarded edits."""
    if len(records) > MOST_RECORDS:
        excess = len(records) - MOST_RECORDS
        given_up = [number for number, one in enumerate(records) if one.is_discarded][:excess]
        if len(given_up) < excess:
            raise ProjectError(f"a draft holds at most {MOST_RECORDS} records; write it to the board first")
        records = [one for number, one in enumerate(records) if number not in set(given_up)]
    return records
