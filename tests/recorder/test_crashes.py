"""Recorders that are killed, and real disks without room: at most the last chunk is missing."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from servolink.recorder.channels import Event, Recorded, Wire
from servolink.recorder.clock import Clock
from servolink.recorder.reading import Recording
from servolink.recorder.repairing import repair
from servolink.recorder.writer import RecordingWriter
from tests import processes
from tests.recorder.kills import LONGEST_LOSS, losses

pytestmark = [pytest.mark.slow, pytest.mark.skipif(sys.platform == "win32", reason="needs signals and limits of Unix")]


def test_kill_costs_at_most_the_last_second(tmp_path: Path) -> None:
    assert losses(tmp_path, 6)[-1] < 10 * LONGEST_LOSS  # other tests run beside it; `.ci/release` wants a second


def test_a_file_that_may_not_grow(tmp_path: Path) -> None:
    """As on a full disk: the system refuses to write more; the recording ends with an error, and the file is good."""
    path = tmp_path / "out.mcap"
    limited = (
        "import resource, runpy, signal\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "runpy.run_module('servolink', run_name='__main__')"
    )
    done = processes.run(
        (
            sys.executable,
            "-c",
            limited,
            "record",
            str(path),
            "--board",
            "virtual://",
            "--hz",
            "100",
            "--seconds",
            "2.5",
        ),
        env={  # without coverage, which writes too, and compiled modules: Python does not see that the limit cut one
            **{name: value for name, value in os.environ.items() if not name.startswith("COV")},
            "PYTHONDONTWRITEBYTECODE": "1",
        },
    )
    assert done.returncode == 1
    assert "File too large" in done.stderr
    assert "Traceback" not in done.stderr
    assert path.stat().st_size <= 20_000
    assert repair(path).messages > 50


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 128 KiB; only root can make one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if processes.run(("mount", "-t", "tmpfs", "-o", "size=128k", "tmpfs", str(folder))).returncode:
        pytest.skip("no file system can be mounted here")
    yield folder
    processes.run(("umount", str(folder)), check=True)


def test_a_full_file_system(small_disk: Path) -> None:
    path, filler = small_disk / "out.mcap", small_disk / "filler"
    clock = Clock()
    writer = RecordingWriter(path, Recorded("0", "", "rex", "board"), clock)
    filler.write_bytes(bytes(64 * 1024))
    for _ in range(40):
        writer.take(clock.now(), Wire("received", os.urandom(10_000), 0.0))
    processes.until(lambda: writer.status().problem)
    assert writer.status().problem == "No space left on device"
    recording = Recording(path)  # whatever was written is whole chunks
    assert all("damaged" not in remark for remark in recording.remarks)
    filler.unlink()
    writer.take(clock.now(), Event("mark", "last"))
    processes.run(("mount", "-o", "remount,size=8m", str(small_disk)), check=True)
    writer.close()
    recording = Recording(path)
    assert sum(isinstance(entry.message, Wire) for entry in recording.entries()) == 40
    assert recording.remarks == []
