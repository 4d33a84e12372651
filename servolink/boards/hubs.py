"""Hubs on the local machine: each hub claims a unique name, and announces the board to share.

The hub NAME holds the lock of the file `NAME.hub` in the runtime folder of the user. The system releases the lock with
the process, so that the name of a killed hub is free again.
"""

from __future__ import annotations

import asyncio
import os
from contextlib import suppress
from pathlib import Path
from typing import Self

from servolink.boards.announcements import read_all, write
from servolink.boards.searching import identity_of, is_same_place
from servolink.errors import OpenError, Reason, quote
from servolink.support import LockedFile, is_name, private_folder, reason
from servolink.transports import DeviceInfo, PortIdentity

_SUFFIX = ".hub"
_PRIVATE = 0o700
_TRIES, _PAUSE = (
    10,
    0.01,
)  # attempts to lock a name, and seconds between: the search for boards locks leftover files for a moment


class HubClaim:
    """Claim to the name of a hub, released at the end of its context."""

    def __init__(self, name: str, folder: Path, file: LockedFile) -> None:
        self.name = name
        self.folder = folder
        """Folder where only the user can create files."""
        self._file = file

    @classmethod
    async def of(cls, name: str) -> Self:
        """Claim a name for a hub. Raise OpenError, with the current owner of the name."""
        if not is_name(name):
            raise OpenError(f"{quote(name)} cannot be the name of a hub: use up to 64 letters, digits, - and _")
        try:
            folder = private_folder()
            folder.chmod(_PRIVATE)  # an earlier version or another program may have made the folder readable for others
            file = await _locked(_file_of(name, folder))
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            raise OpenError(f"share://{name}: no hub can run here: {where}{reason(error)}") from error
        if file is None:
            server = await asyncio.to_thread(_described, name)
            text = f"share://{name} is {server} already: use that hub, or choose another name with --name"
            raise OpenError(text, reason=Reason.IN_USE)
        return cls(name, folder, file)

    def __enter__(self) -> Self:
        """Return the claim."""
        return self

    def __exit__(self, *_: object) -> None:
        """Release the name, and stop announcing the hub."""
        with suppress(OSError):  # a file without a lock counts as left over
            self._file.remove()

    @property
    def url(self) -> str:
        """Address of the hub, such as `share://rex`."""
        return f"share://{self.name}"

    def announce(self, url: str) -> None:
        """Announce the hub, as sharing the board at `url`, to the search for boards.

        Call when programs can connect. Blocks for some milliseconds. Raise OpenError if another hub shares the board,
        or if the file cannot be written.
        """
        identity = identity_of(url) or PortIdentity()
        product = f"shared by a hub (pid {os.getpid()})"
        try:
            write(DeviceInfo(self.url, product, identity, shares=url), self._file.file)
        except OSError as error:
            where = self._file.path
            raise OpenError(f"{self.url}: the hub cannot be announced to programs: {where}: {reason(error)}") from error
        # Checked after the file was written: of two hubs starting together, at least one finds the other.
        if (other := hub_of(url, but=self.url)) is not None:
            raise OpenError(
                f"{url} is {other.product} already: use {other.url}, or end the other hub first", reason=Reason.IN_USE
            )


def candidates() -> list[DeviceInfo]:
    """Return the running hubs of the user on the local machine."""
    return [hub for hub in read_all(_SUFFIX) if hub.shares]


def hub_of(url: str, *, but: str = "") -> DeviceInfo | None:
    """Return the hub sharing the board at `url`, None for an unshared board; ignore the hub at the address `but`."""
    if is_new_board(url):
        return None
    return next((hub for hub in candidates() if hub.url != but and is_same_place(hub.shares, url)), None)


def is_new_board(url: str) -> bool:
    """Return whether each connection to the address `url` creates a new board."""
    return url.startswith(("virtual://", "replay://"))


def _described(name: str) -> str:
    """Return the state of the hub `name`, as a phrase to follow "is"."""
    for hub in candidates():
        if hub.url == f"share://{name}":
            return f"{hub.product}, for {hub.shares},"
    return "taken by a hub that is starting or ending"


def _file_of(name: str, folder: Path) -> Path:
    return folder / f"{name}{_SUFFIX}"


async def _locked(path: Path) -> LockedFile | None:
    """Return the file, empty and locked, None if locked by another program. Raise OSError for any other failure."""
    for _ in range(_TRIES):
        if (file := LockedFile.open(path)) is not None:
            file.file.truncate()
            return file
        await asyncio.sleep(
            _PAUSE
        )  # without blocking: the event loop may serve other hubs, with dead-man times to keep
    return None
