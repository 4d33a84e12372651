"""Users and limits, also where the system has neither."""

from __future__ import annotations

import getpass
import os
import sys

import pytest

from servolink.platforms import process


@pytest.mark.parametrize("error", [KeyError, OSError, ModuleNotFoundError])
def test_a_user_without_a_name_is_no_error(error: type[Exception], monkeypatch: pytest.MonkeyPatch) -> None:
    """Python before 3.13 looks for the module pwd on Windows too, if no variable names the user."""

    def fail() -> str:
        raise error

    monkeypatch.setattr(getpass, "getuser", fail)
    assert process.login_name() == ""


@pytest.mark.skipif(sys.platform == "win32", reason="users have numbers")
def test_numbers_stand_for_users_and_groups_without_a_name() -> None:
    assert process.own_name() == process.user_name(os.geteuid())
    assert process.user_name(4_000_000_000) == process.group_name(4_000_000_000) == "4000000000"
    assert process.group_name(os.getegid()) in process.own_groups()
    assert process.members("no such group") is None


def test_windows_has_neither_numbers_nor_limits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    assert (process.own_name(), process.own_groups(), process.user_name(0), process.group_name(0)) == (
        "",
        frozenset(),
        "0",
        "0",
    )
    assert (process.members("root"), process.most_open_files()) == (None, None)
