"""Files of profiles: documented TOML, one file for each board."""

from __future__ import annotations

import re
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec
from msgspec import Struct

from servolink.boards.profile import BoardProfile, BoardSettings, about, fields_of
from servolink.boards.toml_text import TextError, changed_toml, read_toml
from servolink.errors import ProfileError, escape, quote
from servolink.support import is_name, read_file, read_text, reason, user_folder, write_atomically

S = TypeVar("S", bound=Struct)

_ENDING = ".toml"
_MOST_BYTES = 0x10000
_MARK = "\ufeff"  # put by some editors before a text


class ProfileFile:
    """File with the profile of a board, which need not exist."""

    def __init__(self, name: str) -> None:
        """Name the board. Raise ProfileError for anything but a name."""
        if not is_name(name):
            raise ProfileError(f"{quote(name)} cannot be a board's name: names have only letters, digits, - and _")
        self.name = name

    @staticmethod
    def names() -> list[str]:
        """Return the names of all boards with a profile; empty for a user without a home."""
        with suppress(OSError):
            files = _folder().iterdir()
            return sorted(file.stem for file in files if file.suffix == _ENDING and is_name(file.stem))
        return []

    @property
    def path(self) -> Path:
        """Path of the file. Raise ProfileError for a user without a home."""
        try:
            return _folder() / f"{self.name}{_ENDING}"
        except OSError as error:
            raise ProfileError(f"profiles of boards cannot be stored: {reason(error)}") from error

    def load(self) -> BoardProfile | None:
        """Return the profile, None without a file. Raise ProfileError, with file and line, for an unusable profile."""
        try:
            path = self.path
        except ProfileError:
            return None  # a user without a home
        try:
            text = read_text(path, _MOST_BYTES)
        except FileNotFoundError as error:
            if path.is_symlink():
                raise ProfileError(
                    f"{path} cannot be used: the link leads to no file; correct or remove the link"
                ) from error
            return None
        except UnicodeDecodeError as error:
            line = error.object[: error.start].count(b"\n") + 1
            raise ProfileError(f"{path}, line {line}: is not text in UTF-8; save the file as UTF-8") from error
        except OSError as error:
            raise ProfileError(f"{path} cannot be used: {reason(error)}; correct or remove the file") from error
        try:
            return parse_profile(text)
        except TextError as error:
            raise ProfileError(f"{path}, line {error.line}: {error.text}") from None

    def save(self, profile: BoardProfile) -> Path:
        """Write the profile atomically; return the path of the file.

        Raise ProfileError if the file cannot be written, ValueError for a profile that could not be read again.
        """
        path = self.path
        text = _changed(path, self.name, profile)
        try:
            write_atomically(path, text.encode(), private=True)
            path.chmod(0o600)  # an editor may have made the file readable for others
        except OSError as error:
            raise ProfileError(f"{path} cannot be written: {reason(error)}") from error
        return path

    def remove(self) -> bool:
        """Remove the file, damaged or not. Return whether there was a file."""
        path = self.path
        try:
            path.unlink()
        except FileNotFoundError:
            return False
        except OSError as error:
            raise ProfileError(f"{path} cannot be removed: {reason(error)}") from error
        return True


def _folder() -> Path:
    return user_folder("config") / "profiles"


# --- reading --------------------------------------------------------------------------------------------------------


def parse_profile(text: str) -> BoardProfile:
    """Return the profile in the text of a file. Raise TextError, a ValueError with the line."""
    try:
        return _struct(BoardProfile, read_toml(text), ())
    except _Fault as fault:
        raise TextError.at(fault.path, text, fault.text) from None


_BOOLEANS = {"true": True, "false": False}
"""Settings of two values, written in a shell as in TOML."""


def setting_from_text(name: str, text: str) -> Any:
    """Return the value in `text`, lists with commas, for the setting `name`. Raise ValueError for a wrong value."""
    value: object = text
    if name == "unsupported":
        value = [each for each in text.split(",") if each]
    elif text in _BOOLEANS:
        value = _BOOLEANS[text]
    else:
        with suppress(ValueError):
            value = float(text)
            value = int(text)
    hint, described = fields_of(BoardSettings)[name]
    try:
        return _leaf(hint, value, (name,))
    except _Fault as fault:
        problem = fault.text.removeprefix(f"{name} ").removeprefix(f"{name}: ")
        raise ValueError(problem.replace(described.expected, described.in_shell(described.expected), 1)) from None


class _Fault(Exception):
    """Error with the reason why the value at `path` is wrong."""

    def __init__(self, path: tuple[str, ...], text: str) -> None:
        self.path = path
        self.text = text


