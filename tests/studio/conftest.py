"""A running studio, and a browser."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servolink import sync
from tests.processes import finish, start
from tests.studio.browser import CHROMIUM, OPTIONS, Studio
from tests.studio.node_tools import AXE, install


@pytest.fixture
def user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the user's files folders of their own."""
    runtime = tmp_path / "runtime"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return tmp_path


@pytest.fixture
def studio(user: Path) -> Iterator[Studio]:
    program = start([sys.executable, "-m", "servolink", "studio", "--demo", "--no-browser"])
    assert program.stdout is not None
    line = program.stdout.readline()
    assert line.startswith("studio http"), finish(program)
    with sync.connect("share://virtual") as board:
        yield Studio(line.split()[1], board)
    _, said = finish(program, signal.SIGTERM)
    assert (program.returncode, said) == (0, "ended: the board was left as it is\n")


@pytest.fixture(scope="session")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The script that looks for obstacles to people who do not see well, or use no mouse."""
    return (install(AXE, tmp_path_factory.mktemp("axe")) / "axe-core/axe.min.js").read_text()


@pytest.fixture
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield found
        found.close()
