"""The two loops that cost most, compiled, if this installation was built with them; see docs/how-to/compiled-build.md.

Nothing else differs: without them `parser.py` and `row.py` do the same in Python, and are what they are tested by.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

Collect = Callable[[bytes, int, dict[bytes, Any], list[tuple[int, bytes]], int], int]
"""Buffer, position, known headers, frames, how many of them to be wary of: appends the frames that stand there one
behind the other, and returns where something else begins."""
ReadRows = Callable[[bytes, int, str, Callable[..., Any] | None, str], tuple[Any, ...]]
"""Content, start, `struct` format of a row, record (None: bare numbers), encoding of captions: the group there."""

collect: Collect | None = None
read_rows: ReadRows | None = None

try:
    _module = import_module("servolink.protocol._speedups")
except ImportError:
    pass
else:  # pragma: no cover - the coverage of pure Python is measured
    collect, read_rows = _module.collect, _module.read_rows
