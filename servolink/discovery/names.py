"""The user's own names for boards, in a file of TOML."""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from servolink.discovery.search import only, scheme, search
from servolink.errors import OpenError, TransportUnavailable
from servolink.escaping import escape
from servolink.files import MIB, read_file, reason, user_folder, write_atomically
from servolink.transports.address import Address, refusal
from servolink.transports.device_info import DeviceInfo

_NAME = re.compile(r"(?!com\d+$)[a-z0-9][a-z0-9_-]{0,63}", re.IGNORECASE | re.ASCII)
_PERHAPS_ESCAPED = re.compile(r"[^ !#-\[\]-~]")


class Alias(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a name stands for."""

    url: str
    """The board's address when it got its name; the options in it still count."""
    serial_number: str = ""
    """That of the board on a serial port, whose address changes with the port; otherwise empty."""


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    boards: dict[str, Alias] = {}


def is_name(text: str) -> bool:
    """Tell whether `text` can be a board's name: letters, digits, - and _; nothing like an address."""
    return _NAME.fullmatch(text) is not None


def aliases_path() -> Path:
    """Return where the names are kept; TransportUnavailable for a user without a home."""
    try:
        return user_folder("config") / "boards.toml"
    except OSError as error:
        raise TransportUnavailable(f"names for boards cannot be kept: {error.strerror}") from error


def load_aliases() -> dict[str, Alias]:
    """Return the names, none for a user without a home; TransportUnavailable says what is wrong with the file."""
    try:
        path = aliases_path()
    except TransportUnavailable:
        return {}
    try:
        return _parsed(read_file(path, MIB).decode("utf-8-sig"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, RecursionError) as error:  # what TOML and types have against it is a ValueError
        raise TransportUnavailable(f"{path} cannot be used: {reason(error)}; correct it or remove it") from error


def save_alias(name: str, alias: Alias) -> None:
    """Let `name` stand for `alias` from now on; the file is replaced as a whole or not at all.

    TransportUnavailable for an address that is no text.
    """
    try:
        f"{alias.url}{alias.serial_number}".encode()
    except UnicodeEncodeError as error:
        raise refusal(alias.url, "holds bytes that are no text; write each as in %FF") from error
    _write(load_aliases() | {name: alias})


def remove_alias(name: str) -> None:
    """Forget what `name` stands for. Do nothing if the name is unknown."""
    aliases = load_aliases()
    if aliases.pop(name, None) is not None:
        _write(aliases)


def _write(aliases: Mapping[str, Alias]) -> None:
    path = aliases_path()
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, _toml(aliases).encode(), private=True)


def _parsed(text: str) -> dict[str, Alias]:
    import tomllib  # only where there are names

    aliases = msgspec.convert(tomllib.loads(text), _File).boards
    for name in aliases:
        if not is_name(name):
            raise ValueError(f"{name!r} is no name, which has letters, digits, - and _ only")
    return aliases


def _toml(aliases: Mapping[str, Alias]) -> str:
    tables = ["# Names for boards, as given by `servolink use NAME URL`, which writes this file anew.\n"]
    for name, alias in sorted(aliases.items()):
        tables.append(f"\n[boards.{name}]\nurl = {_string(alias.url)}\n")
        if alias.serial_number:
            tables.append(f"serial_number = {_string(alias.serial_number)}\n")
    return "".join(tables)


def _string(text: str) -> str:
    return '"' + _PERHAPS_ESCAPED.sub(_escaped, text) + '"'


def _escaped(found: re.Match[str]) -> str:
    character = found[0]
    is_shown = character not in '"\\' and escape(character) == character
    return character if is_shown else f"\\U{ord(character):08x}"


async def resolved(board: str | None) -> str:
    """Return the address of `board`: an address, a name given by `servolink use`, or None for the only one here.

    OpenError if none or several are here, or not the one of that name; TransportUnavailable for an unknown name.
    """
    if board is not None and not is_name(board):
        return board
    return await asyncio.to_thread(_resolve, board)


def alias_for(url: str, candidates: Sequence[DeviceInfo]) -> Alias:
    """Return what finds the board at `url` again, by its serial number if its address depends on the port."""
    address = Address.parse(url)
    if address.scheme == "serial":
        device = _device(url)
        for candidate in candidates:
            if scheme(candidate) == "serial" and _device(candidate.url) == device:
                return Alias(url, candidate.serial_number)
    return Alias(url)


def current_url(name: str, alias: Alias, candidates: Sequence[DeviceInfo]) -> str:
    """Return where the board called `name` is now; OpenError if it is nowhere, or cannot be told from another."""
    if not alias.serial_number:
        return alias.url
    found = [
        candidate
        for candidate in candidates
        if scheme(candidate) == "serial" and candidate.serial_number == alias.serial_number
    ]
    wanted = f"{name} is the board with serial number {escape(alias.serial_number)}"
    if not found:
        raise OpenError(f"{wanted}, which is not here; plug it in and switch it on; `servolink list` shows what is")
    if len(found) > 1:
        named = ", ".join(escape(candidate.url) for candidate in found)
        raise OpenError(f"{wanted}, and several have it: {named}; use one of these addresses")
    place, options = found[0].url.partition("?")[0], alias.url.partition("?")[2]
    return f"{place}?{options}" if options else found[0].url


def _resolve(name: str | None) -> str:
    if name is None:
        return only(search())
    aliases = load_aliases()
    if (alias := aliases.get(name)) is None:
        known = "(none is known)"
        if aliases:
            known = f"in {escape(str(aliases_path()))} (known: {', '.join(sorted(aliases))})"
        raise TransportUnavailable(
            f"{name} is neither an address nor a name {known}; give it: servolink use {name} URL"
        )
    return current_url(name, alias, search() if alias.serial_number else ())


def _device(url: str) -> str:
    """Return the device that `url` leads to, whichever of its names is written there."""
    address = Address.parse(url)
    device = address.host + address.path
    return os.path.realpath(device) if "/" in device else device.upper()
