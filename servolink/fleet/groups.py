"""Groups of boards in the user's `fleet.toml`, and expansion of texts such as `front,rex`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from servolink.boards import TextError, read_toml
from servolink.errors import NotFound, ServolinkError, quote
from servolink.support import ALL, MIB, read_text, reason, user_folder

_MOST_BYTES = MIB

Groups = Mapping[str, tuple[str, ...]]
"""Names of boards by the name of their group."""


def fleet_file() -> Path:
    """Return where the user's groups and policies are kept. Raise ServolinkError for a user without a home."""
    try:
        return user_folder("config") / "fleet.toml"
    except OSError as error:
        raise ServolinkError(f"cannot find a folder for fleet.toml: {reason(error)}") from error


def read_fleet_file(path: Path | None = None) -> str:
    """Return the text of `path`, by default of the user's `fleet.toml`, which may be missing: then the text is empty.

    Raise ServolinkError, which names the file, if it cannot be read.
    """
    file = fleet_file() if path is None else path
    try:
        return read_text(file, _MOST_BYTES)
    except FileNotFoundError as error:
        if path is None:
            return ""
        raise ServolinkError(f"{file} does not exist; create it, or choose another file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise ServolinkError(f"{file} cannot be read: {reason(error)}; correct or remove the file") from error


def load_groups(path: Path | None = None) -> Groups:
    """Return the groups in `path`, by default the user's `fleet.toml`; empty if the file does not exist.

    Raise ServolinkError, which names file and line, if the file cannot be used.
    """
    text = read_fleet_file(path)
    try:
        return _groups(text, read_toml(text))
    except TextError as error:
        raise ServolinkError(f"{path or fleet_file()}, line {error.line}: {error.text}") from None


def _groups(text: str, values: Mapping[str, Any]) -> Groups:
    tables = values.get("groups", {})
    if not isinstance(tables, dict):
        raise TextError("groups must be a table: write [groups], and a line for each group below it", 1)
    for name, boards in tables.items():
        place = ["groups", name]
        if name == ALL:
            raise TextError.at(place, text, f"{ALL!r} means every board and cannot be the name of a group")
        if not (isinstance(boards, list) and all(isinstance(board, str) for board in boards)):
            why = f'the group {quote(name)} must be a list of names, such as ["rex", "fido"]'
            raise TextError.at(place, text, why)
    return {name: tuple(dict.fromkeys(boards)) for name, boards in tables.items()}


def chosen_boards(
    words: str | Iterable[str], there: Sequence[str], groups: Groups, away: Iterable[str] = ()
) -> tuple[str, ...]:
    """Return the names of the boards for `words`, without duplicates: names, groups and `all`, separated by commas.

    `there` are the boards that `all` means. Those that are `away` or in a group may be named as well. Raise NotFound
    for `all` if no board is there, and for words that are neither a board nor a group.
    """
    parts = [part.strip() for word in ([words] if isinstance(words, str) else words) for part in word.split(",")]
    known = {*there, *away, *(board for boards in groups.values() for board in boards)}
    found: dict[str, None] = {}
    for part in filter(None, parts):
        if part == ALL:
            found |= dict.fromkeys(there)
        elif part in groups:
            found |= dict.fromkeys(groups[part])
        elif part in known:
            found[part] = None
        else:
            raise NotFound(f"{quote(part)} is neither a board nor a group; {_known(there, groups)}")
    if not found:
        raise NotFound(f"no board was chosen; {_known(there, groups)}")
    return tuple(found)


def named_boards(words: str | Iterable[str], groups: Groups) -> tuple[str, ...] | None:
    """Return the boards of `words`, names without a group as they are; None for `all`, even beside others."""
    parts = [part.strip() for word in ([words] if isinstance(words, str) else words) for part in word.split(",")]
    if ALL in parts:
        return None
    return tuple(dict.fromkeys(board for part in filter(None, parts) for board in groups.get(part, (part,))))


def _known(there: Sequence[str], groups: Groups) -> str:
    boards = ", ".join(there) or "none"
    return f"boards: {boards}" + (f"; groups: {', '.join(groups)}" if groups else "")
