"""How far an export or an import is."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

from msgspec import Struct

Phase: TypeAlias = Literal["reading", "saving", "marking", "clearing", "writing", "verifying", "finishing"]
"""`reading` and `saving` change nothing on the board; from `marking` on it says that an import is under way."""


class Progress(Struct, frozen=True):
    """What has just been done."""

    phase: Phase
    done: int
    total: int
    """Items of this phase; what an import writes can turn out to be more."""
    item: str
    """Such as "action 3"."""


Tell: TypeAlias = Callable[[Progress], None]


def tell_nobody(progress: Progress) -> None:
    """Keep it to oneself."""
