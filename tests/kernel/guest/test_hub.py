"""A hub on the kernel's own serial driver: its programs go on after the cable was pulled."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

import servolink
from servolink.client import connect
from servolink.hub import Hub, serve_board
from servolink.protocol import Codec, QueryServoListRequest, QueryServoListResponse
from servolink.virtual import VirtualBoard
from tests.kernel.guest.plug import LIMIT, Plug, board_use

pytestmark = pytest.mark.timeout(180)
PATIENCE = 60.0  # seconds for an answer in this slow machine
LIST = QueryServoListRequest()


async def until(hub: Hub, state: str) -> None:
    async with asyncio.timeout(LIMIT):
        while hub.status().state != state:
            await asyncio.sleep(0.01)


async def ask_without_the_library(url: str) -> None:
    host, port = url.removeprefix("tcp://").split(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    writer.write(Codec().encode(LIST))
    wanted = Codec().encode(QueryServoListResponse((1, 2, 3)))
    assert await reader.readexactly(len(wanted)) == wanted
    writer.close()


def test_three_programs_go_on_after_the_cable_was_pulled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, str(tmp_path))

    async def main(plug: Plug) -> None:
        async with (
            serve_board(plug.url("serial"), name="rex", tcp="127.0.0.1:0", patience=PATIENCE) as (hub, (url, tcp)),
            connect(url) as one,
            connect("rex") as two,
        ):
            first = hub.board.connection
            assert await one.servo_ids() == await two.servo_ids() == (1, 2, 3)
            await ask_without_the_library(tcp)
            await one.move({1: 20}, duration=0.1)
            await asyncio.to_thread(plug.unplug)
            await until(hub, "lost")
            with pytest.raises(servolink.RequestTimeout):
                await one.request(LIST, timeout=0.5)
            await asyncio.to_thread(plug.plug_in)
            await until(hub, "connected")
            assert await one.servo_ids() == await two.servo_ids() == (1, 2, 3)
            await ask_without_the_library(tcp)
            await two.stop()
            assert hub.board.connection is not first

    with Plug(board_use(VirtualBoard(servos=3))) as plug:
        asyncio.run(main(plug))
