"""The journal of one import: what a later run needs to go on with it, or to undo it."""

from __future__ import annotations

import codecs
import hashlib
import json
import logging
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from secrets import choice
from typing import Annotated, Literal, TypeAlias

import msgspec
from msgspec import Meta, Struct

from servolink.errors import ProjectError
from servolink.escaping import escape
from servolink.files import read_file, user_folder, write_atomically
from servolink.project.model import UNFINISHED, Project
from servolink.project.project_file import format_project, load_project

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


_SUFFIX = ".servolink.json"
_LARGEST = 64 * 1024
_TIME = "%Y%m%dT%H%M%SZ"
_BACKUP = re.compile(
    r"(?P<number>\d{6,})-(?P<time>\d{8}T\d{6}Z)-(?P<board>[^-]*)-(?P<encoding>\w+)-(?P<digest>[0-9a-f]{12})"
    r"\.servolink\.json",
    re.ASCII,
)
_JOURNAL = re.compile(r"(?P<marker>[0-9a-f]{8})\.json")


class Backup(Struct, frozen=True, order=True):
    """A backup of a board, which is a project file like any other."""

    number: int
    """Counted up, because clocks are put back."""
    time: datetime
    board: str
    """The address of the board, made fit for a file's name."""
    caption_encoding: str
    """In which captions were read and have to be written, made fit likewise."""
    digest: str
    """Of the content, which nobody is to change."""
    path: Path


class BackupStore:
    """A folder with `backups` and `imports` in it; ProjectError, where files fail, says which."""

    def __init__(self, folder: Path | None = None, now: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        """Use `folder`, by default one in the user's own data folder; it is made when it is needed."""
        self.folder = folder or _data_folder()
        self.now = now

    def keep(self, project: Project, url: str, caption_encoding: str) -> Path:
        """Write a backup of the board at `url`, read it back and return where it is; it is never overwritten."""
        with _told("the backup cannot be written"):
            folder = self._made("backups")
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
        backup = _backup(path) if path == self.kept(path.name) else None
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

    def kept(self, name: str) -> Path:
        """Return where the backup of this name is."""
        return self.folder / "backups" / name

    def write(self, journal: Journal) -> None:
        """Let `journal` be what is known of its import."""
        with _told("the journal of the import cannot be written"):
            self._made("imports")
            # ASCII, in which an address that is no text has its place as well.
            content = json.dumps(msgspec.to_builtins(journal)).encode() + b"\n"
            write_atomically(self._journal(journal.marker), content, private=True)

    def end(self, journal: Journal) -> None:
        """Forget an import that is over; a journal that is left does no harm, as no board has its marker."""
        path = self._journal(journal.marker)
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            _LOG.warning("the journal of an import that is over cannot be deleted: %s", escape(str(error)))

    def journals(self, project_id: int) -> list[Journal]:
        """Return all journals; ProjectError if that of the board with this project id cannot be read."""
        found = []
        for path in self._files("imports"):
            if named := _JOURNAL.fullmatch(path.name):
                marker = int(named["marker"], 16)
                try:
                    found.append(_read(path, marker))
                except FileNotFoundError:
                    continue  # ended by another program at this moment
                except (OSError, ValueError, RecursionError) as error:  # JSON and types raise kinds of ValueError
                    text = f"{escape(str(path))}: this journal of an import cannot be read: {escape(str(error))}"
                    if marker == project_id:
                        raise ProjectError(
                            f"{text}; move it away, and give `rollback` the backup to restore"
                        ) from error
                    _LOG.warning("%s", text)
        return found

    def new_marker(self) -> int:
        """Return a marker that no journal here has, and hardly any elsewhere."""
        while True:
            marker = choice(UNFINISHED)
            if not self._journal(marker).exists():
                return marker

    def _journal(self, marker: int) -> Path:
        return self.folder / "imports" / f"{marker:08x}.json"

    def _made(self, name: str) -> Path:
        folder = self.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def _files(self, name: str) -> list[Path]:
        folder = self.folder / name
        try:
            return sorted(path for path in folder.iterdir() if path.is_file())
        except FileNotFoundError:
            return []
        except (OSError, ValueError) as error:
            raise ProjectError(f"{folder} cannot be read: {error}") from error


_LOG = logging.getLogger(__name__)


def _data_folder() -> Path:
    try:
        return user_folder("data")
    except OSError as error:
        raise ProjectError(f"backups of boards cannot be kept: {error.strerror}") from error


@contextmanager
def _told(what: str) -> Iterator[None]:
    """Raise ProjectError for what the system has against a file."""
    try:
        yield
    except ProjectError:
        raise
    except (OSError, ValueError) as error:  # ValueError: NUL in the name of the folder
        raise ProjectError(f"{what}: {error}") from error


def _read(path: Path, marker: int) -> Journal:
    journal = msgspec.convert(json.loads(read_file(path, _LARGEST)), Journal)
    if journal.marker != marker:
        raise ValueError(f"it is that of {journal.marker:08x}")
    for name in filter(None, (journal.backup, journal.restores)):
        if Path(name).name != name or _backup(Path(name)) is None:
            raise ValueError(f"{name!r} is no name of a backup")
    return journal


def _backup(path: Path) -> Backup | None:
    """Return what the name of a file says; None if it is no backup's."""
    named = _BACKUP.fullmatch(path.name)
    try:
        time = datetime.strptime(named["time"], _TIME).replace(tzinfo=UTC) if named else None
    except ValueError:  # such as the 99th of a month
        time = None
    if not (named and time):
        return None
    return Backup(int(named["number"]), time, named["board"], named["encoding"], named["digest"], path)


def _digest(project: Project) -> str:
    """Return twelve hex digits that tell one project from another."""
    return hashlib.blake2b(format_project(project).encode(), digest_size=6).hexdigest()


def _slug_of_encoding(caption_encoding: str) -> str:
    """Return the same for all names of an encoding, such as `utf_8`."""
    return re.sub(r"\W", "_", codecs.lookup(caption_encoding).name, flags=re.ASCII)


def _slug(url: str) -> str:
    """Return the address without options as a part of a file's name; of a long one the end, which tells the most."""
    return re.sub(r"[^A-Za-z0-9.]+", "_", url.partition("?")[0])[-60:].strip("_.") or "board"
