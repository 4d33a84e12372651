"""Backups of boards, and the journals of imports, as files on this computer."""

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

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.files import read_file, reason, user_folder, write_atomically
from servolink.project.model import UNFINISHED, Project
from servolink.project.project_file import format_project, load_project
from servolink.project.transfer.journal import Journal, journal_of

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
    """A backup of a board: a project file like any other."""

    number: int
    """Counts up, because clocks are put back."""
    time: datetime
    board: str
    """The address of the board, in characters that file names allow."""
    caption_encoding: str
    """Encoding with which captions were read and must be written, in characters that file names allow."""
    digest: str
    """Of the content: a backup that was changed is refused."""
    path: Path


class BackupStore:
    """A folder with `backups` and `imports` in it. ProjectError names the file that fails."""

    def __init__(self, folder: Path | None = None, now: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        """Use `folder`, by default one in the user's data folder; it is created when it is needed."""
        self.folder = folder or _data_folder()
        self.now = now

    def keep(self, project: Project, url: str, caption_encoding: str) -> Path:
        """Write a backup of the board at `url`, read it back and return its path; it is never overwritten."""
        with self._creating("backups", "the backup") as folder:
            number = 1 + max((backup.number for backup in self.backups()), default=0)
            what = f"{_slug(url)}-{_slug_of_encoding(caption_encoding)}-{_digest(project)}"
            path = folder / f"{number:06}-{self.now():{_TIME}}-{what}{_SUFFIX}"
            write_atomically(path, format_project(project).encode(), private=True)
        if load_project(path, unchecked=True) != project.sorted():
            raise ProjectError(f"{path}: the backup does not read back as it was written")
        return path

    def load(self, path: Path, caption_encoding: str | None = None) -> Project:
        """Return the project in `path`, which may be any file.

        ProjectError also for a backup of this folder that was changed, or was read with captions in another encoding
        than `caption_encoding`; None accepts any.
        """
        project = load_project(path, unchecked=True)
        backup = _backup(path) if path == self.path_of(path.name) else None
        if backup and caption_encoding and backup.caption_encoding != _slug_of_encoding(caption_encoding):
            raise ProjectError(
                f"{path} was read with captions in {backup.caption_encoding}; connect with that "
                f"caption encoding, not {caption_encoding}"
            )
        if backup and backup.digest != _digest(project):
            raise ProjectError(
                f"{path} has been changed since it was made; to restore it as it is now, copy it to "
                "another folder and give `rollback` the copy"
            )
        return project

    def backups(self) -> list[Backup]:
        """Return all backups, the newest last."""
        return sorted(filter(None, map(_backup, self._files("backups"))))

    def latest(self, *urls: str) -> Path | None:
        """Return the newest backup of the board at one of these addresses; None if there is none."""
        boards = set(map(_slug, urls))
        return next((backup.path for backup in reversed(self.backups()) if backup.board in boards), None)

    def path_of(self, name: str) -> Path:
        """Return the path of the backup of this name."""
        return self.folder / "backups" / name

    def write(self, journal: Journal) -> None:
        """Write `journal`, over an earlier state of it."""
        with self._creating("imports", "the journal of the import"):
            # ASCII, in which an address that is not valid text can be written too.
            content = json.dumps(msgspec.to_builtins(journal)).encode() + b"\n"
            write_atomically(self._journal(journal.marker), content, private=True)

    def end(self, journal: Journal) -> None:
        """Delete the journal of an import that is over. One that is left does no harm, as no board has its marker."""
        path = self._journal(journal.marker)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            _LOG.warning("the journal of an import that is over cannot be deleted: %s", escape(str(error)))

    def journals(self, project_id: int) -> list[Journal]:
        """Return all journals. Raise ProjectError if that of the board with this project id cannot be read."""
        found = []
        for path in self._files("imports"):
            if match := _JOURNAL.fullmatch(path.name):
                marker = int(match["marker"], 16)
                try:
                    found.append(_read(path, marker))
                except FileNotFoundError:
                    continue  # ended by another program at this moment
                except (OSError, ValueError, RecursionError) as error:  # JSON and types raise subclasses of ValueError
                    text = f"{escape(str(path))}: this journal of an import cannot be read: {escape(str(error))}"
                    if marker == project_id:
                        raise ProjectError(
                            f"{text}; move it away, and give `rollback` the backup to restore"
                        ) from error
                    _LOG.warning("%s", text)
        return found

    def new_marker(self, other_than: Collection[int] = ()) -> int:
        """Return a marker that no journal here has, and hardly any elsewhere.

        Its low 16 bits, which may be all that a board keeps, are not 0, nor those of a number in `other_than`.
        """
        taken = {0, *(number & 0xFFFF for number in other_than)}
        while True:
            marker = choice(UNFINISHED)
            if marker & 0xFFFF not in taken and not self._journal(marker).exists():
                return marker

    def _journal(self, marker: int) -> Path:
        return self.folder / "imports" / f"{marker:08x}.json"

    @contextmanager
    def _creating(self, name: str, what: str) -> Iterator[Path]:
        """Pass the folder of this name, which is made if there is none. Raise ProjectError for an error of the system.

        It says that `what` cannot be written.
        """
        folder = self.folder / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            yield folder
        except ProjectError:
            raise
        except (OSError, ValueError) as error:  # ValueError: NUL in the name of the folder
            why = f"{what} cannot be written: {reason(error)}"
            raise ProjectError(f"{folder}: {why}; correct that in this folder, and try again") from error

    def _files(self, name: str) -> list[Path]:
        folder = self.folder / name
        try:
            return sorted(path for path in folder.iterdir() if path.is_file())
        except FileNotFoundError:
            return []
        except (OSError, ValueError) as error:
            raise ProjectError(f"{folder} cannot be read: {error}") from error


_LOG = logging.getLogger(__name__)


def is_import_unfinished(store: BackupStore, project_id: int, url: str) -> bool:
    """Return whether the journals say that an import to the board at `url` with this project id was interrupted.

    False also if they cannot be read.
    """
    try:
        journals = store.journals(project_id)
    except ProjectError:
        return False
    return journal_of(journals, project_id, url) is not None or any(
        journal.may_be_of(project_id, url) and not journal.has_written_all for journal in journals
    )


def _data_folder() -> Path:
    try:
        return user_folder("data")
    except OSError as error:
        raise ProjectError(f"backups of boards cannot be kept: {error.strerror}") from error


def _read(path: Path, marker: int) -> Journal:
    journal = msgspec.convert(json.loads(read_file(path, _LARGEST)), Journal)
    if journal.marker != marker:
        raise ValueError(f"it is that of {journal.marker:08x}")
    for name in filter(None, (journal.backup, journal.restores)):
        if Path(name).name != name or _backup(Path(name)) is None:
            raise ValueError(f"{name!r} must be the name of a backup")
    return journal


def _backup(path: Path) -> Backup | None:
    """Return what the name of a file says; None if it is not the name of a backup."""
    match = _BACKUP.fullmatch(path.name)
    try:
        time = datetime.strptime(match["time"], _TIME).replace(tzinfo=UTC) if match else None
    except ValueError:  # such as the 99th of a month
        time = None
    if match is None or time is None:
        return None
    return Backup(int(match["number"]), time, match["board"], match["encoding"], match["digest"], path)


def _digest(project: Project) -> str:
    """Return twelve hex digits that differ from project to project."""
    return hashlib.blake2b(format_project(project).encode(), digest_size=6).hexdigest()


def _slug_of_encoding(caption_encoding: str) -> str:
    """Return the same text for all names of an encoding, such as `utf_8`."""
    return re.sub(r"\W", "_", codecs.lookup(caption_encoding).name, flags=re.ASCII)


def _slug(url: str) -> str:
    """Return the address without options as a part of a file's name; of a long one the end, which says the most."""
    return re.sub(r"[^A-Za-z0-9.]+", "_", url.partition("?")[0])[-60:].strip("_.") or "board"
