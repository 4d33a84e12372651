"""The folder with backups and journals, and what may be found in it."""

from __future__ import annotations

import errno
import json
import os
import sys
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import pytest

from servolink.errors import ProjectError
from servolink.project.model import UNFINISHED, Project
from servolink.project.project_file import load_project
from servolink.project.transfer.backups import BackupStore
from servolink.project.transfer.journal import Journal
from tests.project.pulled import NEW, OLD
from tests.support.platforms.homeless import lose_home

URL = "serial:///dev/ttyACM0?baudrate=115200"
MARKER = UNFINISHED.start + 7
JOURNAL = Journal(MARKER, URL, 3, None, "clearing")


def at(hour: int, second: int = 0) -> datetime:
    return datetime(2026, 3, 4, hour, 5, second, tzinfo=UTC)


def test_backups_are_numbered_and_never_overwritten_whatever_the_clock_says(tmp_path: Path) -> None:
    kept = [
        BackupStore(tmp_path, lambda hour=hour: at(hour)).keep(project, URL, "UTF8")  # type: ignore[misc]
        for hour, project in ((9, OLD), (9, NEW), (8, OLD), (8, OLD))
    ]
    backups = BackupStore(tmp_path).backups()
    assert [backup.path for backup in backups] == kept
    assert [(backup.number, backup.time) for backup in backups] == [(1, at(9)), (2, at(9)), (3, at(8)), (4, at(8))]
    assert {backup.board for backup in backups} == {"serial_dev_ttyACM0"}
    assert [load_project(path, unchecked=True) for path in kept] == [OLD, NEW, OLD, OLD]
    assert kept[0].name.startswith("000001-20260304T090500Z-serial_dev_ttyACM0-utf_8-")


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
def test_backups_and_journals_are_for_their_owner(tmp_path: Path) -> None:
    store = BackupStore(tmp_path)
    store.keep(OLD, URL, "utf-8")
    store.write(JOURNAL)
    modes = {path.parent.name: path.stat().st_mode & 0o777 for path in tmp_path.rglob("*.json")}
    assert modes == {"backups": 0o600, "imports": 0o600}


@pytest.mark.parametrize(
    ("url", "board"),
    [
        ("virtual://?servos=3", "virtual"),
        ("://", "board"),
        ("tcp://[fe80::1%eth0]:80/../..", "tcp_fe80_1_eth0_80"),
        ("serial://COM3", "serial_COM3"),
        ("serial://" + "/a" * 1000 + "_0001-if00", "_a" * 25 + "_0001_if00"),
        ("tcp://\u53f0\udcff\x1b\n:1", "tcp_1"),
    ],
)
def test_an_address_of_any_kind_makes_a_file_name_that_is_found_again(url: str, board: str, tmp_path: Path) -> None:
    path = BackupStore(tmp_path).keep(OLD, url, "utf-8")
    (backup,) = BackupStore(tmp_path).backups()
    assert (backup.path, backup.board) == (path, board.strip("_"))
    assert path.name.isascii()


def test_a_backup_that_does_not_read_back_as_it_was_written_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("servolink.project.transfer.backups.load_project", lambda *_, **__: NEW)
    with pytest.raises(ProjectError, match="the backup reads back with a different content"):
        BackupStore(tmp_path).keep(OLD, URL, "utf-8")


def test_what_is_no_backup_is_passed_over(tmp_path: Path) -> None:
    folder = tmp_path / "backups"
    folder.mkdir()
    good = "000001-20260304T090500Z-a-utf_8-0123456789ab.servolink.json"
    for name in (
        good,
        "000002-20269999T999999Z-a-utf_8-0123456789ab.servolink.json",
        "000003-\u0662\u0660\u0662\u06600304T090500Z-a-utf_8-0123456789ab.servolink.json",
        "20260304T090500Z-a-utf_8-0123456789ab.servolink.json",
        "000004-20260304T090500Z-a-utf_8-0123456789ab.servolink.json.tmp",
        "notes.txt",
    ):
        (folder / name).write_bytes(b"{")
    (folder / good.replace("000001", "000005")).mkdir()
    assert [backup.path.name for backup in BackupStore(tmp_path).backups()] == [good]
    assert BackupStore(tmp_path).keep(OLD, URL, "utf-8").name.startswith("000002-")


def test_numbers_go_on_behind_the_largest(tmp_path: Path) -> None:
    (tmp_path / "backups").mkdir()
    (tmp_path / "backups" / "999999999-20260304T090500Z-a-utf_8-0123456789ab.servolink.json").write_bytes(b"")
    assert BackupStore(tmp_path).keep(OLD, URL, "utf-8") == BackupStore(tmp_path).backups()[-1].path


