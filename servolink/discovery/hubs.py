"""The hubs that run here: each has its name for itself, and announces which board it shares.

The file `NAME.hub` in the user's runtime folder belongs to the hub that has locked it. The lock ends with the process,
so that the name of a hub that was killed is free again.
"""

from __future__ import annotations

import asyncio
import os
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Self

from servolink.discovery.announcements import read_all, write
from servolink.discovery.search import identity_of, is_same_place
from servolink.errors import OpenError
from servolink.escaping import quote
from servolink.files import is_name, reason
from servolink.platforms.locks import open_locked, remove_locked
from servolink.platforms.private_files import private_folder
from servolink.transports.device_info import ANY_DEVICE, DeviceInfo

_SUFFIX = ".hub"
_PRIVATE = 0o700
_TRIES, _PAUSE = 10, 0.01  # of locking a name; the search for boards locks what was left over for a moment


class HubClaim:
    """The name of a hub, which is free again when the context of its claim ends."""

    def __init__(self, name: str, folder: Path, file: BinaryIO) -> None:
        """Use `claim_hub`."""
        self.name = name
        self.folder = folder
        """Folder in which only this user can create files."""
        self._file = file

    def __enter__(self) -> Self:
        """Return the claim."""
        return self

    def __exit__(self, *_: object) -> None:
        """Give the name back."""
        with suppress(OSError):  # without a lock it counts as left over
            remove_locked(_file_of(self.name, self.folder), self._file)

    @property
    def url(self) -> str:
        """The address of the hub."""
        return f"share://{self.name}"

    def announce(self, url: str) -> None:
        """Make the search find this hub, which shares the board at `url`.

        Blocks for some milliseconds. To be called when programs can connect. Raise OpenError if another hub shares the
        board, or if the file cannot be written.
        """
        identity = identity_of(url) or ANY_DEVICE
        product = f"shared by a hub (pid {os.getpid()})"
        try:
            write(DeviceInfo(self.url, product, identity, shares=url), self._file)
        except OSError as error:
            where = _file_of(self.name, self.folder)
            raise OpenError(f"{self.url}: programs could not find it: {where}: {reason(error)}") from error
        # After it was written: of two hubs that begin at the same time at least one finds the other.
        if (other := hub_of(url, but=self.url)) is not None:
            raise OpenError(f"{url} is {other.product} already: use {other.url}, or end that one first")


async def claim_hub(name: str) -> HubClaim:
    """Take a name for a hub. Raise OpenError, which names the hub that has it."""
    if not is_name(name):
        raise OpenError(f"{quote(name)} cannot be the name of a hub: use up to 64 letters, digits, - and _")
    try:
        folder = private_folder()
        folder.chmod(_PRIVATE)  # made by an earlier version or by another program, perhaps for others to read
        file = await _locked(_file_of(name, folder))
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        raise OpenError(f"share://{name}: no hub can run here: {where}{reason(error)}") from error
    if file is None:
        taken = await asyncio.to_thread(_described, name)
        raise OpenError(f"share://{name} is {taken} already: use it, or choose another name with --name")
    return HubClaim(name, folder, file)


def candidates() -> list[DeviceInfo]:
    """Return the hubs of this user that run on this machine."""
    return [hub for hub in read_all(_SUFFIX) if hub.shares]


def hub_of(url: str, *, but: str = "") -> DeviceInfo | None:
    """Return the hub that shares the board at `url`, None if none does, leaving out the one at the address `but`."""
    if is_new_board(url):
        return None
    return next((hub for hub in candidates() if hub.url != but and is_same_place(hub.shares, url)), None)


def is_new_board(url: str) -> bool:
    """Return whether each connection to this address leads to a board of its own."""
    return url.startswith(("virtual://", "replay://"))


def _described(name: str) -> str:
    """Return what the hub `name` does, in words that follow "is"."""
    for hub in candidates():
        if hub.url == f"share://{name}":
            return f"{hub.product}, for {hub.shares},"
    return "taken by a hub that is starting or ending"


def _file_of(name: str, folder: Path) -> Path:
    return folder / f"{name}{_SUFFIX}"


async def _locked(path: Path) -> BinaryIO | None:
    """Return the file, empty and locked, None if another program has it. Raise OSError if it cannot be had at all."""
    for _ in range(_TRIES):
        if (file := open_locked(path)) is not None:
            file.truncate()
            return file
        await asyncio.sleep(_PAUSE)  # this loop may serve other hubs, with dead-man times to keep
    return None
