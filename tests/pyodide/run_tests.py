"""Runs tests without an event loop in Pyodide: `python -m tests.pyodide tests/pyodide/run_tests.py tests/protocol`.

The arguments are those of pytest.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def main() -> int:
    """Return the exit code of pytest."""
    sys.path.append(str(Path.cwd()))  # where the packages are
    os.chdir(ROOT)
    options = ["-c", str(ROOT / "tests/pyodide/pytest.ini"), f"--rootdir={ROOT}"]
    return pytest.main([*options, *sys.argv[1:]])
