"""All kinds of odd boards, by name."""

from __future__ import annotations

from tests.lab.odd import bridges, contents, dialects, firmwares, lines
from tests.lab.odd.board import OddBoard

KINDS: dict[str, type[OddBoard]] = {
    kind.name: kind
    for module in (lines, contents, bridges, firmwares, dialects)
    for kind in (OddBoard, *vars(module).values())
    if isinstance(kind, type) and issubclass(kind, OddBoard)
}
"""Kinds in the order of their declarations; `plain` is the board that differs in nothing."""
