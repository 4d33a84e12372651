"""A program on the pseudo-terminal of a hub that does not read.

Module: servolink.transports.listeners.pty.
"""

from __future__ import annotations

import sys

import pytest

from servolink.client import connect
from servolink.hub import Hub
from servolink.protocol import (
    AddActionRequest,
    Codec,
    QueryActionRequest,
    QueryServoListRequest,
    QueryServoListResponse,
    Step,
)
from servolink.transports.listeners import pty
from servolink.virtual import VirtualBoard
from tests.hub.door_hub import on_hub, on_serial_port
from tests.hub.serial_program import Port

LIST = Codec().encode(QueryServoListRequest())
ANSWER = Codec().encode(QueryServoListResponse((1, 2, 3)))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are those of Unix")


def test_what_has_no_room_is_dropped_in_whole_frames(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pty, "MOST_UNREAD", 10_000)

    async def use(hub: Hub, _: VirtualBoard) -> None:
        async with on_serial_port(hub) as url, on_serial_port(hub) as other, connect(other) as board:
            await board.request(AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(12_000))))
            with Port(url) as port:
                await port.send(Codec().encode(QueryActionRequest(1)) + LIST)
                assert await port.until(len(ANSWER)) == ANSWER
                assert port.is_silent()

    on_hub(use)
    assert "responses are dropped, as the program does not read" in caplog.text


def test_nobody_is_looked_for_often() -> None:
    assert pty.LOOK >= 0.05
