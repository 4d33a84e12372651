"""User, groups and limits of the process, and the names of other users."""

from __future__ import annotations

import getpass
import os
import sys
from contextlib import suppress
from dataclasses import dataclass

if sys.platform != "win32" and sys.platform != "emscripten":
    import grp
    import pwd
    import resource


def login_name() -> str:
    """Return the login name of the user of the process; empty if unknown to the system."""
    with suppress(KeyError, OSError, ImportError):  # ImportError: Windows without USERNAME, before Python 3.13
        return getpass.getuser()
    return ""


@dataclass(frozen=True, slots=True)
class Account:
    """User and groups of a process or a file, by name; by number where the system knows no name."""

    user: str
    groups: frozenset[str]

    @classmethod
    def of_process(cls) -> Account:
        """Return effective user and groups of the process; no name and no group on Windows and in Pyodide."""
        if sys.platform == "win32" or sys.platform == "emscripten":
            return cls("", frozenset())
        else:
            return cls(_user(os.geteuid()), frozenset(map(_group, {os.getegid(), *os.getgroups()})))

    @classmethod
    def of_file(cls, status: os.stat_result) -> Account:
        """Return owner and group of a file."""
        return cls(_user(status.st_uid), frozenset({_group(status.st_gid)}))

    @staticmethod
    def members(group: str) -> list[str] | None:
        """Return the users in `group`, also those still logged in without the group; None for an unknown group."""
        if sys.platform != "win32" and sys.platform != "emscripten":
            with suppress(KeyError):
                return grp.getgrnam(group).gr_mem
        return None


def _user(number: int) -> str:
    if sys.platform != "win32" and sys.platform != "emscripten":
        with suppress(KeyError):
            return pwd.getpwuid(number).pw_name
    return str(number)


def _group(number: int) -> str:
    if sys.platform != "win32" and sys.platform != "emscripten":
        with suppress(KeyError):
            return grp.getgrgid(number).gr_name
    return str(number)


def most_open_files() -> int | None:
    """Return the most files and connections the process can have open; None for no limit."""
    if sys.platform == "win32" or sys.platform == "emscripten":
        return None
    else:
        most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return None if most == resource.RLIM_INFINITY else most
