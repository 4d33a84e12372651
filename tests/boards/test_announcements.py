"""Virtual boards on this machine are found as long as their server lives, and other users cannot add any."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

import pytest

from servolink.boards.announcements import announced, candidates
from servolink.transports import DeviceInfo
from tests.cli.programs import finished, started

BOARD = DeviceInfo("tcp://127.0.0.1:9000", "virtual board")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "servolink"


def test_a_board_is_found_from_beginning_to_end(folder: Path) -> None:
    assert candidates() == []
    with announced(BOARD), announced(DeviceInfo("tcp://127.0.0.1:9001")):
        assert {board.url for board in candidates()} == {"tcp://127.0.0.1:9000", "tcp://127.0.0.1:9001"}
    assert candidates() == []
    assert list(folder.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_a_server_that_ends_in_any_way_is_not_found(number: signal.Signals, folder: Path) -> None:
    process = started("virtual", "--pty", "--tcp", "127.0.0.1:0", "--servos", "3")
    try:
        assert process.stdout is not None
        urls = [process.stdout.readline().split()[1] for _ in range(2)]
        assert candidates() == [DeviceInfo(urls[1], "virtual board with 3 servos")]
    finally:
        finished(process, number)
    assert len(list(folder.iterdir())) == (number == signal.SIGKILL)
    assert candidates() == []
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"url": 1}', b"\xff", b"null"])
def test_what_is_no_announcement_is_passed_over(content: bytes, folder: Path) -> None:
    with announced(BOARD):
        (folder / "other.board").write_bytes(content)
        assert candidates() == [BOARD]


@pytest.mark.skipif(sys.platform == "win32", reason="named pipes are those of Unix")
def test_a_pipe_is_passed_over_without_waiting_for_what_it_may_bring(folder: Path) -> None:
    with announced(BOARD):
        os.mkfifo(folder / "pipe.board")
        number = os.open(folder / "pipe.board", os.O_RDWR)  # somebody may write to it, some day
        try:
            assert candidates() == [BOARD]
        finally:
            os.close(number)
        assert (folder / "pipe.board").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="the mode is that of Unix")
def test_a_folder_that_others_may_write_to_is_not_trusted(folder: Path) -> None:
    with announced(BOARD):
        folder.chmod(0o777)
        assert candidates() == []
        folder.chmod(0o700)
        assert candidates() == [BOARD]


@pytest.mark.skipif(sys.platform == "win32", reason="the mode is that of Unix")
def test_a_board_is_never_announced_in_a_folder_of_somebody_else(folder: Path, tmp_path: Path) -> None:
    (others := tmp_path / "others").mkdir(mode=0o700)
    folder.symlink_to(others)
    with announced(BOARD):
        assert list(others.iterdir()) == []
    folder.unlink()
    folder.mkdir()
    folder.chmod(0o777)
    with announced(BOARD):
        assert list(folder.iterdir()) == []


def test_a_board_is_served_unannounced_where_no_file_can_be_kept(folder: Path) -> None:
    folder.write_text("not a folder")
    with announced(BOARD):
        assert candidates() == []
