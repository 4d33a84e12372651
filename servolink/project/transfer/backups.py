"""Backups of boards, and journals of imports, as files on this computer."""

from __future__ import annotations

import codecs
import hashlib
import json
import logging
import re
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from secrets import choice

import msgspec
from msgspec import Struct

from servolink.errors import ProjectError, escape, quote
from servolink.project.model import UNFINISHED, Project
from servolink.project.project_file import ProjectFile, load_project
from servolink.project.transfer.journal import Journal, journal_of
from servolink.support import read_file, read_json, reason, user_folder, write_atomically

IMPORTS = "imports"
"""Folder of the journals."""

_SUFFIX = ".servolink.json"
_LARGEST = 1024 * 1024
_TIME = "%Y%m%dT%H%M%SZ"
_BACKUP = re.compile(
    r"(?P<number>\d{6,})-(?P<time>\d{8}T\d{6}Z)-(?P<board>[^-]*)-(?P<encoding>\w+)-(?P<digest>[0-9a-f]{12})"
    r"\.servolink\.json",
    re.ASCII,
)
_JOURNAL = re.compile(r"(?P<marker>[0-9a-f]{8})\.json")


class Backup(Struct, frozen=True, order=True):
    """Backup of a board, stored as an ordinary project file."""

    number: int
    """Serial number of the backup, because clocks can be put back."""
    time: datetime
    board: str
    """Address of the board, in characters allowed in file names."""
    caption_encoding: str
    """Encoding of the captions, read and to be written, in characters allowed in file names."""
    digest: str
    """Digest of the content: a changed backup is refused."""
    path: Path


