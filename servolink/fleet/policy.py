"""Policy: remote control allowed for the boards of this machine, read, like the groups, from `fleet.toml`."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from servolink.boards import parse_toml
from servolink.control import RoleName
from servolink.errors import ServolinkError, quote
from servolink.fleet.groups import fleet_file, read_fleet_file
from servolink.motion import MotionLimits
from servolink.support import is_name

FILE = "fleet.toml"


class _PolicyTable(Struct, forbid_unknown_fields=True):
    """Table of the file; missing settings come from `default`."""

    allow: RoleName | UnsetType = UNSET
    max_speed: Annotated[float, Meta(gt=0)] | UnsetType = UNSET
    angles: dict[str, tuple[float, float]] | UnsetType = UNSET
    forecast: bool | UnsetType = UNSET


class _File(Struct, forbid_unknown_fields=True):
    default: _PolicyTable = msgspec.field(default_factory=_PolicyTable)
    boards: dict[str, _PolicyTable] = {}
    groups: Any = None
    """See `servolink.fleet.groups`."""


class BoardPolicy(Struct, frozen=True):
    """Remote control allowed for a board. Stopping is always allowed."""

    allow: RoleName = "watch"
    max_speed: float | None = None
    """Degrees per second; None for the limits of the board alone."""
    angles: dict[str, tuple[float, float]] = {}
    """Lowest and highest angle in degrees, by servo id or `all`."""
    forecast: bool = False
    """Whether only a hub that tries motions on a twin may be given any."""

    def tightening(self) -> dict[str, Any] | None:
        """Return the params of the method `limits.tighten`, None if there is nothing to limit."""
        if self.max_speed is None and not self.angles:
            return None
        return {"angles": self.angles, "speed_cap": self.max_speed, "source": FILE}


class FleetFile(Struct, frozen=True):
    """A policy file."""

    default: BoardPolicy = BoardPolicy()
    boards: dict[str, BoardPolicy] = {}

    def policy_of(self, board: str) -> BoardPolicy:
        """Return the remote control allowed for a board."""
        return self.boards.get(board, self.default)


class PolicyFile:
    """Policy in a file that people change while the boards take part."""

    def __init__(self, path: Path | None = None) -> None:
        """Read `path`, or `fleet.toml` of this user. Raise ServolinkError for an unusable file."""
        self._path = path
        self._seen = self._status()
        self.policies = load_fleet_file(path)
        """Policy as last read."""

    def read_again(self) -> bool:
        """Return whether the policy has changed. Raise ServolinkError, once, for a change that cannot be used."""
        status, before = self._status(), self.policies
        if status != self._seen:
            self._seen = status
            self.policies = load_fleet_file(self._path)
        return self.policies != before

    def _status(self) -> tuple[int, ...]:
        with suppress(OSError):
            status = (self._path or fleet_file()).stat()
            return status.st_mtime_ns, status.st_size, status.st_ino
        return ()


def load_fleet_file(path: Path | None = None) -> FleetFile:
    """Return the policy in `path`, or in `fleet.toml` of this user, a missing file included.

    Raise ServolinkError, which names the file and the place in it, if it cannot be used.
    """
    text = read_fleet_file(path)
    try:
        return _checked(msgspec.convert(parse_toml(text), _File))
    except (ValueError, RecursionError, OverflowError) as error:  # errors of TOML and of types are ValueErrors
        raise ServolinkError(f"{path or fleet_file()} cannot be used: {error}; correct it") from error


def _checked(file: _File) -> FleetFile:
    """Return the policy in the file. Raise ValueError for an impossible board name or servo id."""
    for name in file.boards:
        if not is_name(name):
            raise ValueError(f"{quote(name)} cannot be a name: names have only letters, digits, - and _")
    default = _merged(BoardPolicy(), file.default, "default")
    boards = {name: _merged(default, table, f"boards.{name}") for name, table in file.boards.items()}
    return FleetFile(default, boards)


def _merged(default: BoardPolicy, table: _PolicyTable, where: str) -> BoardPolicy:
    given = {name: value for name in table.__struct_fields__ if (value := getattr(table, name)) is not UNSET}
    for servo, pair in given.get("angles", {}).items():
        if servo != "all" and not (servo.isascii() and servo.isdecimal()):
            raise ValueError(f'{where}.angles: {quote(servo)} must be a servo id, or "all"')
        MotionLimits(pair if servo == "all" else {int(servo): pair})
    return msgspec.structs.replace(default, **given)
