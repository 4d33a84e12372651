"""Programs of a hub that have exclusive use of the board, and what waits for them.

Module: servolink.hub.methods.context.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.client import Board, connect
from servolink.hub.rules.exchanges import Exchange
from servolink.protocol import ALL_SERVOS, Action, ServoParameter, SetServoParameterRequest, Step
from tests.hub.control_program import RpcFailed, shared
from tests.hub.local_transport import LocalTransport


async def test_the_end_of_one_connection_frees_the_board_and_the_end_of_both_ends_the_session() -> None:
    async with shared() as here, here.program("tablet") as tablet:
        board = await connect(LocalTransport(here.hub, session_id="s", who="script"))
        async with here.program("script", session="s") as script:
            await script.call("board.hold")
        assert here.hub.exclusive_use is None
        async with here.program("script", session="s") as script:
            await script.call("lease.take")
            await board.close()
            assert (await tablet.call("board.state"))["lease"] is None
            for method in ("lease.take", "board.hold"):
                with pytest.raises(RpcFailed, match="the session has ended") as failed:
                    await script.call(method)
                assert failed.value.kind == "ConnectionLost"


async def test_a_program_with_button_events_that_leaves_frees_the_board() -> None:
    async with shared() as here, here.program("tablet") as tablet:
        async with asyncio.timeout(10), here.program("script") as script:
            await script.call("buttons.subscribe")
            await script.call("lease.take")
            await script.call("board.hold")
        assert (await tablet.call("board.state"))["lease"] is None
        assert len((await tablet.call("servos.list"))["servos"]) == 3


async def test_button_events_end_at_once_during_exclusive_use() -> None:
    async with shared() as here, here.program("tablet") as tablet:
        await tablet.call("buttons.subscribe")
        await tablet.call("board.hold")
        await tablet.call("buttons.unsubscribe")
        assert here.hub.exclusive_use is not None
        here.virtual.press_button(4, asyncio.get_running_loop().time())
        await tablet.call("board.release")
        await asyncio.sleep(1)
        assert tablet.of("button") == []
        await tablet.call("buttons.subscribe")
        here.virtual.press_button(5, asyncio.get_running_loop().time())
        assert (await tablet.until("button"))["button_id"] == 5


async def test_a_program_that_leaves_while_it_waits_to_have_the_board_alone() -> None:
    async with shared() as here, here.program("tablet") as tablet:
        await tablet.call("board.hold")
        frames = here.hub.join(lambda _: None, who="script", door="local", session_id="s")
        async with here.program("script", session="s") as script:
            holding = script.begin("board.hold")
            await asyncio.sleep(1)
            frames.leave()
            await tablet.call("board.release")
            with pytest.raises(RpcFailed, match="the session has ended") as failed:
                await holding
            assert failed.value.kind == "ConnectionLost"
            assert here.hub.exclusive_use is None


async def test_who_has_the_board_alone_makes_the_others_wait() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:
        await studio.call("board.hold", reason="calibrating")
        await tablet.call("status")
        moving = tablet.begin("move", targets={"1": 10}, duration=0.1)
        holding = tablet.begin("board.hold")
        listing = tablet.begin("servos.list")
        await asyncio.sleep(30)
        assert not any(waiting.done() for waiting in (moving, holding, listing))
        await studio.call("move", targets={"1": 60}, duration=0.1, wait=True)
        await studio.call("lease.give")
        assert (await studio.call("board.release"))["hold"] is None
        assert (await tablet.until("hold"))["hold"] is None
        await moving
        assert (await holding)["hold"]["who"] == "tablet"
        assert len((await listing)["servos"]) == 3


@pytest.mark.parametrize(
    ("method", "params"),
    [
        ("release", {}),
        ("move", {"targets": {"1": 60}, "duration": 0.1}),
        ("servo.set", {"servo": "all", "start": True, "hold": True}),
        ("run", {"type": "action", "id": 1}),
        ("run.prepare", {"type": "action", "id": 1}),
    ],
)
async def test_a_motion_that_waits_for_the_board_ends_with_its_time_and_with_a_stop(method: str, params: Any) -> None:
    async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:
        await here.hub.board.add_action(Action(1, "Bow", (Step(1, 60, 10),)))
        await studio.call("board.hold", reason="an import")
        clock = asyncio.get_running_loop().time
        late, begun = clock() + 2, clock()
        with pytest.raises(RpcFailed, match="the time by which it was to begin has passed"):
            await tablet.call(method, **params, until=late)
        assert clock() == pytest.approx(begun + 2)
        with pytest.raises(RpcFailed, match="the time by which it was to begin has passed"):
            await studio.call(method, **params, until=late - 1)
        first = tablet.begin(method, **params)
        second = tablet.begin(method, **params, until=clock() + 600)  # waits for the first, too
        await asyncio.sleep(1)
        assert not first.done()
        await here.hub.stop("somebody")
        for motion in (first, second):
            with pytest.raises(RpcFailed, match="a stop came first") as failed:
                await motion
            assert failed.value.kind == "MotionRefused"
            assert failed.value.remedy == "ask for it again, if it is still wanted"
        await studio.call("board.release")
        await asyncio.sleep(1)
        assert here.hub.lease is None
        assert [(state.is_start, state.is_hold) for state in await here.states()] == [(0, 1)] * 3
        # One that was asked for after the stop is carried out.
        await tablet.call(method, **params, **({"start": True} if method == "move" else {}))


async def test_a_motion_is_not_sent_late_or_after_a_stop_even_if_the_board_is_taken_at_the_last_moment() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:

        async def failure(reason: str, until: float) -> RpcFailed:
            """Return how a motion fails if somebody does something between its check and its way to the board."""
            release = Board.release

            async def taken(board: Board, which: Any = "all") -> None:
                if reason == "stop":
                    await here.hub.stop("somebody")
                elif reason == "hold":
                    await studio.call("board.hold")
                else:
                    await asyncio.sleep(5)
                await release(board, which)

            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(Board, "release", taken)
                with pytest.raises(RpcFailed) as failed:
                    await tablet.call("release", until=until)
            return failed.value

        clock = asyncio.get_running_loop().time
        assert "a stop came first" in str(await failure("stop", clock() + 60))
        assert "by which it was to begin has passed" in str(await failure("late", clock() + 1))
        assert "studio has taken exclusive use of the board" in str(await failure("hold", clock() + 60))
        assert all(state.is_hold for state in await here.states())


async def test_a_motion_that_waits_in_the_hub_is_not_sent_after_its_time() -> None:
    async with shared() as here, here.program("studio") as studio:
        transport = LocalTransport(here.hub, who="script", session_id="s")
        program = transport.join()
        await studio.call("board.hold")
        late = here.hub.stops.ticket(until=asyncio.get_running_loop().time() + 1, who="s")
        program.put(Exchange(program, SetServoParameterRequest(ALL_SERVOS, 0, 0), late))
        await asyncio.sleep(2)
        await studio.call("board.release")
        await asyncio.sleep(1)
        assert all(state.is_hold for state in await here.states())
        assert program.counters.refused == 1
        program.leave()


async def test_the_hold_and_the_lease_end_with_their_program() -> None:
    async with shared() as here, here.program("tablet") as tablet:
        await tablet.call("status")
        async with here.program("studio") as studio:
            await studio.call("board.hold", reason="calibrating")
            await studio.call("lease.take")
            moving = tablet.begin("move", targets={"1": 10}, duration=0.1)
        await moving
        joined, left = tablet.of("program")
        assert (joined["event"], joined["who"], joined["door"]) == ("joined", "studio", "share")
        assert (left["event"], left["who"], left["session"]) == ("left", "studio", "session of studio")


async def test_who_stops_a_servo_does_not_wait_for_who_has_the_board_alone() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:
        await here.hub.board.add_servo_parameters([ServoParameter(2, 0, "hip")])
        await studio.call("board.hold", reason="an import")
        async with asyncio.timeout(1):
            await tablet.call("servo.set", servo="1", start=False, hold=True)
        assert [(state.is_start, state.is_hold) for state in await here.states()] == [(0, 1), (1, 1), (1, 1)]
        async with asyncio.timeout(1):
            await tablet.call("servo.set", servo="all", start=False, hold=True)
        assert [(state.is_start, state.is_hold) for state in await here.states()] == [(0, 1)] * 3
        by_caption = tablet.begin("servo.set", servo="hip", start=False, hold=True)
        await asyncio.sleep(30)
        assert not by_caption.done()  # nobody else may read captions
        await studio.call("board.release")
        await by_caption
