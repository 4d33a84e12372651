"""The modules of the page have the types that they say and nothing superfluous, as TypeScript and ESLint see it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import processes
from tests.studio.node_tools import ESLINT, TYPESCRIPT, install, needs_npm
from tests.studio.vendor import VENDOR


@pytest.mark.slow
@needs_npm
def test_the_page_is_typed(tmp_path: Path) -> None:
    compiler = install(TYPESCRIPT, tmp_path) / ".bin/tsc"
    checked = processes.run([str(compiler), "-p", str(VENDOR.parent)])
    assert checked.returncode == 0, checked.stdout


@pytest.mark.slow
@needs_npm
def test_the_page_is_tidy(tmp_path: Path) -> None:
    rules = Path(__file__).with_name("eslint.config.mjs")
    command = [str(install(ESLINT, tmp_path) / ".bin/eslint"), "--max-warnings=0", "--config", str(rules), "."]
    checked = processes.run(command, cwd=VENDOR.parent)
    assert checked.returncode == 0, checked.stdout + checked.stderr
