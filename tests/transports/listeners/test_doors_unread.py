"""Programs at a door of a hub that are slow, stuck or gone.

Module: servolink.transports.listeners.accepted.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from servolink.client import connect
from servolink.errors import ConnectionLost
from servolink.hub import ControlInterface, FrameProgram, Hub
from servolink.protocol import AddActionRequest, Codec, QueryActionRequest, Step
from servolink.transports.listeners import accept, accepted
from servolink.virtual import VirtualBoard
from tests.hub.door_hub import RawLine, on_hub, on_network, raw_socket, raw_tcp, sharing, until


def big_action() -> AddActionRequest:
    return AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000)))


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


def test_a_response_beyond_all_bounds_ends_the_connection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(accepted, "MOST_UNREAD", 10_000)
    monkeypatch.setattr(accept, "_SEND_BUFFER", 4096)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            await board.request(big_action())
            with pytest.raises(ConnectionLost):
                await board.action(1)

    on_hub(use)


@pytest.mark.parametrize("is_tcp", [False, True])
def test_the_end_of_a_program_that_has_read_nothing_is_noticed(is_tcp: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has asked for so much that it is not even listened to any more."""
    monkeypatch.setattr(accepted, "LONGEST_PAUSE", 1e6)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, on_network(hub) as tcp, connect(url) as board:
            await board.request(big_action())
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


def test_a_program_that_never_reads_is_disconnected_and_delays_nobody(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(accepted, "LONGEST_PAUSE", 0.2)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with sharing(hub) as url, connect(url) as board:
            await board.request(big_action())
            with RawLine(raw_socket()) as line:
                session = (await line.greet())["session"]
                program = hub.programs[session]
                with suppress(ConnectionError):
                    await line.send(Codec().encode(QueryActionRequest(1)) * 10_000)
                while session in hub.programs:
                    assert await board.servo_ids() == (1, 2, 3)
                assert program.counters.responses < 40

    on_hub(use)
    assert "a test was disconnected: the program does not read its responses" in caplog.text


def test_a_program_of_the_control_interface_that_never_reads_is_disconnected(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(accepted, "LONGEST_PAUSE", 0.2)
    # Few of its requests wait at a time, so their number does not end it.
    export = b'{"jsonrpc": "2.0", "id": 1, "method": "project.export"}\n'

    async def use(hub: Hub, _: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        async with sharing(hub, interface.open_channel) as url, connect(url) as board:
            await board.request(big_action())
            with RawLine(raw_socket()) as line:
                session = (await line.greet(wants="rpc"))["session"]
                await line.send(export * 20)
                await until(lambda: session in hub.programs)
                while session in hub.programs:
                    assert await board.servo_ids() == (1, 2, 3)
        await interface.close()

    on_hub(use)
    assert "a test was disconnected: the program does not read its responses" in caplog.text
