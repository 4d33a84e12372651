"""A user without a home."""

from __future__ import annotations

import platformdirs
import pytest


def lose_home(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the home of the user away, and all folders in it."""

    def homeless(*_: object, **__: object) -> str:
        raise RuntimeError("could not determine the home directory")

    for variable in ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME"):
        monkeypatch.delenv(variable, raising=False)
    for find in ("user_config_path", "user_data_path"):
        monkeypatch.setattr(platformdirs, find, homeless)
