"""Names given to boards by the user, stored in a TOML file, and the present address of each named board."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
from msgspec import Struct
from msgspec.structs import asdict

from servolink.boards import hubs
from servolink.boards.searching import is_same_place, only, search
from servolink.boards.store import ProfileFile
from servolink.boards.toml_text import changed_toml, parse_toml
from servolink.errors import InvalidAddress, OpenError, Reason, ServolinkError, TransportUnavailable, quote
from servolink.support import MIB, is_name, lock, read_file, read_text, reason, user_folder, write_atomically
from servolink.transports import Address, DeviceInfo, PortIdentity


class Alias(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Board with a name: address, and USB identity if known."""

    url: str
    """Address of the board at the time of naming; options in the address still apply."""
    serial_number: str = ""
    """Serial number of a USB serial port, whose address depends on the socket; empty for other boards."""
    vendor_id: int | None = None
    product_id: int | None = None
    interface: int | None = None

    @property
    def identity(self) -> PortIdentity:
        """USB identity, by which a board with a serial number is found again."""
        return PortIdentity(self.vendor_id, self.product_id, self.serial_number, self.interface)

    @classmethod
    def at(cls, url: str, devices: Sequence[DeviceInfo]) -> Alias:
        """Return the alias for the board at `url`, with the USB identity if the address depends on the socket."""
        if identity := PortIdentity.at(url, devices):
            return cls(url, identity.serial_number, identity.vendor_id, identity.product_id, identity.interface)
        return cls(url)

    def is_at(self, url: str) -> bool:
        """Return whether the address of the alias and `url` differ at most in options of the connection."""
        return is_same_place(self.url, url)

    def fits(self, device: DeviceInfo) -> bool:
        """Return whether the alias is a name for `device`, or for the board that the hub `device` shares."""
        if self.serial_number:
            return self.identity.fits(device.identity)
        return any(self.is_at(url) for url in (device.url, device.shares) if url)


class _NamesFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    boards: dict[str, Alias] = {}


class Aliases(dict[str, Alias]):
    """Boards by name, as given by the user."""

    @staticmethod
    def path() -> Path:
        """Return the path of the file of names. Raise TransportUnavailable for a user without a home."""
        try:
            return user_folder("config") / "boards.toml"
        except OSError as error:
            raise TransportUnavailable(f"names for boards cannot be stored: {reason(error)}") from error

    @classmethod
    def load(cls) -> Aliases:
        """Return all names; none for a user without a home. Raise TransportUnavailable for a damaged file."""
        try:
            path = cls.path()
        except TransportUnavailable:
            return cls()
        try:
            return cls(_parse(read_text(path, MIB)))
        except FileNotFoundError:
            return cls()
        except (OSError, ValueError, RecursionError) as error:  # errors of TOML, types and encoding are ValueErrors
            raise TransportUnavailable(f"{path} cannot be used: {reason(error)}; correct or remove the file") from error

    @staticmethod
    def save(name: str, alias: Alias) -> None:
        """Name the board of `alias`; the file is replaced atomically.

        Raise InvalidAddress for an address with undecodable bytes, ServolinkError if the file cannot be written.
        """
        try:
            f"{alias.url}{alias.serial_number}".encode()
        except UnicodeEncodeError as error:
            raise Address.parse(alias.url).refusal("holds bytes outside UTF-8; write each byte as in %FF") from error
        with _changing() as aliases:
            aliases[name] = alias

    @classmethod
    def remove(cls, name: str) -> None:
        """Remove a name; do nothing for an unknown name. Raise ServolinkError if the file cannot be written."""
        if name in cls.load():
            with _changing() as aliases:
                aliases.pop(name, None)

    @classmethod
    def name_at(cls, url: str) -> str | None:
        """Return the name given to the board at `url`, with or without a profile; None for no or several names.

        Blocks, as a serial port may have to be found by its number.
        """
        found = [] if hubs.is_new_board(url) else _names_at(url, cls.load(), None)
        return found[0] if len(found) == 1 else None

    def by_url(self, devices: Sequence[DeviceInfo]) -> dict[str, str]:
        """Return the names of `devices` by address, without unnamed devices."""
        names: dict[str, str] = {}
        for name, alias in self.items():
            try:
                url = current_url(name, alias, devices)
            except OpenError:  # it is not here
                continue
            names[url.partition("?")[0]] = name
        bare = {device.url: device.url.partition("?")[0] for device in devices}
        return {url: names[place] for url, place in bare.items() if place in names}


class Resolved(Struct, frozen=True):
    """Address of a board, with its name if known."""

    url: str
    name: str | None
    """Given name, or name of the profile of the board; None without a name."""


async def resolve_board(board: str | None, *, through_hub: bool = True) -> Resolved:
    """Return address and name of `board`: an address, a name given by `servolink use`, or None for the only board.

    A board shared by a hub has the address of the hub, unless another address is given. With `through_hub` False,
    exclusive use is required, and a board shared by a hub is refused. An address has a name if the name has a profile,
    and stands for the same port or, without a serial number, for the same address.

    Raises:
        OpenError: No board or several boards were found, the named board is absent, or a hub shares the board.
        InvalidAddress: The name is unknown.

    """
    board = board and board.strip()  # as pasted
    if through_hub and board is not None and not is_name(board) and not ProfileFile.names():
        return Resolved(board, None)

    return Resolved(*await asyncio.to_thread(resolve if through_hub else resolve_exclusive, board))


async def resolve_url(board: str | None, *, through_hub: bool = True) -> str:
    """Return the address of `board`, resolved by `resolve_board`."""
    if through_hub and board is not None and not is_name(board.strip()):
        return board
    return (await resolve_board(board, through_hub=through_hub)).url


