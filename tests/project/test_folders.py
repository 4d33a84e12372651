"""Folder of backups and journals, and whether there may be journals of imports.

Module: servolink.project.transfer.backups.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.errors import ProjectError
from servolink.project.transfer import backups
from servolink.project.transfer.backups import IMPORTS, BackupStore, data_folder


def test_there_may_be_journals_where_a_file_is_or_the_folder_cannot_be_read(tmp_path: Path) -> None:
    assert not BackupStore(tmp_path).may_have_journals()
    (tmp_path / IMPORTS).mkdir()
    assert not BackupStore(tmp_path).may_have_journals()
    (tmp_path / IMPORTS / "00000007.json").touch()
    assert BackupStore(tmp_path).may_have_journals()
    assert BackupStore(tmp_path / IMPORTS / "00000007.json").may_have_journals(), "a file in place of the folder"


def test_a_folder_of_data_that_is_unknown_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert not BackupStore().may_have_journals()

    def unknown(kind: str) -> str:
        raise OSError(2, "no home")

    monkeypatch.setattr(backups, "user_folder", unknown)
    with pytest.raises(ProjectError, match="backups of boards cannot be kept: no home"):
        data_folder()
