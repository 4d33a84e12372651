"""Captions with bytes that are not text, read through a hub: whole, and in no way an error.

Module: servolink.control.peer.
"""

from __future__ import annotations

import asyncio
import json

import msgspec
import pytest

from servolink.client import connect
from servolink.control import Greeting, RecordList, decode, open_channel
from servolink.errors import NotFound
from servolink.hub import serve_board
from servolink.virtual import BOARDS
from tests.lab.odd.firmwares import CutCaptions

CUT = "揮動左手然後再揮動右\udce6"


def test_the_control_interface_passes_each_byte_on() -> None:
    asyncio.run(_read_all())


async def _read_all() -> None:
    BOARDS["zoo"] = CutCaptions()
    async with serve_board("virtual://zoo", name="rex"):
        channel, _ = await open_channel("rex", Greeting(who="a test", wants="rpc"))
        listed = decode(await channel.call("records.list", timeout=5), RecordList)
        assert listed.records[0].caption == CUT
        for method in ("servos.parameters", "project.export"):
            json.loads(bytes(await channel.call(method, timeout=5)))
        exported = json.loads(bytes(await channel.call("project.export", timeout=5)))["project"]
        assert exported["actions"][0]["action_caption"] == CUT
        assert json.loads(bytes(await channel.call("run", timeout=5, type="action", id=CUT)))["seconds"] == 0.5
        with pytest.raises(NotFound):
            await channel.call("run", timeout=5, type="action", id="\udce6")
        await channel.close()
        async with connect("share://rex") as board:
            assert (await board.actions())[0].action_caption == CUT


def test_a_message_that_is_no_json_stays_an_error() -> None:
    for message in (b'{"records": [\\udce6', b'{"records": "\\udce6"}', b"\\udce6"):
        with pytest.raises(msgspec.MsgspecError):
            decode(message, RecordList)
