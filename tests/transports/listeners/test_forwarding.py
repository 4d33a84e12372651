"""Bridges between hosts and transports that end late, early or never."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

import pytest

from servolink.protocol import ACTION, AddActionRequest, Codec, QueryServoListRequest, QueryServoListResponse, Step
from servolink.transports.listeners import forwarding
from servolink.transports.listeners.forwarding import serve_network
from servolink.transports.listeners.tcp import NetworkPlace
from servolink.transports.memory import MemoryTransport
from servolink.transports.registry import create
from servolink.virtual import VirtualBoard, VirtualTransport
from tests.virtual.receiving import GUARD, Heard, client
from tests.virtual_time import run

LIST = QueryServoListRequest()
ANSWER = QueryServoListResponse((1, 2, 3))


def test_a_host_that_does_not_read_keeps_nothing_open_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(forwarding, "_LINGER", 0.0)

    async def main() -> None:
        ours, theirs = MemoryTransport.pair()
        async with serve_network(lambda: ours, "127.0.0.1", 0) as url:
            with socket.socket() as line:
                line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
                line.connect(NetworkPlace.parse(url.removeprefix("tcp://")))
                line.sendall(Codec().encode(LIST))
                heard = Heard()
                await theirs.open(heard)
                await heard.until(1)
                await theirs.send(bytes(5 * 1024 * 1024))
                await theirs.close()
                async with asyncio.timeout(GUARD):
                    while len(asyncio.all_tasks()) > 2:  # this one and the one that accepts
                        await asyncio.sleep(0)
        assert asyncio.all_tasks() == {asyncio.current_task()}

    asyncio.run(main())


class _SlowWriter:
    """The stream to a host that reads for the first time a second after it was sent something."""

    def __init__(self) -> None:
        self.transport = self

    def write(self, data: bytes) -> None:
        pass

    async def drain(self) -> None:
        await asyncio.sleep(1)

    def get_write_buffer_size(self) -> int:
        return 0

    def close(self) -> None:
        pass

    async def wait_closed(self) -> None:
        pass

    def is_closing(self) -> bool:
        return True

    def abort(self) -> None:
        pass


def test_a_long_request_is_whole_although_its_host_reads_late() -> None:
    board = VirtualBoard(servos=16)
    steps = tuple(Step(servo_id, 30, 10) for servo_id in board.servos)
    frames = [Codec().encode(AddActionRequest(action_id, "Bow", steps)) for action_id in range(1, 101)]
    assert len(frames[0]) > 96, "or it is passed on in one piece"

    async def main() -> None:
        reader, writer = asyncio.StreamReader(), _SlowWriter()
        reader.feed_data(b"".join(frames))
        reader.feed_eof()
        writing: Any = writer
        await forwarding.bridge(reader, writing, lambda: VirtualTransport(board))

    run(main())
    assert [action_id for action_id, _ in board.storage.contents.records[ACTION]] == [*range(1, 101)]


def test_a_board_that_cannot_be_opened_disconnects_its_host(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with serve_network(lambda: create("serial:///nowhere"), "127.0.0.1", 0) as url:
            reader, writer = await client(url)
            async with asyncio.timeout(GUARD):
                assert await reader.read() == b""
            writer.close()

    asyncio.run(main())
    (told,) = [record.getMessage() for record in caplog.records]
    assert told.startswith("a host was disconnected: serial:///nowhere")
