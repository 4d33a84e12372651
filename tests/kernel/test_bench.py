"""The board on real drivers: everything in the folder `guest` runs in a kernel of its own."""

from __future__ import annotations

import os
import sys

import pytest

from tests.kernel.boot import LIMIT, boot, missing

GUEST = {"SERVOLINK_GUEST": "1", "PYTHONDONTWRITEBYTECODE": "1"}
PYTEST = (
    "pytest",
    "-m",
    "",
    "-p",
    "no:cacheprovider",
    "-p",
    "no:hypothesispytest",
    "--numprocesses=0",
    "--color=no",
    "-v",
    "--tb=native",
    "--confcutdir=tests/kernel",
)


@pytest.mark.slow
@pytest.mark.kernel
@pytest.mark.timeout(LIMIT + 60)
def test_everything_holds_on_the_kernels_own_drivers(capfd: pytest.CaptureFixture[str]) -> None:
    if lacking := missing():
        # A build server that calls this means it.
        (pytest.fail if os.environ.get("CI") else pytest.skip)(lacking)
    with capfd.disabled():  # it takes minutes: shown while it runs
        assert boot([sys.executable, "-m", *PYTEST, "tests/kernel/guest"], GUEST) == 0
