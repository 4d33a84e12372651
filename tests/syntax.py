"""Python files as syntax trees."""

from __future__ import annotations

import ast
import gc
from functools import lru_cache
from pathlib import Path


def modules_below(folder: Path) -> list[Path]:
    """Return the Python files below a folder, without those of packages that npm has installed there."""
    return sorted(path for path in folder.rglob("*.py") if "node_modules" not in path.parts)


def tree_of(path: Path) -> ast.Module:
    """Return the syntax tree of a file, which is parsed while no garbage is collected.

    CPython 3.11 raises SystemError if a finaliser parses something meanwhile, as one does that logs a traceback.
    """
    text = path.read_text(encoding="utf-8")
    gc.disable()
    try:
        return ast.parse(text)
    finally:
        gc.enable()


@lru_cache(maxsize=1)
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Return the nodes of the syntax tree of a file; those of the latest file are kept for the next question."""
    return tuple(ast.walk(tree_of(path)))
