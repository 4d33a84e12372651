"""What the doctor knows of the system: one object, so that the facts of any other system can stand in its place."""

from __future__ import annotations

import importlib.util
import os
import stat
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from servolink.printable import printable
from servolink.transports.permission import may_use

if sys.platform != "win32":
    import grp
    import pwd

_LONGEST = 65536  # characters that are read of one file


@dataclass(frozen=True, slots=True)
class Node:
    """Who may use a device file."""

    owner: str
    group: str
    mode: int
    """Its permission bits."""
    usable: bool
    """Whether this process may read and write it."""


@dataclass(frozen=True, slots=True)
class Process:
    """A running program, as far as it lets itself be seen."""

    pid: int
    name: str
    files: frozenset[str]
    """The paths that it has open; none if it belongs to somebody else."""


class SystemFacts:
    """Facts of this system, read when asked; what cannot be read is empty, and nothing raises."""

    def __init__(self, root: Path = Path("/"), platform: str = sys.platform) -> None:
        """Read files below `root`."""
        self.root = root
        self.platform = platform
        self.environment: Mapping[str, str] = os.environ
        self.python = sys.executable
        """What to type to run this Python."""
        self.pid = os.getpid()

    @property
    def user(self) -> str:
        """The name of the user this process runs as; empty where users have no numbers."""
        return "" if sys.platform == "win32" else _user_name(os.geteuid())

    @property
    def groups(self) -> frozenset[str]:
        """The groups this process is in."""
        if sys.platform == "win32":
            return frozenset()
        return frozenset(_group_name(number) for number in {os.getegid(), *os.getgroups()})

    def members(self, group: str) -> list[str] | None:
        """Return who is in `group` from the next login on; None if there is no such group."""
        if sys.platform == "win32":
            return None
        try:
            return grp.getgrnam(group).gr_mem
        except KeyError:
            return None

    def text(self, path: str) -> str:
        """Return the text of a file without the space around it."""
        try:
            with self._here(path).open(encoding="utf-8", errors="replace") as file:
                return file.read(_LONGEST).strip()
        except (OSError, ValueError):
            return ""

    def names(self, folder: str) -> list[str]:
        """Return what is in a folder."""
        try:
            return sorted(path.name for path in self._here(folder).iterdir())
        except (OSError, ValueError):
            return []

    def link(self, path: str) -> str:
        """Return what a symbolic link says."""
        try:
            return str(self._here(path).readlink())
        except (OSError, ValueError):
            return ""

    def real(self, path: str) -> str:
        """Return the path without symbolic links."""
        try:
            below = Path(os.path.realpath(self._here(path))).relative_to(os.path.realpath(self.root))
        except (OSError, ValueError):
            return path
        return f"/{below.as_posix()}"

    def node(self, path: str) -> Node | None:
        """Return who may use a device file; None if there is no such file."""
        try:
            status = self._here(path).stat()
        except (OSError, ValueError):
            return None
        return Node(
            owner=_user_name(status.st_uid),
            group=_group_name(status.st_gid),
            mode=stat.S_IMODE(status.st_mode),
            usable=may_use(str(self._here(path))),
        )

    def processes(self) -> Iterator[Process]:
        """Yield the running programs, where the system shows them as files."""
        for name in self.names("/proc"):
            if name.isdecimal():
                folder = f"/proc/{name}"
                files = frozenset(self.link(f"{folder}/fd/{number}") for number in self.names(f"{folder}/fd"))
                yield Process(int(name), printable(self.text(f"{folder}/comm")), files)

    def module(self, name: str) -> str:
        """Return the file from which Python would import a module; empty if it would not."""
        try:
            found = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            return ""
        return (found.origin or "") if found else ""

    def libusb(self) -> bool:
        """Tell whether pyusb finds a libusb."""
        try:
            import libusb_package

            return libusb_package.get_libusb1_backend() is not None
        except Exception:  # noqa: BLE001 - a missing or broken library fails in ways of its own
            return False

    def _here(self, path: str) -> Path:
        return self.root / path.lstrip("/")


def _user_name(number: int) -> str:
    """Return the name of a user; the number if there is none."""
    if sys.platform == "win32":
        return str(number)
    try:
        return pwd.getpwuid(number).pw_name
    except KeyError:
        return str(number)


def _group_name(number: int) -> str:
    """Return the name of a group; the number if there is none."""
    if sys.platform == "win32":
        return str(number)
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
