"""Users and limits, also where the system has neither."""

from __future__ import annotations

import getpass
import os
import sys

import pytest

from servolink.support.platforms import process
from servolink.support.platforms.process import Account


@pytest.mark.parametrize("error", [KeyError, OSError, ModuleNotFoundError])
def test_a_user_without_a_name_is_no_error(error: type[Exception], monkeypatch: pytest.MonkeyPatch) -> None:
    """Python before 3.13 looks for the module pwd on Windows too, if no variable names the user."""

    def fail() -> str:
        raise error

    monkeypatch.setattr(getpass, "getuser", fail)
    assert process.login_name() == ""


@pytest.mark.skipif(sys.platform == "win32", reason="users have numbers")
def test_numbers_stand_for_users_and_groups_without_a_name() -> None:
    status = os.stat_result((0, 0, 0, 0, 4_000_000_000, 4_000_000_000, 0, 0, 0, 0))
    assert Account.of_file(status) == Account("4000000000", frozenset({"4000000000"}))
    own = os.stat_result((0, 0, 0, 0, os.geteuid(), os.getegid(), 0, 0, 0, 0))
    assert Account.of_file(own).user == Account.of_process().user
    assert Account.of_file(own).groups <= Account.of_process().groups
    assert Account.members("no such group") is None


@pytest.mark.parametrize("system", ["win32", "emscripten"])
def test_windows_and_pyodide_have_neither_numbers_nor_limits(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", system)
    assert Account.of_process() == Account("", frozenset())
    assert Account.of_file(os.stat_result([0] * 10)) == Account("0", frozenset({"0"}))
    assert (Account.members("root"), process.most_open_files()) == (None, None)
