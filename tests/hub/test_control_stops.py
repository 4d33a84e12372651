"""Stops through the control interface of a hub: of all servos, of some, and of a movement that is let go.

Module: servolink.hub.engine.stop_order.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from servolink.control import Greeting
from servolink.hub.methods.control_session import ControlInterface
from servolink.protocol import SetServoParameterRequest
from servolink.virtual import BoardKind
from tests.client.piped_board import LOST, now
from tests.hub.control_program import RpcFailed, RpcProgram, shared
from tests.hub.shared_world import World, on_hub


async def test_a_dead_man_who_stops_to_beat_stops_the_board() -> None:
    async with shared() as here, here.program("studio") as studio:
        await studio.call("lease.take", dead_man=0.35)
        await studio.call("move", targets={"1": 90}, duration=10)
        for _ in range(10):
            await asyncio.sleep(0.1)
            studio.tell("lease.beat")
        assert all(state.is_start for state in await here.states())
        await asyncio.sleep(0.4)
        assert not any(state.is_start for state in await here.states())
        assert studio.of("lease")[-1]["event"] == "beats stopped"


@pytest.mark.parametrize("greeting", [None, 1.0])
async def test_motions_that_wait_are_neither_beats_nor_sent_after_the_stop(greeting: float | None) -> None:
    async with shared() as here, here.program("page", dead_man=greeting) as page:
        await page.call("lease.take", dead_man=1.0)
        targets = [{"1": 60 if number % 2 else -60} for number in range(40)]
        moves = [page.begin("move", targets=target, duration=0.5, wait=True) for target in targets]
        await asyncio.sleep(1.1)
        assert [change["event"] for change in page.of("lease")][:2] == ["taken", "beats stopped"]
        failed = await asyncio.gather(*moves, return_exceptions=True)
        assert [type(one) for one in failed[:1]] == [dict]
        assert {str(one) for one in failed[3:]} == {"nothing was moved: a stop came first"}
        assert not any(state.is_start for state in await here.states())
        assert here.hub.lease is None


async def test_from_the_moment_of_silence_on_motions_asked_for_before_are_refused() -> None:
    async with shared() as here, here.program("studio") as studio:
        await studio.call("lease.take", dead_man=0.35)
        ticket = here.hub.stops.ticket()
        assert here.hub.lease is not None
        here.hub.leases.left(here.hub.lease.session)
        assert not here.hub.stops.holds(ticket)  # in the same turn of the loop, before the stop is sent


async def test_a_stop_ends_what_any_program_asked_for_before_it() -> None:
    async with shared() as here, here.program("script") as script, here.program("tablet", "watch") as tablet:
        script.begin("lease.take")
        script.begin("board.hold")
        later = [
            script.begin("run", type="action", id=1),
            script.begin("move", targets={"1": 90}, duration=5),
            script.begin("release", servo="all"),
            script.begin("servo.set", servo=1, start=True, hold=True),
        ]
        await tablet.call("stop")
        for one in later:
            with pytest.raises(RpcFailed, match="nothing was moved: a stop came first"):
                await one
        stopping = script.begin("stop")
        await script.call("servo.set", servo=1, start=True, hold=True)  # asked for after it
        await asyncio.wait([stopping])
        await script.call("servo.set", servo="all", start=True, hold=True)
        await script.call("move", targets={"1": 90}, duration=5)
        assert all(state.is_start for state in await here.states())


async def test_stops_of_single_servos_end_neither_each_other_nor_what_their_program_asks_for_after_them() -> None:
    async with shared() as here, here.program("page") as page, here.program("tablet") as tablet:
        await page.call("release", servo="all")
        holding = [page.begin("servo.set", servo=servo, start=False, hold=True) for servo in (1, 2, 3)]
        starting = page.begin("servo.set", servo=1, start=True, hold=True)
        await asyncio.gather(*holding, starting)
        assert [(state.is_start, state.is_hold) for state in await here.states()][:3] == [(1, 1), (0, 1), (0, 1)]
        await page.call("lease.give")
        await tablet.call("board.hold")
        moving = page.begin("move", targets={"1": 90}, duration=5)
        await page.call("status")
        await tablet.call("servo.set", servo=3, start=False, hold=True)
        with pytest.raises(RpcFailed, match="nothing was moved: a stop came first"):
            await moving
        waiting = page.begin("servo.set", servo=2, start=False, hold=True)
        await tablet.call("stop")
        await tablet.call("board.release")
        await waiting


async def test_a_dead_man_time_in_the_greeting_holds_for_each_lease() -> None:
    async with shared() as here, here.program("studio", dead_man=0.35) as studio:
        await studio.call("move", targets={"1": 90}, duration=10)
        lease = (await studio.call("board.state"))["lease"]
        assert lease["dead_man"] == 0.35
        await asyncio.sleep(0.4)
        assert not any(state.is_start for state in await here.states())


async def test_a_stop_passes_everything_from_any_role() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("tablet", "watch") as tablet:
        moving = studio.begin("move", targets={"1": 90}, duration=10, wait=True)
        await asyncio.sleep(1)
        await tablet.call("stop")
        assert not any(state.is_start for state in await here.states())
        begun = now()
        with pytest.raises(RpcFailed, match="the motion was started, and then ended by a stop"):
            await moving
        assert now() - begun < 0.2
        with pytest.raises(RpcFailed, match="needs the role move"):
            await tablet.call("move", targets={"1": 0}, duration=0.1)


@pytest.mark.parametrize("servos", [[1, 2], None])
@pytest.mark.parametrize("turnaround", [0.0, 0.03, 0.15, 0.25])
async def test_a_movement_that_is_ended_stops_and_the_next_one_is_obeyed(servos: Any, turnaround: float) -> None:
    kind = BoardKind(turnaround=turnaround)
    async with shared(kind=kind, speed_cap=150) as here, here.program() as studio:
        await studio.call("move", targets={"1": -90, "2": 60}, speed=100, wait=True)
        await studio.call("move", targets={"1": 90, "2": -60}, speed=100)
        await asyncio.sleep(0.6)
        ending = studio.begin("move.end", servos=servos)
        seen = []
        while not ending.done():
            seen.append(here.angle(1))
            await asyncio.sleep(0.01)
        await ending
        assert seen == sorted(seen)  # nothing turned back
        assert seen[-1] < 90
        await asyncio.sleep(3)
        assert here.angle(1) == seen[-1]
        assert [(one.is_start, one.is_hold) for one in await here.states()] == [(1, 1)] * 3
        await studio.call("move", targets={"1": 80}, speed=100, wait=True)


async def test_a_movement_that_was_not_sent_yet_is_ended_too() -> None:
    async with shared(kind=BoardKind(turnaround=0.1), speed_cap=150) as here, here.program() as studio:
        await studio.call("move", targets={"1": -90}, speed=100, wait=True)
        moving = studio.begin("move", targets={"1": 90}, speed=100)  # where it is must be read first
        await asyncio.sleep(0.01)
        await studio.call("move.end", servos=[1])
        with pytest.raises(RpcFailed, match="a stop came first"):
            await moving
        await asyncio.sleep(3)
        assert here.angle(1) == -90
    async with shared() as here, here.program() as studio, here.program("tablet") as tablet:
        await tablet.call("board.hold", reason="calibrating")
        before, moving = here.angle(1), studio.begin("move", targets={"1": 90}, duration=0.1)
        await studio.call("move.end", servos=[1])
        await tablet.call("board.release")
        with pytest.raises(RpcFailed, match="nothing was moved: a stop came first"):
            await moving
        assert here.angle(1) == before


@pytest.mark.parametrize("seconds", [0.0, 0.15])
async def test_who_lets_go_undoes_no_stop(seconds: float) -> None:
    kind = BoardKind(turnaround=0.1)
    async with shared(kind=kind) as here, here.program() as studio, here.program("tablet", "watch") as tablet:
        await studio.call("move", targets={"1": 90}, duration=10)
        first, second = (tablet, studio) if seconds == 0 else (studio, tablet)
        ways = {tablet: ("stop", {}), studio: ("move.end", {"servos": [1]})}
        begun = first.begin(ways[first][0], **ways[first][1])
        await asyncio.sleep(seconds)
        await second.call(ways[second][0], **ways[second][1])
        await begun
        await asyncio.sleep(3)
        assert not any(state.is_start for state in await here.states())
        await studio.call("servo.set", servo="all", start=True, hold=True)
        await studio.call("move", targets={"1": 90}, duration=10)
        await studio.call("move.end", servos=[1])
        assert all(state.is_start for state in await here.states())


def test_servos_that_do_not_stop_when_their_movement_is_ended_are_stopped_with_all_others() -> None:
    async def use(there: World) -> None:
        interface = ControlInterface(there.hub)
        program = RpcProgram(there.hub, interface, Greeting(wants="rpc", who="studio"))
        await program.call("move", targets={"1": 90}, duration=10)
        there.fake.plan(SetServoParameterRequest, LOST)
        with pytest.raises(
            RpcFailed, match=r"servos \[1\] were asked to stop.*all servos are stopped instead"
        ) as failed:
            await program.call("move.end", servos=[1])
        assert failed.value.kind == "OutcomeUnknown"
        await asyncio.sleep(0.1)
        assert not any(servo.is_start for servo in there.fake.servos.values())
        await program.channel.close()
        await interface.close()

    on_hub(use)


async def test_the_servos_whose_movement_is_ended_are_a_list() -> None:
    async with shared() as here, here.program() as studio:
        for servos in ("all", 1, [255]):
            with pytest.raises(RpcFailed, match=r"must be a list or null, not|255 is outside 0\.\.254") as failed:
                await studio.call("move.end", servos=servos)
            assert failed.value.kind == "invalid_params"


async def test_who_has_lost_the_lease_ends_no_movement_of_others() -> None:
    async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:
        await studio.call("move", targets={"1": 30}, duration=0.1)
        await tablet.call("lease.take", force=True)
        await tablet.call("move", targets={"1": 90}, duration=1)
        with pytest.raises(RpcFailed, match=r"nothing was stopped: .* moved by tablet"):
            await studio.call("move.end", servos=[1])
        await asyncio.sleep(2)
        assert here.angle(1) == 90


def _shield_of_python_3_14(inner: asyncio.Future[Any]) -> asyncio.Future[Any]:
    """Shield `inner`, and report an error of it that comes after the cancellation, as `asyncio.shield` does there."""
    inner, outer = asyncio.ensure_future(inner), _SHIELD(inner)

    def report(ended: asyncio.Future[Any]) -> None:
        if outer.cancelled() and not ended.cancelled() and (error := ended.exception()):
            text = f"{type(error).__name__} exception in shielded future"
            ended.get_loop().call_exception_handler({"message": text, "exception": error, "future": ended})

    inner.add_done_callback(report)
    return outer


_SHIELD = asyncio.shield


def test_a_stop_whose_page_has_left_says_once_and_without_a_traceback_that_the_board_is_gone(
    monkeypatch: pytest.MonkeyPatch, warnings_logged: Callable[[], list[str]]
) -> None:
    async def use(there: World) -> None:
        interface = ControlInterface(there.hub)
        page = RpcProgram(there.hub, interface, Greeting(wants="rpc", who="page", role="edit"))
        await page.call("servos.list")
        there.fake.usual = LOST
        page.begin("stop")
        await asyncio.sleep(0.01)
        closing = asyncio.ensure_future(page.channel.close())
        await asyncio.sleep(0)
        there.fake.vanish()
        await closing
        await interface.close()

    monkeypatch.setattr(asyncio, "shield", _shield_of_python_3_14)
    on_hub(use)
    (said,) = warnings_logged()
    assert said.startswith("a stop was sent and could not be confirmed")
