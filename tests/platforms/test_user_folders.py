"""Folders of the user, which are those of platformdirs: the usual cases are answered without it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import platformdirs
import pytest

from servolink.platforms.user_folders import Kind, user_folder
from tests.platforms.homeless import lose_home

FIND: dict[Kind, Callable[..., Path]] = {
    "config": platformdirs.user_config_path,
    "data": platformdirs.user_data_path,
    "runtime": platformdirs.user_runtime_path,
}


def test_folders_have_the_name_of_servolink() -> None:
    assert all(user_folder(kind).is_absolute() and user_folder(kind).name == "servolink" for kind in FIND)


@pytest.mark.filterwarnings("ignore::platformdirs.RuntimeDirWarning")
@pytest.mark.parametrize("home", ["/home/ann", "/home/ann/", "/", "", "ann", None])
@pytest.mark.parametrize("base", ["/srv/ann", "/srv/ann/", "", "ann", "~/ann", None])
def test_folders_are_those_of_platformdirs(base: str | None, home: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("XDG_CONFIG_HOME", base), ("XDG_DATA_HOME", base), ("HOME", home)):
        monkeypatch.delenv(name, raising=False) if value is None else monkeypatch.setenv(name, value)
    assert {kind: user_folder(kind) for kind in FIND} == {
        kind: find("servolink", appauthor=False) for kind, find in FIND.items()
    }


@pytest.mark.skipif(sys.platform != "linux", reason="other systems always ask platformdirs")
def test_the_usual_folders_are_found_without_platformdirs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "platformdirs", None)
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert user_folder("config") == tmp_path / ".config" / "servolink"
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    assert user_folder("data") == tmp_path / "data" / "servolink"


def test_a_user_without_a_home_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    lose_home(monkeypatch)
    with pytest.raises(OSError, match=r"could not determine the home directory; set HOME"):
        user_folder("data")