def _struct(kind: type[S], value: object, path: tuple[str, ...]) -> S:
    """Return the part of the profile in a table."""
    fields, table = fields_of(kind), _table(value, path)
    for key in table:
        if key not in fields:
            where = f"[{'.'.join(path)}]" if path else "the file"
            raise _Fault((*path, key), f"{quote(key)} is unknown; {where} can have {', '.join(fields)}")
    for name, required in zip(kind.__struct_fields__, _required(kind), strict=True):
        if required and name not in table:
            raise _Fault(path, f"{name} is missing in [{'.'.join(path)}]")
    return kind(**{key: _value(fields[key][0], each, (*path, key)) for key, each in table.items()})


def _required(kind: type[Struct]) -> list[bool]:
    return [field.required for field in msgspec.structs.fields(kind)]


def _value(hint: Any, value: object, path: tuple[str, ...]) -> Any:
    kind = hint.__origin__ if hasattr(hint, "__metadata__") else hint
    parts = [part for part in (kind, *get_args(kind)) if isinstance(part, type) and issubclass(part, Struct)]
    if getattr(kind, "__origin__", None) is dict:
        key_kind, value_kind = get_args(kind)
        return {
            _key(key_kind, key, (*path, key)): _value(value_kind, each, (*path, key))
            for key, each in _table(value, path).items()
        }
    if parts:
        return _struct(parts[0], value, path)
    return _leaf(hint, value, path)


def _key(hint: Any, key: str, path: tuple[str, ...]) -> Any:
    return _leaf(hint, int(key) if re.fullmatch("0|[1-9][0-9]{0,2}", key) else key, path)


def _leaf(hint: Any, value: object, path: tuple[str, ...]) -> Any:
    try:
        found = msgspec.convert(value, hint)
    except msgspec.ValidationError:
        raise _Fault(path, f"{_label(path)} must be {about(hint).expected}, not {_quoted(value)}") from None
    try:
        about(hint).check(found)
    except ValueError as error:
        raise _Fault(path, f"{_label(path)}: {error}") from None
    return found


def _table(value: object, path: tuple[str, ...]) -> dict[str, object]:
    if not isinstance(value, dict):
        raise _Fault(path, f"{_label(path)} must be a table, not {_quoted(value)}")
    return value


def _label(path: tuple[str, ...]) -> str:
    """Return the last part of a path; inside a table of a setting, with the name of the setting."""
    in_setting = len(path) > 2 or path[:1] == ("evidence",)
    return escape(".".join(path[-2:] if in_setting else path[-1:]))


def _quoted(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else quote(value)


# --- writing --------------------------------------------------------------------------------------------------------


def format_profile(name: str, profile: BoardProfile, text: str = "") -> str:
    """Return the text of a new file, or `text` with the settings of `profile` and otherwise unchanged.

    A new file has a comment for each setting; unknown settings are commented out.
    """
    values = msgspec.to_builtins(profile, builtin_types=(datetime,), str_keys=True)
    tables = {part: value for part, value in values.items() if value is not None}
    existing = read_toml(text)
    new = [
        _paragraph(part, getattr(profile, part))
        for part in fields_of(BoardProfile)
        if not text
        or (part not in existing and any(value not in (None, {}) for value in tables.get(part, {}).values()))
    ]
    return changed_toml("\n".join([text or _HEAD.format(name=name), *new]), tables)


_HEAD = (
    "# What servolink knows of the board {name}: see it with `servolink board show {name}`.\n"
    "# `servolink doctor {name} --learn` and `servolink board set {name}` change values in this file; comments\n"
    "# and what you write by hand stay. A line without a value is unknown.\n"
)


def _changed(path: Path, name: str, profile: BoardProfile) -> str:
    """Return new text for the file at `path`, based on the present text if readable."""
    try:
        text = read_file(path, _MOST_BYTES).decode()
        parse_profile(text.removeprefix(_MARK))
    except (OSError, ValueError):
        text = ""
    changed = format_profile(name, profile, text.removeprefix(_MARK))
    if parse_profile(changed) != profile:
        raise ProfileError(f"{path} has a form that cannot be changed by a command; edit or remove the file")
    return _MARK + changed if text.startswith(_MARK) else changed


def _paragraph(part: str, value: Any) -> str:
    """Return the header of a part, with a comment for each setting in front of the place for its value."""
    head = f"# {fields_of(BoardProfile)[part][1].meaning}\n"
    if value is None:
        return head
    if isinstance(value, dict):
        return head + "\n".join(f"[{part}.{setting}]\n" for setting in value)
    kind: type[Struct] = type(value)
    fields = [(name, each.meaning) for name, (_, each) in fields_of(kind).items()]
    by_servo = {name for name, _ in fields if isinstance(getattr(value, name), dict)}
    lines = [f"# {meaning}\n# {name} =\n" for name, meaning in fields if name not in by_servo]
    tables = [f"\n# {meaning}\n[{part}.{name}]\n" for name, meaning in fields if name in by_servo]
    return "".join([head, f"[{part}]\n", *lines, *tables])
