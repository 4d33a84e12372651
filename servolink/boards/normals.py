"""Normals of servos: currents and lags that a guard has learnt of a board, in a file among the data of the user."""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from datetime import datetime, timedelta
from pathlib import Path
from typing import ClassVar

import msgspec
from msgspec import Struct

from servolink.boards.profile import BoardIdentityRecord
from servolink.errors import ProfileError
from servolink.support import is_name, read_file, reason, user_folder, write_atomically

_MOST_BYTES = 0x100000
_MOST_KEPT = 100  # readings: those of the next motions soon outnumber them


class ServoNormal(Struct, frozen=True, forbid_unknown_fields=True):
    """Readings of a servo while nothing was suspect."""

    moving: tuple[int, ...]
    """Raw currents while it moved."""
    resting: tuple[int, ...]
    """Raw currents at rest."""
    lags: tuple[int, ...]
    """Degrees between the servo and its target, at rest."""
    seconds: float
    """Seconds of learning."""
    learnt_at: datetime
    """Time of the latest reading, with its zone."""

    @classmethod
    def of(cls, *readings: Iterable[int], seconds: float, learnt_at: datetime) -> ServoNormal:
        """Return the normal of `readings` (moving, resting, lags), of which at most 100 of each kind are kept."""
        moving, resting, lags = (
            values[:: max(1, math.ceil(len(values) / _MOST_KEPT))] for values in map(tuple, readings)
        )
        return cls(moving, resting, lags, seconds, learnt_at)

    @staticmethod
    def most(values: Iterable[int]) -> int | None:
        """Return the value that nine of ten readings do not exceed; None without readings."""
        ordered = sorted(values)
        return ordered[min(len(ordered) - 1, int(0.9 * len(ordered)))] if ordered else None


class BoardNormals(Struct, frozen=True, forbid_unknown_fields=True):
    """Normals of the servos of a board, by servo id."""

    identity: BoardIdentityRecord
    """Board of which they were learnt."""
    servos: dict[int, ServoNormal]

    OLDEST: ClassVar = timedelta(days=30)
    """Age beyond which a normal is distrusted: gears wear, and springs and batteries are changed."""

    def trusted(self, found: BoardIdentityRecord, now: datetime) -> dict[int, ServoNormal]:
        """Return the normals that count for the board `found`: none of another board, and none that is too old."""
        if not self.identity.fits(found):
            return {}
        return {each: normal for each, normal in self.servos.items() if abs(now - normal.learnt_at) <= self.OLDEST}

    @classmethod
    def load(cls, name: str) -> BoardNormals | None:
        """Return the normals kept for the board `name`; None for a missing, damaged or unreadable file."""
        with suppress(OSError, ProfileError, msgspec.MsgspecError, UnicodeDecodeError):
            found = msgspec.json.decode(read_file(_path(name), _MOST_BYTES), type=cls)
            if all(each.learnt_at.tzinfo for each in found.servos.values()):
                return found
        return None

    def save(self, name: str) -> None:
        """Keep the normals for the board `name`. Raise ProfileError if that fails."""
        try:
            write_atomically(_path(name), msgspec.json.encode(self), private=True)
        except OSError as error:
            raise ProfileError(f"what is normal for {name} cannot be kept: {reason(error)}") from error

    @staticmethod
    def forget(name: str) -> None:
        """Remove the normals kept for the board `name`, if any. Raise ProfileError if that fails."""
        try:
            _path(name).unlink(missing_ok=True)
        except OSError as error:
            raise ProfileError(f"what is normal for {name} cannot be removed: {reason(error)}") from error


def _path(name: str) -> Path:
    if not is_name(name):
        raise ProfileError(f"nothing can be kept for a board named {name!r}")
    return user_folder("data") / "guard" / f"{name}.json"
