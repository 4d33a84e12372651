"""Every method of Board through a hub, as on the board itself."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink import hub as hub_package
from servolink.client import connect
from servolink.errors import RequestTimeout
from servolink.hub.hub import share
from servolink.protocol import Codec
from servolink.virtual import BoardKind, VirtualBoard, VirtualTransport
from tests.client.piped_board import now
from tests.client.test_board import CHAPTERS
from tests.hub.local_transport import LocalTransport


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("board_order", ["little", "big"])
@pytest.mark.parametrize("use", CHAPTERS)
async def test_each_command_does_what_it_says(use: Any, board_order: Any, order: Any) -> None:
    url = f"virtual://?servos=3&byte_order={board_order}"
    async with (
        connect(url, byte_order=board_order, angle_unit=None) as upstream,
        share(upstream, name="rex") as hub,
        connect(LocalTransport(hub, codec=Codec(order)), byte_order=order) as board,
    ):
        await use(board)
        assert board.url == "share://rex"
        for stats in (board.stats, upstream.stats):
            assert stats.timeouts == stats.undecodable == stats.unsolicited == stats.retries == 0


async def test_a_button_press_on_the_board_arrives_at_those_who_asked() -> None:
    virtual = VirtualBoard(2)
    async with (
        connect(VirtualTransport(virtual), angle_unit=None) as upstream,
        share(upstream, name="rex") as hub,
        connect(LocalTransport(hub)) as one,
        connect(LocalTransport(hub)) as other,
        one.button_events() as events,
    ):
        virtual.press_button(4, now())
        event = await anext(events)
        assert (event.button_id, event.kind) == (4, "press")
        await asyncio.sleep(1)
        assert other.stats.events_received == 0


class DeafLine(VirtualTransport):
    """Loses what is sent to the board, at times."""

    is_deaf = False

    def _send(self, data: bytes) -> None:
        if not self.is_deaf:
            super()._send(data)


async def test_readings_go_on_when_the_board_is_back() -> None:
    line = DeafLine(VirtualBoard(2))
    async with (
        asyncio.timeout(100),
        connect(line, angle_unit=None, patience=60) as upstream,  # or the hub would lose it for good
        share(upstream, name="rex") as hub,
        connect(LocalTransport(hub)) as board,
        board.watch(hz=10) as readings,
    ):
        board.connection.lifecycle.outlasts_silence = True  # as on share://
        first = await anext(readings)
        line.is_deaf = True
        await asyncio.sleep(5)  # longer than a program waits for a response
        line.is_deaf = False
        last = first
        while last.seconds <= first.seconds + 5:
            last = await anext(readings)
        assert len(last.servos) == 2


async def test_readings_that_never_come_are_an_error() -> None:
    virtual = VirtualBoard(2, kind=BoardKind(unsupported=("QueryServo",)))
    async with (
        connect(VirtualTransport(virtual), angle_unit=None) as upstream,
        share(upstream, name="rex") as hub,
        connect(LocalTransport(hub)) as board,
        board.watch(hz=10) as readings,
    ):
        with pytest.raises(RequestTimeout):
            await anext(readings)


def test_what_programs_need_is_found_in_the_package() -> None:
    assert hub_package.share is share
    assert all(getattr(hub_package, name) for name in vars(hub_package)["__all__"])
    with pytest.raises(AttributeError, match=r"'servolink\.hub' has no attribute 'shares'"):
        getattr(hub_package, "shares")  # noqa: B009 - a type checker knows that it is not there
