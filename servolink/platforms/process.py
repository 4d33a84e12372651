"""User, groups and limits of the process, and the names of other users."""

from __future__ import annotations

import getpass
import os
import sys
from contextlib import suppress

if sys.platform != "win32":
    import grp
    import pwd
    import resource


def login_name() -> str:
    """Return the login name of the user of the process; empty if unknown to the system."""
    with suppress(KeyError, OSError, ImportError):  # ImportError: Windows without USERNAME, before Python 3.13
        return getpass.getuser()
    return ""


def own_name() -> str:
    """Return the name of the effective user of the process; empty on Windows."""
    if sys.platform == "win32":
        return ""
    else:
        return user_name(os.geteuid())


def own_groups() -> frozenset[str]:
    """Return the names of the groups of the process."""
    if sys.platform == "win32":
        return frozenset()
    else:
        return frozenset(group_name(number) for number in {os.getegid(), *os.getgroups()})


def user_name(number: int) -> str:
    """Return the name of a user; the number of an unknown user."""
    if sys.platform != "win32":
        with suppress(KeyError):
            return pwd.getpwuid(number).pw_name
    return str(number)


def group_name(number: int) -> str:
    """Return the name of a group; the number of an unknown group."""
    if sys.platform != "win32":
        with suppress(KeyError):
            return grp.getgrgid(number).gr_name
    return str(number)


def members(group: str) -> list[str] | None:
    """Return the members of `group`, including users still logged in without the group; None for an unknown group."""
    if sys.platform != "win32":
        with suppress(KeyError):
            return grp.getgrnam(group).gr_mem
    return None


def most_open_files() -> int | None:
    """Return the most files and connections the process can have open; None for no limit."""
    if sys.platform == "win32":
        return None
    else:
        most, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
        return None if most == resource.RLIM_INFINITY else most
