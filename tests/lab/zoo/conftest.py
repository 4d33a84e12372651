"""An odd board for a test, in virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from tests.lab.zoo.trials import MakeZoo, Zoo


@pytest.fixture(name="zoo")
def _zoo(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> MakeZoo:
    """Return a function that makes an odd board, with folders of its own for profiles and backups."""
    for name in ("XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))

    def make(kind: str) -> Zoo:
        zoo = Zoo(kind, tmp_path, capsys)
        monkeypatch.setattr(asyncio, "run", zoo.clock.run)
        return zoo

    return make
