"""Whether there may be journals of imports, found without loading transfers.

Module: servolink.project.transfer.folders.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from servolink.errors import ProjectError
from servolink.project.transfer import folders
from servolink.project.transfer.folders import IMPORTS, data_folder, may_have_journals


def test_there_may_be_journals_where_a_file_is_or_the_folder_cannot_be_read(tmp_path: Path) -> None:
    assert not may_have_journals(tmp_path)
    (tmp_path / IMPORTS).mkdir()
    assert not may_have_journals(tmp_path)
    (tmp_path / IMPORTS / "00000007.json").touch()
    assert may_have_journals(tmp_path)
    assert may_have_journals(tmp_path / IMPORTS / "00000007.json"), "a file in place of the folder"


def test_a_folder_of_data_that_is_unknown_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert not may_have_journals(None)

    def unknown(kind: str) -> str:
        raise OSError(2, "no home")

    monkeypatch.setattr(folders, "user_folder_name", unknown)
    assert may_have_journals(None), "the reason is told when the journals are read"
    with pytest.raises(ProjectError, match="backups of boards cannot be kept: no home"):
        data_folder()