class BackupStore:
    """Folder with `backups` and `imports`. Any ProjectError names the file at fault."""

    def __init__(self, folder: Path | None = None, now: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        """Use `folder`, by default in the user's data folder; the folder is created on first use."""
        self.folder = folder or data_folder()
        self.now = now

    def keep(self, project: Project, url: str, caption_encoding: str) -> Path:
        """Write a backup of the board at `url`, read back, and return the path; no backup is ever overwritten."""
        with self._creating("backups", "the backup") as folder:
            number = 1 + max((backup.number for backup in self.backups()), default=0)
            what = f"{_slug(url)}-{_slug_of_encoding(caption_encoding)}-{_digest(project)}"
            path = folder / f"{number:06}-{self.now():{_TIME}}-{what}{_SUFFIX}"
            write_atomically(path, ProjectFile(project).text().encode(), private=True)
        if load_project(path, unchecked=True) != project.sorted():
            raise ProjectError(f"{path}: the backup reads back with a different content")
        return path

    def load(self, path: Path, caption_encoding: str | None = None) -> Project:
        """Return the project in `path`, any project file.

        Raise ProjectError also for a backup of this folder with a changed content, or with captions read in another
        encoding than `caption_encoding`; None accepts any encoding.
        """
        project = load_project(path, unchecked=True)
        backup = _backup(path) if path == self.path_of(path.name) else None
        if backup and caption_encoding and backup.caption_encoding != _slug_of_encoding(caption_encoding):
            raise ProjectError(
                f"{path} was read with captions in {backup.caption_encoding}; connect with the same "
                f"caption encoding, not {caption_encoding}"
            )
        if backup and backup.digest != _digest(project):
            raise ProjectError(
                f"{path} was changed after the backup; to restore the changed content, copy the file to "
                "another folder and give `rollback` the copy"
            )
        return project

    def backups(self) -> list[Backup]:
        """Return all backups, sorted with the newest last."""
        return sorted(filter(None, map(_backup, self._files("backups"))))

    def latest(self, *urls: str) -> Path | None:
        """Return the newest backup of the board at any of these addresses; None without a backup."""
        boards = set(map(_slug, urls))
        return next((backup.path for backup in reversed(self.backups()) if backup.board in boards), None)

    def path_of(self, name: str) -> Path:
        """Return the path of the backup with this name."""
        return self.folder / "backups" / name

    def write(self, journal: Journal) -> None:
        """Write `journal`, replacing any earlier state."""
        with self._creating(IMPORTS, "the journal of the import"):
            # ASCII, where even an address of invalid text can be written.
            content = json.dumps(msgspec.to_builtins(journal)).encode() + b"\n"
            write_atomically(self._journal(journal.marker), content, private=True)

    def begin(self, url: str) -> None:
        """Note that an import to the board at `url` has begun, before its journal is known."""
        with self._creating(IMPORTS, "the note of an import"):
            write_atomically(self._begun(url), f"{escape(url)}\n".encode(), private=True)

    def has_begun(self, url: str) -> bool:
        """Return whether the latest import to the board at `url` ended before its journal, and so changed nothing."""
        return self._begun(url).exists()

    def end_beginning(self, url: str) -> None:
        """Forget the note of `begin`: the import has a journal, or nothing to change.

        Raise ProjectError for a note that stays: a rollback would find an import without a backup.
        """
        with self._creating(IMPORTS, "the note of an import"):
            self._begun(url).unlink(missing_ok=True)

    def _begun(self, url: str) -> Path:
        return self.folder / IMPORTS / f"begun-{_slug(url)}"

    def end(self, journal: Journal) -> None:
        """Delete the journal of an ended import. A remaining journal is harmless, as no board has the marker."""
        path = self._journal(journal.marker)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            _LOG.warning("the journal of an ended import cannot be deleted: %s", escape(str(error)))

    def journals(self, project_id: int) -> list[Journal]:
        """Return all journals. Raise ProjectError for an unreadable journal of the board with this project id."""
        found = []
        for path in self._files(IMPORTS):
            if match := _JOURNAL.fullmatch(path.name):
                marker = int(match["marker"], 16)
                try:
                    found.append(_read(path, marker))
                except FileNotFoundError:
                    continue  # deleted by another program at this moment
                except (OSError, ValueError) as error:  # types raise a subclass of ValueError
                    text = f"{escape(str(path))}: the journal of an import cannot be read: {escape(str(error))}"
                    if marker == project_id:
                        raise ProjectError(
                            f"{text}; move the journal away, and give `rollback` the backup to restore"
                        ) from error
                    _LOG.warning("%s", text)
        return found

    def may_have_journals(self) -> bool:
        """Return whether there may be journals of imports."""
        try:
            return any((self.folder / IMPORTS).iterdir())
        except FileNotFoundError:
            return False
        except (OSError, ValueError):  # raised again, with the remedy, when the journals are read
            return True

    def journal_of(self, project_id: int, url: str) -> Journal | None:
        """Return the journal of the unfinished import on the board with this project id, None without an import."""
        return journal_of(self.journals(project_id), project_id, url)

    def is_import_unfinished(self, project_id: int, url: str) -> bool:
        """Return whether, by the journals, an import to the board at `url` with this project id was interrupted.

        With unreadable journals, return False.
        """
        try:
            journals = self.journals(project_id)
        except ProjectError:
            return False
        return any(
            journal.is_of(project_id, url) or (journal.may_be_of(project_id, url) and not journal.has_written_all)
            for journal in journals
        )

    def new_marker(self, other_than: Collection[int] = ()) -> int:
        """Return a marker not used in any journal here, and hardly anywhere else.

        The low 16 bits, on some boards all that is kept, are not 0, nor equal to those of a number in `other_than`.
        """
        used = {0, *(number & 0xFFFF for number in other_than)}
        while True:
            marker = choice(UNFINISHED)
            if marker & 0xFFFF not in used and not self._journal(marker).exists():
                return marker

    def _journal(self, marker: int) -> Path:
        return self.folder / IMPORTS / f"{marker:08x}.json"

    @contextmanager
    def _creating(self, name: str, what: str) -> Iterator[Path]:
        """Pass the folder of this name, created if missing. Raise ProjectError for an error of the system.

        The error message names `what` as impossible to write.
        """
        folder = self.folder / name
        try:
            yield folder
        except ProjectError:
            raise
        except (OSError, ValueError) as error:  # ValueError: NUL in the name of the folder
            why = f"{what} cannot be written: {reason(error)}"
            raise ProjectError(f"{folder}: {why}; correct the folder, and try again") from error

    def _files(self, name: str) -> list[Path]:
        folder = self.folder / name
        try:
            return sorted(path for path in folder.iterdir() if path.is_file())
        except FileNotFoundError:
            return []
        except (OSError, ValueError) as error:
            raise ProjectError(f"{folder} cannot be read: {reason(error)}") from error


_LOG = logging.getLogger(__name__)


def _read(path: Path, marker: int) -> Journal:
    journal = msgspec.convert(read_json(read_file(path, _LARGEST)), Journal)
    if journal.marker != marker:
        raise ValueError(f"the content belongs to {journal.marker:08x}")
    for name in filter(None, (journal.backup, journal.restores)):
        if Path(name).name != name or _backup(Path(name)) is None:
            raise ValueError(f"{quote(name)} must be the name of a backup")
    return journal


def _backup(path: Path) -> Backup | None:
    """Return the facts in the name of a file; None for any other file than a backup."""
    match = _BACKUP.fullmatch(path.name)
    try:
        time = datetime.strptime(match["time"], _TIME).replace(tzinfo=UTC) if match else None
    except ValueError:  # such as the 99th of a month
        time = None
    if match is None or time is None:
        return None
    return Backup(int(match["number"]), time, match["board"], match["encoding"], match["digest"], path)


def _digest(project: Project) -> str:
    """Return twelve hex digits, different from project to project."""
    return hashlib.blake2b(ProjectFile(project).text().encode(), digest_size=6).hexdigest()


def _slug_of_encoding(caption_encoding: str) -> str:
    """Return the same text for all names of an encoding, such as `utf_8`."""
    return re.sub(r"\W", "_", codecs.lookup(caption_encoding).name, flags=re.ASCII)


def _slug(url: str) -> str:
    """Return the address without options as a part of a file name; of a long address the end, which says most."""
    return re.sub(r"[^A-Za-z0-9.]+", "_", url.partition("?")[0])[-60:].strip("_.") or "board"


def data_folder() -> Path:
    """Return the user's folder of data. Raise ProjectError if it is unknown."""
    try:
        return Path(user_folder("data"))
    except OSError as error:
        raise ProjectError(f"backups of boards cannot be kept: {error.strerror}") from error