def test_a_journal_comes_back(tmp_path: Path) -> None:
    store = BackupStore(tmp_path)
    backup = store.keep(OLD, URL, "utf-8")
    for journal in (JOURNAL, msgspec.structs.replace(JOURNAL, url="tcp://\udcff", backup=backup.name)):
        store.write(journal)
        assert store.journals(MARKER) == [journal]
    assert store.path_of(backup.name) == backup
    store.end(JOURNAL)
    store.end(JOURNAL)
    assert store.journals(MARKER) == []


def told(**changed: object) -> bytes:
    """Return the text of a journal in which something else stands."""
    return json.dumps(msgspec.to_builtins(JOURNAL) | changed).encode()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[" * 100_000,
        b"\xff",
        b"[]",
        b'{"marker": ' + b"9" * 5000 + b"}",
        b" " * 2_000_000 + told(),
        told(marker=5),
        told(marker=MARKER + 1),
        told(phase="dancing"),
        told(later="a field of a later version"),
        told(url=None),
        told(backup="../../etc/passwd"),
        told(backup="a/000001-20260304T090500Z-a-utf_8-0123456789ab.servolink.json"),
        told(restores="/project.servolink.json"),
        told(backup="000001-20260304T090500Z-../../a-utf_8-0123456789ab.servolink.json"),
    ],
    ids=lambda content: content[:20].decode(errors="replace"),
)
def test_a_journal_that_is_none_is_an_error_for_its_board_and_a_warning_for_others(
    content: bytes, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "imports").mkdir()
    (tmp_path / "imports" / f"{MARKER:08x}.json").write_bytes(content)
    other = msgspec.structs.replace(JOURNAL, marker=MARKER + 2)
    BackupStore(tmp_path).write(other)
    with pytest.raises(
        ProjectError, match=r"7a000007\.json: the journal .* move the journal away, and give `rollback`"
    ):
        BackupStore(tmp_path).journals(MARKER)
    assert not caplog.messages
    assert BackupStore(tmp_path).journals(5) == [other]
    assert len(caplog.messages) == 1


def test_what_is_no_journal_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "imports").mkdir()
    for name in ("x.json", "7A000001.json", "7a000001.json.tmp", ".servolink-0123"):
        (tmp_path / "imports" / name).write_bytes(b"{")
    (tmp_path / "imports" / "7a000002.json").mkdir()
    assert BackupStore(tmp_path).journals(UNFINISHED.start + 2) == []


def test_a_journal_that_another_program_ends_at_this_moment_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    BackupStore(tmp_path).write(JOURNAL)
    seen = Path.is_file

    def is_file(path: Path) -> bool:
        found = seen(path)
        path.unlink()
        return found

    monkeypatch.setattr(Path, "is_file", is_file)
    assert BackupStore(tmp_path).journals(MARKER) == []


def test_a_journal_that_cannot_be_deleted_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError("read-only")

    monkeypatch.setattr(os, "unlink", refuse)
    BackupStore(tmp_path).end(JOURNAL)
    assert caplog.messages == ["the journal of an ended import cannot be deleted: read-only"]


@pytest.mark.parametrize("name", ["backups", "imports"])
def test_a_folder_that_cannot_be_read_is_an_error_and_not_empty(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("in the way")
    store = BackupStore(tmp_path)
    with pytest.raises(ProjectError, match=f"{name} cannot be read: [A-Z][a-z ]+: a file stands"):
        _ = store.backups() if name == "backups" else store.journals(0)


@pytest.mark.parametrize("folder", [Path("no\0folder"), Path(os.devnull) / "folder"])
def test_a_folder_that_cannot_be_is_an_error(folder: Path) -> None:
    store = BackupStore(folder)
    with pytest.raises(ProjectError, match=r"the backup cannot be written|backups cannot be read"):
        store.keep(Project(), URL, "utf-8")
    with pytest.raises(ProjectError, match="the journal of the import cannot be written"):
        store.write(JOURNAL)


def test_a_full_disk_is_an_error_that_names_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(number: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    store = BackupStore(tmp_path)
    what_to_do = f"{os.strerror(errno.ENOSPC)}; correct the folder, and try again"
    with pytest.raises(ProjectError) as caught:
        store.keep(Project(), URL, "utf-8")
    assert str(caught.value) == f"{tmp_path / 'backups'}: the backup cannot be written: {what_to_do}"
    with pytest.raises(ProjectError) as caught:
        store.write(JOURNAL)
    assert str(caught.value) == f"{tmp_path / 'imports'}: the journal of the import cannot be written: {what_to_do}"


@pytest.mark.skipif(sys.platform != "linux", reason="where the data folder is")
def test_backups_are_in_the_data_folder_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert BackupStore().folder == tmp_path / "servolink"
    assert not list(tmp_path.iterdir())


def test_a_user_without_a_home_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    lose_home(monkeypatch)
    with pytest.raises(ProjectError, match=r"backups of boards cannot be kept: could not .* directory; set HOME"):
        BackupStore()
