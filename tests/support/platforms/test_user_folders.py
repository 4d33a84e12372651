"""Folders of the user, as platformdirs finds them."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from servolink.support.platforms.user_folders import Kind, user_folder
from tests.support.platforms.homeless import lose_home


def test_folders_have_the_name_of_servolink() -> None:
    kinds: tuple[Kind, ...] = get_args(Kind)
    assert all(user_folder(kind).is_absolute() and user_folder(kind).name == "servolink" for kind in kinds)


def test_a_relative_folder_in_the_environment_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CONFIG_HOME", "ann")
    assert user_folder("config").is_absolute()


def test_a_user_without_a_home_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    lose_home(monkeypatch)
    with pytest.raises(OSError, match=r"could not determine the home directory; set HOME"):
        user_folder("data")
