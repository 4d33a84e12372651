"""Files are replaced whole or not at all, and read whole within a limit."""

from __future__ import annotations

import errno
import os
import socket
import stat
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from servolink.support.files import MIB, read_file, reason, write_atomically

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="permissions and links of POSIX")


def failing(error: int) -> Any:
    """Return a function that fails with this error."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(error, os.strerror(error))

    return fail


def test_a_file_is_made_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for content in (b"one", b"", b"three"):
        write_atomically(path, content)
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_the_longest_name_is_long_enough(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 255)
    write_atomically(path, b"content")
    assert path.read_bytes() == b"content"


@POSIX
def test_a_new_file_has_the_usual_permissions_and_an_old_one_keeps_its_own(tmp_path: Path) -> None:
    (tmp_path / "usual").write_bytes(b"")
    write_atomically(tmp_path / "new", b"")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "usual").stat().st_mode
    (tmp_path / "new").chmod(0o640)
    write_atomically(tmp_path / "new", b"again")
    assert stat.S_IMODE((tmp_path / "new").stat().st_mode) == 0o640


@POSIX
def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "folder" / "file")
    for content in (b"one", b"two"):
        write_atomically(link, content)
        assert link.is_symlink()
        assert (tmp_path / "folder" / "file").read_bytes() == content


@POSIX
def test_what_is_no_file_is_left_alone(tmp_path: Path) -> None:
    pipe, link = tmp_path / "pipe", tmp_path / "link"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    for path in (pipe, link):
        with pytest.raises(OSError, match="not a regular file"):
            write_atomically(path, b"x")
    assert pipe.is_fifo()
    assert sorted(tmp_path.iterdir()) == [link, pipe]


def test_a_write_protected_file_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"before")
    path.chmod(0o444)
    access = os.access
    # As it is for a user: root may write everything.
    monkeypatch.setattr(
        os, "access", lambda asked, mode: access(asked, mode) and not (asked == path and mode & os.W_OK)
    )
    with pytest.raises(PermissionError, match="is write-protected; allow writing first"):
        write_atomically(path, b"after")
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]
    path.chmod(0o644)  # Windows removes no file that is write-protected


@POSIX
def test_a_folder_that_is_not_there_is_not_passed_over_on_the_way_up(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_atomically(tmp_path / "missing" / ".." / "file", b"x")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("step", ["fsync", "chmod", "replace"])
def test_a_failure_leaves_what_was_there_and_nothing_else(
    step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, step, failing(errno.ENOSPC))
    if step == "replace":
        monkeypatch.setattr(os, "rename", failing(errno.ENOSPC))
    with pytest.raises(OSError, match="No space left"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_what_went_wrong_first_is_what_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", failing(errno.EIO))
    monkeypatch.setattr(os, "unlink", failing(errno.EROFS))
    with pytest.raises(OSError, match=os.strerror(errno.EIO)):
        write_atomically(tmp_path / "file", b"new")


@POSIX
@pytest.mark.parametrize(("error", "passes"), [(errno.EINVAL, True), (errno.ENOTSUP, True), (errno.EIO, False)])
def test_folders_that_cannot_be_synced_are_no_failure(
    error: int, passes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sync = os.fsync

    def fsync(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(error, os.strerror(error))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    if passes:
        write_atomically(tmp_path / "file", b"new")
    else:
        with pytest.raises(OSError, match=os.strerror(error)):
            write_atomically(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"new"


def test_a_folder_that_may_not_be_opened_is_no_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "open", failing(errno.EACCES))
    write_atomically(tmp_path / "file", b"new")
    assert (tmp_path / "file").read_bytes() == b"new"


@POSIX
def test_a_private_file_is_for_its_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "secret"
    write_atomically(path, b"one", private=True)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.chmod(0o640)  # the owner decides otherwise
    write_atomically(path, b"two", private=True)
    assert (path.read_bytes(), stat.S_IMODE(path.stat().st_mode)) == (b"two", 0o640)


def test_temporary_files_of_killed_programs_are_removed_when_they_are_old(tmp_path: Path) -> None:
    old, new = tmp_path / f".servolink-{'0' * 16}", tmp_path / f".servolink-{'1' * 16}"
    others = [tmp_path / ".servolink-notes", tmp_path / f".servolink-{'0' * 15}", tmp_path / f"x.servolink-{'0' * 16}"]
    folder = tmp_path / f".servolink-{'2' * 16}"
    folder.mkdir()
    for path in (old, new, *others):
        path.write_bytes(b"")
    long_ago = time.time() - 7200
    for path in (old, folder, *others):
        os.utime(path, (long_ago, long_ago))
    write_atomically(tmp_path / "file", b"x")
    assert sorted(tmp_path.iterdir()) == sorted([new, folder, *others, tmp_path / "file"])


def test_files_up_to_the_limit_are_read(tmp_path: Path) -> None:
    path = tmp_path / "file"
    for content in (b"", b"x" * 10):
        path.write_bytes(content)
        assert read_file(path, 10) == content
    path.write_bytes(b"x" * 11)
    with pytest.raises(OSError, match="is larger than 10 bytes, the limit") as refused:
        read_file(path, 10)
    assert refused.value.errno == errno.EFBIG


def test_a_file_that_is_larger_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "sparse"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(OSError, match="is larger than 4 MiB"):
        read_file(path, 4 * MIB)


def test_a_file_that_is_missing_or_a_folder_is_said_to_be_so(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_file(tmp_path / "missing", 10)
    with pytest.raises(IsADirectoryError):
        read_file(tmp_path, 10)
    with pytest.raises(ValueError, match="null"):
        read_file(tmp_path / "a\0b", 10)


@POSIX
def test_a_pipe_or_a_device_is_refused_without_waiting(tmp_path: Path) -> None:
    pipe, link, address = tmp_path / "pipe", tmp_path / "link", tmp_path / "socket"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(address))
        for path in (pipe, link, address, Path("/dev/zero")):
            with pytest.raises(OSError, match="is not a regular file"):
                read_file(path, 10)


@POSIX
def test_a_file_that_becomes_a_pipe_is_refused_without_waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x")
    before = path.stat()
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr(Path, "stat", lambda _: before)
    with pytest.raises(OSError, match="is not a regular file"):
        read_file(path, 10)


@POSIX
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs files whose size is only known at their end")
def test_files_without_a_size_are_read_up_to_the_limit() -> None:
    assert read_file(Path("/proc/self/status"), MIB).startswith(b"Name:")
    with pytest.raises(OSError, match="is larger than 10 bytes"):
        read_file(Path("/proc/self/status"), 10)


@POSIX
def test_missing_folders_of_private_files_are_private_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        write_atomically(tmp_path / "servolink" / "imports" / "note", b"", private=True)
    finally:
        os.umask(before)
    made = {path.name: stat.S_IMODE(path.stat().st_mode) for path in tmp_path.rglob("*")}
    assert made == {"servolink": 0o700, "imports": 0o700, "note": 0o600}


def test_a_file_in_place_of_a_folder_is_named_with_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "home").touch()
    with pytest.raises(OSError, match="home") as failed:
        write_atomically(tmp_path / "home" / ".config" / "file", b"", private=True)
    assert "Not a directory: a file stands where a folder is needed; set HOME" in reason(failed.value)
