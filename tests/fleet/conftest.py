"""A broker for each test that needs one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.fleet.bridged import user
from tests.fleet.mosquitto import Broker

__all__ = ["broker", "user"]


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    """A broker that lets everybody in."""
    found = Broker(tmp_path)
    found.start()
    yield found
    found.end()
