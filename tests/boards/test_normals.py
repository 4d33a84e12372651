"""Normals of servos in a file: kept, read again, and distrusted when old or of another board."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from servolink.boards import BoardIdentityRecord, BoardNormals, ServoNormal
from servolink.errors import ProfileError
from servolink.support import user_folder

NOW = datetime(2026, 1, 31, 12, tzinfo=UTC)
IDENTITY = BoardIdentityRecord(servo_ids=(1, 2), serial_number="A1")
NORMAL = ServoNormal.of(range(500), (90, 95), (), seconds=12.5, learnt_at=NOW)
NORMALS = BoardNormals(IDENTITY, {1: NORMAL})


@pytest.fixture
def file(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    return user_folder("data") / "guard" / "rex.json"


def test_a_hundred_readings_of_each_kind_are_kept_from_all_of_the_time() -> None:
    assert NORMAL.moving == tuple(range(0, 500, 5))
    assert (NORMAL.resting, NORMAL.lags) == ((90, 95), ())
    assert (ServoNormal.most(NORMAL.moving), ServoNormal.most((7,)), ServoNormal.most(())) == (450, 7, None)


def test_normals_are_read_as_they_were_kept_and_forgotten(file: Path) -> None:
    assert BoardNormals.load("rex") is None
    NORMALS.save("rex")
    assert file.stat().st_mode & 0o077 == 0, "only the user can read it"
    assert BoardNormals.load("rex") == NORMALS
    BoardNormals.forget("rex")
    BoardNormals.forget("rex")
    assert BoardNormals.load("rex") is None


@pytest.mark.parametrize("content", [b"", b"{", b'{"identity": {}}', b"\xff", b'{"identity":{},"servos":{"x":{}}}'])
def test_a_damaged_file_counts_as_none(file: Path, content: bytes) -> None:
    file.parent.mkdir(parents=True)
    file.write_bytes(content)
    assert BoardNormals.load("rex") is None


def test_a_time_without_a_zone_and_an_impossible_name_count_as_none(file: Path) -> None:
    BoardNormals(IDENTITY, {1: ServoNormal((), (), (), 1.0, NOW.replace(tzinfo=None))}).save("rex")
    assert file.exists()
    assert BoardNormals.load("rex") is None
    assert BoardNormals.load("../rex") is None
    with pytest.raises(ProfileError, match=r"'\.\./rex'"):
        NORMALS.save("../rex")


def test_a_file_that_cannot_be_written_or_removed_is_an_error_with_the_reason(file: Path) -> None:
    file.mkdir(parents=True)
    with pytest.raises(ProfileError, match="what is normal for rex cannot be removed: "):
        BoardNormals.forget("rex")
    with pytest.raises(ProfileError, match="what is normal for rex cannot be kept: Is a directory"):
        NORMALS.save("rex")


@pytest.mark.parametrize(("days", "counts"), [(0, True), (29, True), (31, False), (-31, False)])
def test_old_normals_are_distrusted(*, days: int, counts: bool) -> None:
    assert NORMALS.trusted(IDENTITY, NOW + timedelta(days=days)) == ({1: NORMAL} if counts else {})


@pytest.mark.parametrize(
    ("found", "counts"),
    [
        (BoardIdentityRecord(servo_ids=(2, 1)), True),
        (BoardIdentityRecord(servo_ids=(1, 2, 3)), False),
        (BoardIdentityRecord(servo_ids=(1, 2), serial_number="B2"), False),
    ],
)
def test_normals_of_another_board_are_distrusted(*, found: BoardIdentityRecord, counts: bool) -> None:
    assert bool(NORMALS.trusted(found, NOW)) == counts
