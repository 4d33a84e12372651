"""Programs at a door that are slow, stuck or gone."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from servolink.client.connect import connect
from servolink.errors import ConnectionLost
from servolink.hub.doors.frame_doors import tcp_door
from servolink.hub.engine.program import FrameProgram
from servolink.hub.hub import Hub
from servolink.listeners import accept, accepted
from servolink.protocol.codec import Codec
from servolink.protocol.editing import AddActionRequest, QueryActionRequest
from servolink.protocol.records import Step
from servolink.virtual.board import VirtualBoard
from tests.hub.door_hub import RawLine, on_hub, raw_socket, raw_tcp, sharing, until


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


def test_a_response_beyond_all_bounds_ends_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accepted, "MOST_UNREAD", 10_000)
    monkeypatch.setattr(accept, "_SEND_BUFFER", 4096)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            await board.request(AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000))))
            with pytest.raises(ConnectionLost):
                await board.action(1)

    on_hub(use)


@pytest.mark.parametrize("is_tcp", [False, True])
def test_the_end_of_a_program_that_has_read_nothing_is_noticed(is_tcp: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has asked for so much that it is not even listened to any more."""
    monkeypatch.setattr(accepted, "LONGEST_PAUSE", 1e6)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, tcp_door(hub, "127.0.0.1:0") as tcp, connect(url) as board:
            await board.request(AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000))))
            with await raw_tcp(tcp) if is_tcp else RawLine(raw_socket()) as line:
                if not is_tcp:
                    await line.greet()
                await line.send(Codec().encode(QueryActionRequest(1)) * 2000)
                await until(lambda: len(hub.programs) == 2)
                program = list(hub.programs.values())[-1]
                assert isinstance(program, FrameProgram)
                await until(lambda: program.queue.is_unread and program.is_full)
            await until(lambda: len(hub.programs) == 1)
            assert await board.servo_ids() == (1, 2, 3)

    on_hub(use)


def test_a_program_that_is_gone_before_it_is_served_harms_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    async def use(hub: Hub, _: VirtualBoard) -> None:
        loop = asyncio.get_running_loop()
        serve = loop.connect_accepted_socket
        gone = [True]

        async def fail_once(*args: Any, **options: Any) -> Any:
            if gone:
                gone.clear()
                raise OSError("it is gone")
            return await serve(*args, **options)

        monkeypatch.setattr(loop, "connect_accepted_socket", fail_once)
        async with sharing(hub) as url:
            with RawLine(raw_socket()) as line:
                assert await line.until_end() == b""
            async with connect(url) as board:
                assert await board.servo_ids() == (1, 2, 3)

    on_hub(use)