def current_url(name: str, alias: Alias, devices: Sequence[DeviceInfo]) -> str:
    """Return the present address of the board called `name`; OpenError for an absent or ambiguous board."""
    if not alias.serial_number:
        return alias.url
    found = alias.identity.ports_among(devices)
    meaning = f"{name} is the board with serial number {alias.serial_number}"
    if not found:
        raise OpenError(
            f"{meaning}, and was not found; plug the board in and switch it on; `servolink list` shows all boards",
            reason=Reason.NOT_FOUND,
        )
    if len(found) > 1:
        named = ", ".join(device.url for device in found)
        raise OpenError(f"{meaning}, used by several boards: {named}; use one of these addresses")
    return found[0].with_options_of(alias.url)


def resolve_exclusive(board: str | None) -> tuple[str, str | None]:
    """Resolve `board` without its hub. Raise OpenError if a hub shares the board."""
    url, name = resolve(board)
    if (hub := _at(url) or hubs.hub_of(url)) is not None:
        text = f"{hub.shares} is {hub.product}: use {hub.url}, or end that hub for exclusive use of the board"
        raise OpenError(text, reason=Reason.IN_USE)
    return url, name


def resolve(board: str | None) -> tuple[str, str | None]:
    """Return address and name of `board`, as `resolve_board` does, and block meanwhile."""
    if board is None:
        devices = search()
        return _recognised(only(devices), devices)
    if not is_name(board):
        return _recognised(board, None)
    aliases = Aliases.load()
    alias = aliases.get(board)
    if (hub := _hub_for(board, alias)) is not None:
        return hub.url, board
    if alias is None:
        place = f"in {Aliases.path()} (known: {', '.join(sorted(aliases))})" if aliases else "(none is known)"
        raise InvalidAddress(
            f"{board} is neither an address nor a name {place}; give the name with: servolink use {board} BOARD"
        )
    return current_url(board, alias, search() if alias.serial_number else ()), board


def _at(url: str) -> DeviceInfo | None:
    """Return the hub at the address `url`; None without a hub."""
    return next((hub for hub in hubs.candidates() if hub.url == url), None)


def _hub_for(name: str, alias: Alias | None) -> DeviceInfo | None:
    """Return the hub sharing the board `name` or, if no board has the name, the hub of this name."""
    if alias is None:
        return _at(f"share://{name}")
    for hub in hubs.candidates():
        fits = alias.identity.fits(hub.identity) if alias.serial_number else alias.is_at(hub.shares)
        if fits and (not hubs.is_new_board(alias.url) or hub.url == f"share://{name}"):
            return hub
    return None


def _recognised(url: str, devices: Sequence[DeviceInfo] | None) -> tuple[str, str | None]:
    """Return `url` with the name of the profile for the board at this address."""
    with_profile = set(ProfileFile.names())
    aliases = {name: alias for name, alias in Aliases.load().items() if name in with_profile} if with_profile else {}
    found = _names_at(url, aliases, devices)
    if len(found) > 1:
        raise OpenError(
            f"{url} has the names {' and '.join(sorted(found))}, each with a profile; use a name instead of the address"
        )
    return url, found[0] if found else None


def _names_at(url: str, aliases: Mapping[str, Alias], devices: Sequence[DeviceInfo] | None) -> list[str]:
    """Return the names in `aliases` of the board at `url`; `devices` are those present, None to search."""
    found = [name for name, alias in aliases.items() if not alias.serial_number and alias.is_at(url)]
    by_number = {name: alias for name, alias in aliases.items() if alias.serial_number}
    if by_number and Address.parse(url).serial_device:
        present = PortIdentity.at(url, search() if devices is None else devices)
        found += [name for name, alias in by_number.items() if present and alias.identity.fits(present)]
    return found


def _private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


@contextmanager
def _changing() -> Iterator[Aliases]:
    """Yield the names to be changed, and write the result at the end; other programs wait to change names."""
    path = Aliases.path()
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with open(path.with_suffix(".lock"), "ab", buffering=0, opener=_private) as file:
            lock(file, wait=True)
            aliases = Aliases.load()
            yield aliases
            text = read_file(path, MIB).decode() if path.exists() else ""
            write_atomically(path, _changed(text, aliases).encode(), private=True)
    except (OSError, ValueError) as error:
        if isinstance(error, ServolinkError):  # an unreadable file, with a better text
            raise
        raise ServolinkError(
            f"{path} cannot be written: {reason(error)}; names need a writable folder for settings"
        ) from error


def _parse(text: str) -> dict[str, Alias]:
    aliases = msgspec.convert(parse_toml(text), _NamesFile).boards
    for name in aliases:
        if not is_name(name):
            raise ValueError(f"{quote(name)} cannot be a name: names have only letters, digits, - and _")
    return aliases


_HEAD = "# Names for boards, as given by `servolink use NAME BOARD`, which changes this file.\n"
_MARK = "\ufeff"  # put by some editors before a text


def _changed(text: str, aliases: Mapping[str, Alias]) -> str:
    """Return the text of the file with these names; comments stay. Raise ValueError if its form cannot be changed."""
    tables = {name: _table(alias) for name, alias in sorted(aliases.items())}
    changed = changed_toml(text.removeprefix(_MARK) or _HEAD, {"boards": tables} if tables else {})
    if _parse(changed) != aliases:
        raise ValueError("its form cannot be changed; change the file by hand")
    return _MARK + changed if text.startswith(_MARK) else changed


def _table(alias: Alias) -> dict[str, Any]:
    return {"url": alias.url} | {name: value for name, value in asdict(alias).items() if value not in {"", None}}
