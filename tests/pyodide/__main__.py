"""Runs `main` of a Python file of this repository in Pyodide: `python -m tests.pyodide FILE [ARGUMENT...]`.

`main` may be a coroutine function, and returns the exit code, as for `sys.exit`. The file imports what is in this
repository and in `requirements.txt`, once `install` has run. Warnings are errors.
"""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).parent

if __name__ == "__main__":
    if (node := shutil.which("node")) is None:
        sys.exit("Node.js is not installed")
    if not (HERE / "wheels").is_dir():
        sys.exit(f"Pyodide is not installed; run {HERE / 'install'}")
    os.execv(node, ["node", str(HERE / "runner.mjs"), *sys.argv[1:]])  # noqa: S606 - no shell
