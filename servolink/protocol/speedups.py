"""The two most expensive loops, compiled, if this installation was built with them; see docs/how-to/compiled-build.md.

Without them `parser.py` and `row.py` do the same in Python, which the compiled loops are tested against.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

Collect = Callable[[bytes, int, dict[bytes, Any], list[tuple[int, bytes]], int], int]
"""Takes buffer, position, known headers, a list of frames, and how many frames to be wary of. Appends the frames that
stand there one behind the other, and returns where anything else begins."""
ReadRows = Callable[[bytes, int, str, Callable[..., Any] | None, str], tuple[Any, ...]]
"""Takes content, start, `struct` format of a row, record class (None: plain numbers) and encoding of captions. Returns
the group there."""

collect: Collect | None = None
read_rows: ReadRows | None = None

try:
    _module = import_module("servolink.protocol._speedups")
except ImportError:
    pass
else:  # pragma: no cover - the coverage of pure Python is measured
    collect, read_rows = _module.collect, _module.read_rows
