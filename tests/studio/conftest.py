"""A running studio, and a browser."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servolink import sync
from tests.processes import run
from tests.studio.browser import CHROMIUM, OPTIONS, PATIENCE, Studio, running
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
    with running("studio", "--demo") as url, sync.connect("share://virtual") as board:
        yield Studio(url, board)


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The studio as static files, which need no server of its own, and what the build said."""
    folder = tmp_path_factory.mktemp("page") / "page"
    build = Path(__file__).parents[2] / ".ci/page"
    return folder, run([sys.executable, str(build), str(folder)], check=True, limit=600).stdout


@pytest.fixture(scope="session")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The script that looks for obstacles to people who do not see well, or use no mouse."""
    return (install(AXE, tmp_path_factory.mktemp("axe")) / "axe-core/axe.min.js").read_text()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """A browser for all tests of a module. Other modules may need a thread without Playwright's event loop."""
    playwright = pytest.importorskip("playwright.sync_api", reason="the extra browser is not installed")
    playwright.expect.set_options(timeout=PATIENCE)
    with playwright.sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield found
        found.close()


@pytest.fixture
def browser(chromium: Any) -> Iterator[Any]:
    """A browser without a page."""
    yield chromium
    for context in chromium.contexts:
        context.close()
