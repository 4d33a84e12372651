"""Mounted drives."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from servolink.support.platforms import drives


@pytest.mark.skipif(sys.platform != "linux", reason="Linux lists mount points in a file, with escaped spaces")
def test_mount_points_may_have_spaces(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Path("/proc") in drives.mounted_drives()
    monkeypatch.setattr(Path, "read_text", lambda *_: "/dev/sda1 /media/ada/RPI\\040RP2 vfat rw 0 0\n")
    assert drives.mounted_drives() == [Path("/media/ada/RPI RP2")]
