"""Names given to boards by the user, stored in a TOML file, and the present address of each named board."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import asdict

from servolink.discovery.search import is_same_place, only, search
from servolink.errors import InvalidAddress, OpenError, Reason, ServolinkError, TransportUnavailable
from servolink.escaping import quote
from servolink.files import MIB, is_name, read_file, reason, write_atomically
from servolink.platforms.locks import lock
from servolink.platforms.user_folders import user_folder
from servolink.profiles.listing import profile_names
from servolink.profiles.toml_text import changed_toml, parse_toml
from servolink.transports.address import Address, refusal
from servolink.transports.device_info import DeviceInfo, PortIdentity
from servolink.transports.serial_ports import identity_at, move, ports_of


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


class _NamesFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    boards: dict[str, Alias] = {}


def aliases_path() -> Path:
    """Return the path of the file of names. Raise TransportUnavailable for a user without a home."""
    try:
        return user_folder("config") / "boards.toml"
    except OSError as error:
        raise TransportUnavailable(f"names for boards cannot be stored: {reason(error)}") from error


def load_aliases() -> dict[str, Alias]:
    """Return the boards by name; empty for a user without a home. Raise TransportUnavailable for a damaged file."""
    try:
        path = aliases_path()
    except TransportUnavailable:
        return {}
    try:
        return _parse(read_file(path, MIB).decode("utf-8-sig"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:  # errors of TOML, of types and of encoding are ValueErrors
        raise TransportUnavailable(f"{path} cannot be used: {reason(error)}; correct or remove the file") from error


def save_alias(name: str, alias: Alias) -> None:
    """Name the board of `alias`; the file is replaced atomically.

    Raise InvalidAddress for an address with undecodable bytes, ServolinkError if the file cannot be written.
    """
    try:
        f"{alias.url}{alias.serial_number}".encode()
    except UnicodeEncodeError as error:
        raise refusal(alias.url, "holds bytes outside UTF-8; write each byte as in %FF") from error
    with _changing() as aliases:
        aliases[name] = alias


def remove_alias(name: str) -> None:
    """Remove a name; do nothing for an unknown name. Raise ServolinkError if the file cannot be written."""
    if name in load_aliases():
        with _changing() as aliases:
            aliases.pop(name, None)


def alias_for(url: str, devices: Sequence[DeviceInfo]) -> Alias:
    """Return the alias for the board at `url`, with the USB identity if the address depends on the socket."""
    if identity := identity_at(url, devices):
        return Alias(url, identity.serial_number, identity.vendor_id, identity.product_id, identity.interface)
    return Alias(url)


def current_url(name: str, alias: Alias, devices: Sequence[DeviceInfo]) -> str:
    """Return the present address of the board called `name`; OpenError for an absent or ambiguous board."""
    if not alias.serial_number:
        return alias.url
    found = ports_of(alias.identity, devices)
    meaning = f"{name} is the board with serial number {alias.serial_number}"
    if not found:
        raise OpenError(
            f"{meaning}, and was not found; plug the board in and switch it on; `servolink list` shows all boards",
            reason=Reason.NOT_FOUND,
        )
    if len(found) > 1:
        named = ", ".join(device.url for device in found)
        raise OpenError(f"{meaning}, used by several boards: {named}; use one of these addresses")
    return move(alias.url, found[0])


def names_by_url(aliases: Mapping[str, Alias], devices: Sequence[DeviceInfo]) -> dict[str, str]:
    """Return the names of `devices` by address, without unnamed devices."""
    names: dict[str, str] = {}
    for name, alias in aliases.items():
        try:
            url = current_url(name, alias, devices)
        except OpenError:  # it is not here
            continue
        names[url.partition("?")[0]] = name
    bare = {device.url: device.url.partition("?")[0] for device in devices}
    return {url: names[place] for url, place in bare.items() if place in names}


def resolve_exclusive(board: str | None) -> tuple[str, str | None]:
    """Resolve `board` without its hub. Raise OpenError if a hub shares the board."""
    from servolink.discovery import hubs  # imported late, as below: most programs give an address

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
    aliases = load_aliases()
    alias = aliases.get(board)
    if (hub := _hub_for(board, alias)) is not None:
        return hub.url, board
    if alias is None:
        place = f"in {aliases_path()} (known: {', '.join(sorted(aliases))})" if aliases else "(none is known)"
        raise InvalidAddress(
            f"{board} is neither an address nor a name {place}; give the name with: servolink use {board} BOARD"
        )
    return current_url(board, alias, search() if alias.serial_number else ()), board


def _at(url: str) -> DeviceInfo | None:
    """Return the hub at the address `url`; None without a hub."""
    from servolink.discovery import hubs

    return next((hub for hub in hubs.candidates() if hub.url == url), None)


def _hub_for(name: str, alias: Alias | None) -> DeviceInfo | None:
    """Return the hub sharing the board `name` or, if no board has the name, the hub of this name."""
    from servolink.discovery import hubs

    if alias is None:
        return _at(f"share://{name}")
    for hub in hubs.candidates():
        fits = alias.identity.fits(hub.identity) if alias.serial_number else is_same_place(hub.shares, alias.url)
        if fits and (not hubs.is_new_board(alias.url) or hub.url == f"share://{name}"):
            return hub
    return None


def name_at(url: str) -> str | None:
    """Return the name given to the board at `url`, with or without a profile; None for any other number of names.

    Blocks, as a serial port may have to be found by its number.
    """
    from servolink.discovery.hubs import is_new_board

    found = [] if is_new_board(url) else _names_at(url, load_aliases(), None)
    return found[0] if len(found) == 1 else None


def _recognised(url: str, devices: Sequence[DeviceInfo] | None) -> tuple[str, str | None]:
    """Return `url` with the name of the profile for the board at this address."""
    with_profile = set(profile_names())
    aliases = {name: alias for name, alias in load_aliases().items() if name in with_profile} if with_profile else {}
    found = _names_at(url, aliases, devices)
    if len(found) > 1:
        raise OpenError(
            f"{url} has the names {' and '.join(sorted(found))}, each with a profile; use a name instead of the address"
        )
    return url, found[0] if found else None


def _names_at(url: str, aliases: Mapping[str, Alias], devices: Sequence[DeviceInfo] | None) -> list[str]:
    """Return the names in `aliases` of the board at `url`; `devices` are those present, None to search."""
    found = [name for name, alias in aliases.items() if not alias.serial_number and is_same_place(alias.url, url)]
    by_number = {name: alias for name, alias in aliases.items() if alias.serial_number}
    if by_number and Address.parse(url).serial_device:
        present = identity_at(url, search() if devices is None else devices)
        found += [name for name, alias in by_number.items() if present and alias.identity.fits(present)]
    return found


@contextmanager
def _changing() -> Iterator[dict[str, Alias]]:
    """Yield the names to be changed, and write the result at the end; other programs wait to change names."""
    path = aliases_path()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.with_suffix(".lock").open("ab", buffering=0) as file:
            lock(file, wait=True)
            aliases = load_aliases()
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
