"""What was measured, told at the end of the run."""

from __future__ import annotations

from collections.abc import Callable

import pytest

_measured = pytest.StashKey[list[str]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_measured] = []


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    if config.stash[_measured]:
        terminalreporter.section("measured in the guest, whose processor is emulated")
        for line in config.stash[_measured]:
            terminalreporter.write_line(line)


@pytest.fixture
def report(pytestconfig: pytest.Config) -> Callable[[str], None]:
    """Tell a line at the end of the run."""
    return pytestconfig.stash[_measured].append
