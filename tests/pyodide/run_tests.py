"""Runs tests in Pyodide: `python -m tests.pyodide tests/pyodide/run_tests.py tests/protocol`.

The arguments are folders or files, and options of pytest. With `--left-out` alone, the tests that `left_out.py` names
are run, which must fail.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.pyodide import left_out, plain_loop

ROOT = left_out.ROOT


def main() -> int:
    """Return the exit code of pytest."""
    sys.path.append(str(Path.cwd()))  # where the packages are
    os.chdir(ROOT)
    plain_loop.install()
    arguments = sys.argv[1:]
    if arguments == ["--left-out"]:
        # What failed leaves files and coroutines behind.
        return tests([*left_out.rows(left_out.FAILING), "-pno:unraisableexception"], left_out.Only())
    return tests(arguments, left_out.Without(each for each in arguments if not each.startswith("-")))


def tests(arguments: list[str], plugin: Any) -> int:
    """Run tests with a plug-in; return the exit code of pytest."""
    options = ["-c", str(ROOT / "tests/pyodide/pytest.ini"), f"--rootdir={ROOT}", f"--confcutdir={ROOT}"]
    return pytest.main([*options, *arguments], plugins=[plugin])
