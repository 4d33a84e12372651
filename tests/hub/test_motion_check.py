"""What the shell refuses is refused by the hub too, by what any of its programs did and read."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from servolink.client import connect
from servolink.hub import share
from servolink.virtual import BoardTransport, VirtualBoard
from tests.hub.control_program import RpcFailed, RpcProgram, Shared, shared
from tests.lab.odd.dialects import UnitLies


async def by_move(page: RpcProgram, targets: dict[str, float], **options: Any) -> object:
    return await page.call("move", targets=targets, duration=0.1, **options)


async def by_run(page: RpcProgram, targets: dict[str, float], **options: Any) -> object:
    return await page.call("run", type="action", id=1, **options)


async def by_stream(page: RpcProgram, targets: dict[str, float], **options: Any) -> object:
    stream = (await page.call("stream.begin", **options))["stream"]
    return await page.call("stream.send", stream=stream, targets=targets)


DOORS = pytest.mark.parametrize("door", [by_move, by_stream])
Door = Callable[..., Awaitable[object]]


@DOORS
async def test_a_page_is_refused_what_the_shell_is(door: Door) -> None:
    async with shared() as here, here.program() as page, here.program("tablet") as tablet:
        for targets, words in (
            ({"99": 10}, "the board has no servo 99; nothing was moved"),
            ({"1": 1000}, "1000 degrees is beyond ±360"),
        ):
            with pytest.raises(RpcFailed, match=words):
                await door(page, targets)
        await tablet.call("release", servo=1)
        await tablet.call("lease.give")
        with pytest.raises(RpcFailed, match="servo 1 is stopped or released") as failed:
            await door(page, {"1": 10})
        assert failed.value.kind == "RequestRefused"
        await door(page, {"2": 10})
        await here.hub.stop("a button")
        with pytest.raises(RpcFailed, match="servo 2 is stopped or released"):
            await door(page, {"2": 10})


@DOORS
async def test_options_let_a_page_pass(door: Door) -> None:
    async with shared() as here, here.program() as page:
        await door(page, {"1": 1000}, any_angle=True)
        await page.call("release", servo=1)
        await page.call("move", targets={"1": 10}, duration=0.1, start=True)
        assert (await here.states())[0].is_start


async def test_accepted_set_points_of_a_page_ask_the_board_for_nothing() -> None:
    async with shared() as here, here.program() as page:
        stream = (await page.call("stream.begin", hz=100))["stream"]
        await page.call("stream.send", stream=stream, targets={"1": 1})
        stats = here.hub.board.stats
        sent, fences = stats.frames_sent, stats.fences
        for angle in range(20):
            await page.call("stream.send", stream=stream, targets={"1": angle})
        assert stats.frames_sent == sent + 20 + stats.fences - fences


@pytest.mark.parametrize("door", [by_move, by_stream, by_run])
async def test_no_motion_of_a_page_starts_from_a_reading_that_cannot_be_true(door: Door) -> None:
    board = UnitLies()
    async with (
        connect(BoardTransport(board), angle_unit=None) as upstream,
        share(upstream, name="rex") as hub,
        Shared(hub, VirtualBoard()).program() as page,
    ):
        with pytest.raises(RpcFailed, match="servo 1 reports 500°, beyond 360") as failed:
            await door(page, {"1": 20})
        assert failed.value.kind == "MotionRefused"
        with pytest.raises(RpcFailed, match="servo 1 reports 500°, beyond 360"):
            await door(page, {"1": 30})
        assert board.servos[1].degrees(board.now + 9) == 0
        await door(page, {"1": 530}, any_angle=True)
        await page.call("servos.list")
        assert board.servos[1].degrees(board.now + 9) == (-160 if door is by_run else 10)
