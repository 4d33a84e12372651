"""Compiled modules beside their sources, even where the environment forbids them.

Compiling hypothesis, servolink and the tests takes longer than collecting the tests. pytest loads this plug-in, which
pyproject.toml names, before those of packages; workers and the programs that tests start inherit the environment.
"""

from __future__ import annotations

import os
import sys

sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
