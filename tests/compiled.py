"""Compiled modules in pytest's cache, where Python writes none beside the sources.

Compiling hypothesis, servolink and the tests takes longer than collecting the tests. pytest loads this plug-in, which
pyproject.toml names, before those of packages; workers and the programs that tests start inherit the environment.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

if sys.dont_write_bytecode:
    sys.dont_write_bytecode = False
    sys.pycache_prefix = os.environ["PYTHONPYCACHEPREFIX"] = str(Path(__file__).parents[1] / ".pytest_cache/pycache")
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
