"""Where this computer keeps backups of boards and the journals of imports that are under way."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import platformdirs
from msgspec import Struct

from servolink.atomic import write_atomically
from servolink.errors import ProjectError
from servolink.printable import printable
from servolink.project.file import format_project, load_project
from servolink.project.journal import Journal
from servolink.project.model import Project

_SUFFIX = ".servolink.json"
_LARGEST = 64 * 1024
_NAME = re.compile(r"(?P<time>\d{8}T\d{6}Z)-(?P<board>.*)-(?P<digest>[0-9a-f]{12})")


class Backup(Struct, frozen=True, order=True):
    """A backup of a board, which is a project file like any other."""

    time: datetime
    board: str
    """The address of the board, made fit for a file's name."""
    path: Path


class Store:
    """A folder with `backups` and `imports` in it; OSError, where files fail, says which."""

    def __init__(self, folder: Path | None = None, now: Callable[[], datetime] = lambda: datetime.now(UTC)) -> None:
        """Use `folder`, by default one in the user's own data folder; it is made when it is needed."""
        self.folder = folder or platformdirs.user_data_path("servolink", appauthor=False)
        self.now = now

    def keep(self, project: Project, url: str) -> Path:
        """Write a backup of the board at `url`, read it back and return where it is; it is never overwritten.

        ProjectError if what is read back is something else.
        """
        folder = self._made("backups")
        digest = digest_of(project)
        time = f"{self.now():%Y%m%dT%H%M%SZ}"
        path = folder / f"{time}-{_slug(url)}-{digest}{_SUFFIX}"
        if not path.exists():  # the same content in the same second is the same backup
            write_atomically(path, format_project(project).encode())
        if load_project(path, exact=True) != project.sorted():
            raise ProjectError(f"{printable(str(path))}: the backup does not read back as it was written")
        return path

    def backups(self, url: str | None = None) -> list[Backup]:
        """Return all backups, or those of the board at `url`, the newest last."""
        found = []
        for path in (self.folder / "backups").glob(f"*{_SUFFIX}"):
            if named := _NAME.fullmatch(path.name.removesuffix(_SUFFIX)):
                time = datetime.strptime(named["time"], "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC)
                found.append(Backup(time, named["board"], path))
        return sorted(backup for backup in found if url is None or backup.board == _slug(url))

    def write(self, journal: Journal) -> None:
        """Let `journal` be what is known of its import."""
        self._made("imports")
        write_atomically(self._journal(journal.marker), msgspec.json.encode(journal) + b"\n")

    def end(self, journal: Journal) -> None:
        """Forget an import that is over."""
        self._journal(journal.marker).unlink(missing_ok=True)

    def journals(self) -> list[Journal]:
        """Return the imports that are not known to be over; ProjectError names a journal that cannot be read."""
        found = []
        for path in sorted((self.folder / "imports").glob("*.json")):
            try:
                found.append(msgspec.json.decode(path.read_bytes()[:_LARGEST], type=Journal))
            except FileNotFoundError:
                continue  # ended by another program at this moment
            except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
                raise ProjectError(
                    f"{printable(str(path))}: this journal of an import cannot be read: {printable(str(error))}; "
                    "move it away, and give `rollback` the backup to restore"
                ) from error
        return found

    def _journal(self, marker: int) -> Path:
        return self.folder / "imports" / f"{marker:08x}.json"

    def _made(self, name: str) -> Path:
        folder = self.folder / name
        folder.mkdir(parents=True, exist_ok=True)
        return folder


def digest_of(project: Project) -> str:
    """Return twelve hex digits that tell one project from another."""
    return hashlib.blake2b(format_project(project).encode(), digest_size=6).hexdigest()


def _slug(url: str) -> str:
    """Return the address without options as a part of a file's name."""
    return re.sub(r"[^A-Za-z0-9.]+", "_", url.partition("?")[0]).strip("_.")[:60] or "board"
