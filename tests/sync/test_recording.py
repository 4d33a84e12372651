"""`servolink.sync.record`: a recording without `async`."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path
from typing import Any, cast

import pytest

import servolink
from servolink.errors import RecordingError
from servolink.recorder import Event, Recording, Wire
from tests import processes


def test_a_block_is_recorded(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    with servolink.sync.connect("virtual://?servos=2") as board:
        with servolink.sync.record(path, board, hz=0) as recorder:
            board.move({1: 30}, duration=0.05, wait=True)
            recorder.mark("the arm is up", who="me")
            assert not recorder.status.problem
        assert recorder.status.messages > 2
        assert board.servo_ids() == (1, 2)
    recording = Recording(path)
    messages = [entry.message for entry in recording.entries()]
    assert recording.remarks == []
    assert Event("mark", "the arm is up", who="me") in messages
    assert any(isinstance(message, Wire) for message in messages)


def test_an_error_in_the_block_ends_the_recording_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    with servolink.sync.connect("virtual://?servos=2") as board:
        with pytest.raises(ZeroDivisionError), servolink.sync.record(path, board):
            raise ZeroDivisionError
        with (
            pytest.raises(RecordingError, match="exists already"),
            servolink.sync.record(path, board),
        ):
            pytest.fail("an existing file is never replaced")
    recording = Recording(path)
    assert list(recording.entries())
    assert recording.remarks == []


def test_a_board_of_the_other_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"

    async def main() -> None:
        async with servolink.connect("virtual://") as board:
            with (
                pytest.raises(TypeError, match=r"must be a board of servolink\.sync, not Board"),
                servolink.sync.record(path, cast("Any", board)),
            ):
                pytest.fail("it would wait for itself")
        for wrong in ("virtual://", None):
            with pytest.raises(TypeError, match="must be a connected board, not"):
                async with servolink.recorder.record(path, cast("Any", wrong)):
                    pytest.fail("there is no board")

    asyncio.run(main())
    assert not path.exists()


ABANDONED = """
import sys
import servolink
board = servolink.sync.connect("virtual://")
recording = servolink.sync.record(sys.argv[1], board)
recording.__enter__().mark("here")
"""


@pytest.mark.slow
def test_the_end_of_the_program_ends_a_recording_without_a_word(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    process = processes.start([sys.executable, "-W", "default", "-c", ABANDONED, str(path)], stderr=subprocess.PIPE)
    out, err = process.communicate(timeout=processes.LIMIT)
    assert (process.returncode, out, err) == (0, "", "")
    recording = Recording(path)  # its last moment is lost, as in a crash
    list(recording.entries())
