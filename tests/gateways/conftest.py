"""Folders of its own for each test, so that hubs of other tests are not found."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.fleet.conftest import broker

__all__ = ["broker"]


@pytest.fixture(autouse=True)
def _folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path))
