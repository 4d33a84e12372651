"""From what a user says to an address: an address itself, a name, or nothing at all."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence

from servolink.discovery.aliases import Alias, aliases_path, is_name, load_aliases
from servolink.discovery.choice import only, scheme
from servolink.discovery.search import search
from servolink.errors import OpenError, TransportUnavailable
from servolink.printable import printable
from servolink.transports.address import Address
from servolink.transports.candidate import Candidate


async def resolved(board: str | None) -> str:
    """Return the address of `board`: an address, a name given by `servolink use`, or None for the only one here.

    OpenError if none or several are here, or not the one of that name; TransportUnavailable for an unknown name.
    """
    if board is not None and not is_name(board):
        return board
    return await asyncio.to_thread(_resolve, board)


def alias_for(url: str, candidates: Sequence[Candidate]) -> Alias:
    """Return what finds the board at `url` again, by its serial number if its address depends on the port."""
    address = Address.parse(url)
    if address.scheme == "serial":
        device = _device(url)
        for candidate in candidates:
            if scheme(candidate) == "serial" and _device(candidate.url) == device:
                return Alias(url, candidate.serial_number)
    return Alias(url)


def current_url(name: str, alias: Alias, candidates: Sequence[Candidate]) -> str:
    """Return where the board called `name` is now; OpenError if it is nowhere, or cannot be told from another."""
    if not alias.serial_number:
        return alias.url
    found = [
        candidate
        for candidate in candidates
        if scheme(candidate) == "serial" and candidate.serial_number == alias.serial_number
    ]
    wanted = f"{name} is the board with serial number {printable(alias.serial_number)}"
    if not found:
        raise OpenError(f"{wanted}, which is not here; plug it in and switch it on; `servolink list` shows what is")
    if len(found) > 1:
        named = ", ".join(printable(candidate.url) for candidate in found)
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
            known = f"in {printable(str(aliases_path()))} (known: {', '.join(sorted(aliases))})"
        raise TransportUnavailable(
            f"{name} is neither an address nor a name {known}; give it: servolink use {name} URL"
        )
    return current_url(name, alias, search() if alias.serial_number else ())


def _device(url: str) -> str:
    """Return the device that `url` leads to, whichever of its names is written there."""
    address = Address.parse(url)
    device = address.host + address.path
    return os.path.realpath(device) if "/" in device else device.upper()
