"""Recording a board of this program: what is in the file, and that other tools read it.

Module: servolink.recorder.new_file.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from mcap.reader import make_reader

from servolink.errors import RecordingError
from servolink.recorder.channels import CommandDone, Event, Message, PacketSeen, ServosRead, Wire
from servolink.recorder.reading import Recording
from servolink.recorder.recorder import record
from tests.client.piped_board import PipedBoard, opened
from tests.support.sleeping import HOUR, set_wall_clock
from tests.virtual_time import run


def messages(path: Path) -> list[Message]:
    recording = Recording(path)
    found = [entry.message for entry in recording.entries()]
    assert recording.remarks == []
    return found


def test_everything_is_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"

    async def main() -> tuple[int, int]:
        async with opened(PipedBoard(), angle_unit=None) as board:
            sent, received = board.stats.bytes_sent, board.stats.bytes_received
            async with record(path, board) as recorder:
                recorder.mark("begin")
                await board.move({1: 30}, duration=0.2, wait=True)
                await board.stop()
            return board.stats.bytes_sent - sent, board.stats.bytes_received - received

    sent, received = run(main())
    found = messages(path)
    wire = [message for message in found if isinstance(message, Wire)]
    assert sum(len(each.data) for each in wire if each.direction == "sent") == sent
    assert sum(len(each.data) for each in wire if each.direction == "received") == received
    packets = [message.packet for message in found if isinstance(message, PacketSeen)]
    assert {"ExecuteActionRequest", "QueryServoResponse", "SetServoParameterResponse"} <= set(packets)
    commands = {(message.packet, message.outcome) for message in found if isinstance(message, CommandDone)}
    assert {("ExecuteActionRequest", "sent"), ("SetServoParameterRequest", "sent")} <= commands
    assert any(isinstance(message, ServosRead) for message in found)
    assert Event("mark", "begin") in found
    assert Event("connection", "connected") in found


def test_a_clock_that_is_set_leaves_the_order_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "out.mcap"

    async def main() -> None:
        async with opened(PipedBoard(), angle_unit=None) as board, record(path, board) as recorder:
            for number, jump in enumerate((HOUR, -2 * HOUR, HOUR)):
                set_wall_clock(monkeypatch, jump)
                recorder.mark(f"{number}")
                await board.move({1: 30}, duration=0.2, wait=True)

    run(main())
    entries = list(Recording(path).entries())
    times = [entry.time for entry in entries]
    assert times == sorted(times)
    assert times[-1] - times[0] < HOUR * 1e9 / 2
    events = [entry.message for entry in entries if isinstance(entry.message, Event)]
    marks = [event.what for event in events if event.kind == "mark"]
    assert marks == ["0", "1", "2"]


def test_the_library_of_others_reads_it_by_its_index(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"

    async def main() -> None:
        async with opened(PipedBoard(), angle_unit=None) as board, record(path, board, hz=100):
            await asyncio.sleep(3)

    run(main())
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.chunk_count >= 1
        topics = {channel.topic: channel for channel in summary.channels.values()}
        count = summary.statistics.channel_message_counts[topics["/servos"].id]
        assert len(list(reader.iter_messages(topics=["/servos"]))) == count > 100
        assert sum(1 for _ in reader.iter_messages()) == summary.statistics.message_count
        (metadata,) = reader.iter_metadata()
        assert metadata.metadata["through"] == "board"


async def test_without_hz_nothing_is_sent(tmp_path: Path) -> None:
    async with opened(PipedBoard(), angle_unit=None) as board:
        sent = board.stats.frames_sent
        async with record(tmp_path / "out.mcap", board, hz=0):
            pass
        assert board.stats.frames_sent == sent


def test_only_bytes(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"

    async def main() -> None:
        async with opened(PipedBoard(), angle_unit=None) as board, record(path, board, wire_only=True):
            await board.servos()

    run(main())
    assert {type(message) for message in messages(path)} == {Wire}


def test_a_file_that_exists_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"
    path.write_text("mine")

    async def main() -> None:
        async with opened(PipedBoard()) as board:
            with pytest.raises(RecordingError, match="exists already"):
                async with record(path, board):
                    pass
            assert board.connection.taps.members == ()

    run(main())
    assert path.read_text() == "mine"
