"""A recorder on a hub: a process of its own, beside running programs, which its end does not disturb.

Module: servolink.recorder.hub_source.
"""

from __future__ import annotations

from pathlib import Path

from servolink.client import connect
from servolink.hub import ControlInterface, Hub
from servolink.recorder.channels import CommandDone, Event, PacketSeen, ServosRead
from servolink.recorder.reading import Recording
from servolink.recorder.recorder import Wanted, record, record_at
from servolink.virtual import VirtualBoard
from tests.hub.door_hub import on_hub, sharing


def test_it_hears_other_programs(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"

    async def use(hub: Hub, virtual: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel) as url, connect(url) as board:
            async with record_at(url, Wanted(path, hz=100)) as recorder:
                await board.move({1: 30}, duration=0.1, wait=True)
                recorder.mark("there")
            await board.stop()
        await interface.close()

    on_hub(use)
    recording = Recording(path)
    found = [entry.message for entry in recording.entries()]
    assert recording.about is not None
    assert (recording.about.through, recording.about.board) == ("hub", "rex")
    assert recording.remarks == []
    commands = [message for message in found if isinstance(message, CommandDone)]
    (moved,) = [each for each in commands if each.packet == "ExecuteActionRequest"]
    assert moved.outcome == "sent"
    assert moved.who
    assert moved.session
    assert any(isinstance(message, ServosRead) for message in found)
    assert "ExecuteActionRequest" in {message.packet for message in found if isinstance(message, PacketSeen)}
    assert Event("mark", "there") in found
    assert not [each for each in commands if each.packet == "SetServoParameterRequest"]


def test_a_program_records_all_programs_of_its_shared_board(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"

    async def use(hub: Hub, virtual: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel) as url, connect(url) as one, connect(url) as other:
            frames = hub.board.stats.frames_sent
            async with record(path, one, hz=0):
                assert hub.board.stats.frames_sent == frames
                await other.stop()
        await interface.close()

    on_hub(use)
    recording = Recording(path)
    packets = [entry.message.packet for entry in recording.entries() if isinstance(entry.message, CommandDone)]
    assert "SetServoParameterRequest" in packets


def test_the_end_of_the_hub_ends_it(tmp_path: Path) -> None:
    path = tmp_path / "out.mcap"

    async def use(hub: Hub, virtual: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel) as url:
            recording = record_at(url, Wanted(path))
            recorder = await recording.__aenter__()
        await recorder.over.wait()
        await recording.__aexit__(None, None, None)
        await interface.close()

    on_hub(use)
    recorded = Recording(path)
    assert "hub has ended" in [getattr(entry.message, "text", "") for entry in recorded.entries()][-1]
