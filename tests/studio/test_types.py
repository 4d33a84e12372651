"""The modules of the page have the types that they say, which only the TypeScript compiler can tell."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import processes
from tests.studio.node_tools import TYPESCRIPT, install, needs_npm
from tests.studio.vendor import VENDOR


@pytest.mark.slow
@needs_npm
def test_the_page_is_typed(tmp_path: Path) -> None:
    compiler = install(TYPESCRIPT, tmp_path) / ".bin/tsc"
    checked = processes.run([str(compiler), "-p", str(VENDOR.parent)])
    assert checked.returncode == 0, checked.stdout
