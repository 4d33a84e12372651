"""Option `--board firmware`: the core of the firmware in place of virtual boards, in tests and the programs they start.

Tests with the mark `virtual_only` are left out; each says why. The summary has the number of tests whose board was the
firmware.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.firmware import stand_in
from tests.firmware.host import compile_library

_CHILDREN = Path(__file__).parent / "children"
"""Folder whose `sitecustomize` gives the boards of other programs a core."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile the core once for all processes, and let the virtual boards of each use it."""
    if not hasattr(config, "workerinput"):
        folder = tempfile.TemporaryDirectory()
        config.add_cleanup(folder.cleanup)
        compile_library(Path(folder.name) / "board.so")
        os.environ[stand_in.FOLDER] = folder.name
    stand_in.install()


@pytest.fixture(scope="session", autouse=True)
def _programs_have_cores(pytestconfig: pytest.Config) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join([str(_CHILDREN), str(pytestconfig.rootpath)]))
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out the tests of what only the virtual board does."""
    for item in items:
        if mark := item.get_closest_marker("virtual_only"):
            item.add_marker(pytest.mark.skip(mark.args[0]))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Count the tests whose board was the firmware."""
    reports = [each for kind in terminalreporter.stats.values() for each in kind if isinstance(each, pytest.TestReport)]
    names = Path(os.environ[stand_in.FOLDER]) / stand_in.USED
    used = set(names.read_text("utf-8").splitlines() if names.exists() else ())
    used &= {each.nodeid for each in reports}
    failed = {each.nodeid for each in reports if each.failed}
    terminalreporter.write_line(f"{len(used)} tests used the firmware, {len(used & failed)} of them failed")
