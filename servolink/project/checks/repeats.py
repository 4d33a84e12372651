"""What is there twice: records with one id, steps of one action for one servo, buttons of one table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple


class Repeat(NamedTuple):
    """A part that has the number of a part before it; the number is the first field and says what the part is for."""

    at: int
    first: int
    same: bool
    """All parts with the number are the same, so that nothing is lost without this one."""


def number_of(part: Any) -> int:
    """Return the first field."""
    return int(getattr(part, part.__struct_fields__[0]))


def repeats(parts: Sequence[Any]) -> Iterator[Repeat]:
    """Yield the repeats among `parts`, in their order."""
    first: dict[int, int] = {}
    for at, part in enumerate(parts):
        first.setdefault(number_of(part), at)
    differing = {number_of(part) for part in parts if parts[first[number_of(part)]] != part}
    for at, part in enumerate(parts):
        if (before := first[number_of(part)]) != at:
            yield Repeat(at, before, number_of(part) not in differing)
