"""What programs can do through the control interface of a hub."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from servolink.client import connect as connecting
from servolink.client.connect import connect
from servolink.hub.control.session import METHODS, ControlInterface
from servolink.hub.exchanges import Bounds
from servolink.hub.hub import share
from servolink.hub.local import LocalTransport
from servolink.hub.roles import Role
from servolink.protocol.records import Action, ServoParameter, Step
from servolink.protocol.servos import ALL_SERVOS, SetServoParameterRequest
from servolink.transports.share import Greeting
from servolink.virtual.board import VirtualBoard
from servolink.virtual.kind import BoardKind
from tests.client.fake_board import LOST
from tests.client.sockets import Socket
from tests.hub.control_program import RpcFailed, RpcProgram, Shared, shared
from tests.hub.shared_world import World, on_hub
from tests.virtual_time import run


def test_the_status_says_who_is_connected_and_who_has_the_lease() -> None:
    async def main() -> None:
        async with shared() as here, here.program("studio") as studio, here.program("tablet", "watch"):
            status = await studio.call("status")
            assert (status["name"], status["state"], status["lease"], status["hold"]) == (
                "rex",
                "connected",
                None,
                None,
            )
            programs = [(one["who"], one["door"], one["role"]) for one in status["programs"]]
            assert programs == [("studio", "share", "edit"), ("tablet", "share", "watch")]
            await studio.call("move", targets={"1": 60}, duration=0.1)
            status = await studio.call("status")
            assert status["lease"]["who"] == "studio"

    run(main())


def test_a_program_can_have_tighter_limits_than_the_board() -> None:
    async def main() -> None:
        async with shared() as here, here.program() as far, here.program("near") as near:
            await far.call("limits.tighten", angles={"1": [-30, 30], "all": [-80, 80]}, source="policy")
            await far.call("limits.tighten", speed_cap=90)
            with pytest.raises(RpcFailed, match=r"-30\.\.30 \(from policy\)") as failed:
                await far.call("move", targets={"1": 31}, duration=2)
            assert failed.value.kind == "MotionRefused"
            with pytest.raises(RpcFailed, match=r"-80\.\.80 \(from policy\)"):
                await far.call("move", targets={"2": 81}, duration=2)
            with pytest.raises(RpcFailed, match="its cap is 90"):
                await far.call("move", targets={"2": 10}, duration=0.01)
            await far.call("move", targets={"1": 30}, duration=2, wait=True)
            with pytest.raises(RpcFailed, match="has used the board already"):
                await far.call("limits.tighten", angles={"all": [-90, 90]})
            await far.call("lease.give")
            await near.call("move", targets={"1": 60}, duration=0.1)
            with pytest.raises(RpcFailed, match="'hip' must be a servo id"):
                await near.call("limits.tighten", angles={"hip": [0, 1]})

    run(main())


def test_a_servo_that_does_not_arrive_is_named_and_its_motion_is_not_to_be_repeated() -> None:
    async def main() -> None:
        async with shared() as here, here.program() as studio:
            await studio.call("servo.set", servo=2, start=False, hold=True)
            with pytest.raises(RpcFailed, match=r"servo 2 is at .*, not at 60, 1 s after") as failed:
                await studio.call("move", targets={"1": 60, "2": 60}, duration=0.5, wait=True)
            assert (failed.value.code, failed.value.kind) == (500, "TargetNotReached")

    run(main())


def test_servos_move_by_id_and_by_caption() -> None:
    async def main() -> None:
        async with shared() as here, here.program() as studio:
            moved = await studio.call("move", targets={"1": 60, "2": -20}, duration=0.5, wait=True)
            assert moved == {"seconds": 0.5}
            servos = (await studio.call("servos.list"))["servos"]
            assert [(one["servo_id"], one["angle"], one["angle_unit"]) for one in servos][:2] == [
                (1, 60, "degree"),
                (2, -20, "degree"),
            ]
            await studio.call("release", servo=1)
            await studio.call("servo.set", servo="2", start=False, hold=True)
            servos = (await studio.call("servos.list"))["servos"]
            assert [(one["is_start"], one["is_hold"]) for one in servos] == [
                (False, False),
                (False, True),
                (True, True),
            ]
            await studio.call("release")
            assert not any(one["is_hold"] for one in (await studio.call("servos.list"))["servos"])
            with pytest.raises(RpcFailed, match="no servo 'hip'") as failed:
                await studio.call("move", targets={"hip": 1}, duration=1)
            assert (failed.value.kind, failed.value.code) == ("NotFound", 303)

    run(main())


def test_what_the_board_says_of_itself_can_be_read() -> None:
    async def main() -> None:
        async with shared() as here, here.program("tablet", "watch") as tablet:
            assert (await tablet.call("servos.parameters"))["servos"] == []
            await here.hub.board.add_servo_parameters([ServoParameter(1, -2, "hip")])
            assert (await tablet.call("servos.parameters"))["servos"] == [
                {"servo_id": 1, "adjusted_degree": -2, "servo_caption": "hip"}
            ]
            assert 0 < (await tablet.call("battery"))["percent"] <= 100

    run(main())


@pytest.mark.parametrize(
    ("params", "kind", "text"),
    [
        ({"targets": {"1": 91}, "duration": 1}, "MotionRefused", "91"),
        ({"targets": {"1": 10}}, "EncodeError", "duration"),
        ({"targets": {"1": 10}, "duration": 1, "speed": 1}, "EncodeError", "duration"),
        ({"targets": {"1": 10}, "duration": 0}, "EncodeError", "duration"),
        ({"targets": {}, "duration": 1}, "EncodeError", "target"),
        ({"targets": {"1": "x"}, "duration": 1}, "invalid_params", "targets: '1' must be a number"),
    ],
)
def test_an_impossible_movement_is_refused_with_the_reason(params: Any, kind: str, text: str) -> None:
    async def main() -> None:
        async with shared(angle_limits=(-90, 90)) as here, here.program() as studio:
            before = await here.states()
            with pytest.raises(RpcFailed) as failed:
                await studio.call("move", **params)
            assert failed.value.kind == kind
            assert text in str(failed.value)
            assert [state.angle for state in await here.states()] == [state.angle for state in before]

    run(main())


def test_another_program_is_told_who_has_the_lease_and_how_to_take_it() -> None:
    async def main() -> None:
        async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:
            await tablet.call("status")
            await studio.call("move", targets={"1": 60}, duration=0.1)
            assert (await tablet.until("lease"))["lease"]["who"] == "studio"
            with pytest.raises(RpcFailed, match="moved by studio") as failed:
                await tablet.call("move", targets={"1": 0}, duration=0.1)
            assert failed.value.kind == "MotionRefused"
            assert "lease.take" in failed.value.remedy
            await tablet.call("lease.ask")
            asked = await studio.until("lease", 2)
            assert (asked["event"], asked["by"]) == ("asked for", "tablet")
            taken = await tablet.call("lease.take", force=True)
            assert taken["lease"]["who"] == "tablet"
            over = await studio.until("lease", 3)
            assert (over["event"], over["by"]) == ("taken over", "tablet")
            await tablet.call("move", targets={"1": 0}, duration=0.1)
            assert (await tablet.call("lease.give"))["lease"] is None
            await studio.call("move", targets={"1": 60}, duration=0.1)

    run(main())


def test_a_dead_man_who_stops_to_beat_stops_the_board() -> None:
    async def main() -> None:
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

    run(main())


@pytest.mark.parametrize("greeting", [None, 1.0])
def test_motions_that_wait_are_neither_beats_nor_sent_after_the_stop(greeting: float | None) -> None:
    async def main() -> None:
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

    run(main())


def test_a_stop_ends_what_any_program_asked_for_before_it() -> None:
    async def main() -> None:
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

    run(main())


def test_stops_of_single_servos_end_neither_each_other_nor_what_their_program_asks_for_after_them() -> None:
    async def main() -> None:
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

    run(main())


def test_a_dead_man_time_in_the_greeting_holds_for_each_lease() -> None:
    async def main() -> None:
        async with shared() as here, here.program("studio", dead_man=0.35) as studio:
            await studio.call("move", targets={"1": 90}, duration=10)
            lease = (await studio.call("board.state"))["lease"]
            assert lease["dead_man"] == 0.35
            await asyncio.sleep(0.4)
            assert not any(state.is_start for state in await here.states())

    run(main())


def test_a_stop_passes_everything_from_any_role() -> None:
    async def main() -> None:
        async with shared() as here, here.program("studio") as studio, here.program("tablet", "watch") as tablet:
            moving = studio.begin("move", targets={"1": 90}, duration=10, wait=True)
            await asyncio.sleep(1)
            await tablet.call("stop")
            assert not any(state.is_start for state in await here.states())
            with pytest.raises(RpcFailed):
                await moving
            with pytest.raises(RpcFailed, match="needs the role move"):
                await tablet.call("move", targets={"1": 0}, duration=0.1)

    run(main())


@pytest.mark.parametrize("servos", [[1, 2], None])
@pytest.mark.parametrize("turnaround", [0.0, 0.03, 0.15, 0.25])
def test_a_movement_that_is_ended_stops_where_it_is_and_the_next_one_is_obeyed(servos: Any, turnaround: float) -> None:
    async def main() -> None:
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

    run(main())


def test_a_movement_that_was_not_sent_yet_is_ended_too() -> None:
    async def main() -> None:
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
            with pytest.raises(RpcFailed, match="ended before it began"):
                await moving
            assert here.angle(1) == before

    run(main())


@pytest.mark.parametrize("seconds", [0.0, 0.15])
def test_who_lets_go_undoes_no_stop(seconds: float) -> None:
    async def main() -> None:
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

    run(main())


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
        assert not any(servo.is_start for servo in there.fake.virtual.servos.values())
        await program.channel.close()
        await interface.close()

    on_hub(use)


def test_the_servos_whose_movement_is_ended_are_a_list() -> None:
    async def main() -> None:
        async with shared() as here, here.program() as studio:
            for servos in ("all", 1, [255]):
                with pytest.raises(RpcFailed, match=r"must be a list or null, not|255 is outside 0\.\.254") as failed:
                    await studio.call("move.end", servos=servos)
                assert failed.value.kind == "invalid_params"

    run(main())


def test_who_has_lost_the_lease_ends_no_movement_of_others() -> None:
    async def main() -> None:
        async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:
            await studio.call("move", targets={"1": 30}, duration=0.1)
            await tablet.call("lease.take", force=True)
            await tablet.call("move", targets={"1": 90}, duration=1)
            with pytest.raises(RpcFailed, match=r"nothing was stopped: .* moved by tablet"):
                await studio.call("move.end", servos=[1])
            await asyncio.sleep(2)
            assert here.angle(1) == 90

    run(main())


def test_a_program_that_has_a_board_uses_its_lease_and_hold_and_nothing_more() -> None:
    async def main() -> None:
        async with (
            shared() as here,
            connect(LocalTransport(here.hub, session_id="s", who="script")) as board,
            here.program("script", session="s") as script,
            here.program("tablet") as tablet,
        ):
            await script.call("lease.take")
            await board.move({1: 30}, duration=0.1, wait=True)
            with pytest.raises(RpcFailed, match="moved by script"):
                await tablet.call("move", targets={"1": 0}, duration=0.1)
            for method, params in (
                ("move", {"targets": {"1": 0}, "duration": 0.1}),
                ("limits.tighten", {"speed_cap": 5}),  # would not limit what that board moves
            ):
                with pytest.raises(RpcFailed, match="a board of its own") as failed:
                    await script.call(method, **params)
                assert failed.value.kind == "forbidden"
            assert len((await script.call("status"))["programs"]) == 2
            await script.call("lease.give")
            await tablet.call("move", targets={"1": 0}, duration=0.1)

    run(main())


def test_the_end_of_one_connection_frees_the_board_and_the_end_of_both_ends_the_session() -> None:
    async def main() -> None:
        async with shared() as here, here.program("tablet") as tablet:
            board = await connect(LocalTransport(here.hub, session_id="s", who="script"))
            async with here.program("script", session="s") as script:
                await script.call("board.hold")
            assert here.hub.held_by is None
            async with here.program("script", session="s") as script:
                await script.call("lease.take")
                await board.close()
                assert (await tablet.call("board.state"))["lease"] is None
                for method in ("lease.take", "board.hold"):
                    with pytest.raises(RpcFailed, match="the session has ended") as failed:
                        await script.call(method)
                    assert failed.value.kind == "ConnectionLost"

    run(main())


def test_a_program_that_leaves_while_it_waits_to_have_the_board_alone() -> None:
    async def main() -> None:
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
                assert here.hub.held_by is None

    run(main())


def test_who_has_the_board_alone_makes_the_others_wait() -> None:
    async def main() -> None:
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

    run(main())


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
def test_a_motion_that_waits_for_the_board_ends_with_its_time_and_with_a_stop(method: str, params: Any) -> None:
    async def main() -> None:
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
            await tablet.call(method, **params)  # one that was asked for after the stop

    run(main())


def test_a_motion_is_not_sent_late_or_after_a_stop_even_if_the_board_is_taken_at_the_last_moment() -> None:
    async def main() -> None:
        async with shared() as here, here.program("studio") as studio, here.program("tablet") as tablet:

            async def failure(reason: str, until: float) -> RpcFailed:
                """Return how a motion fails if somebody does something between its check and its way to the board."""
                board = await tablet.channel.control.board()
                release = board.release

                async def taken(which: Any = "all") -> None:
                    if reason == "stop":
                        await here.hub.stop("somebody")
                    elif reason == "hold":
                        await studio.call("board.hold")
                    else:
                        await asyncio.sleep(5)
                    await release(which)

                with pytest.MonkeyPatch.context() as patch:
                    patch.setattr(board, "release", taken)
                    with pytest.raises(RpcFailed) as failed:
                        await tablet.call("release", until=until)
                return failed.value

            clock = asyncio.get_running_loop().time
            assert "a stop came first" in str(await failure("stop", clock() + 60))
            assert "by which it was to begin has passed" in str(await failure("late", clock() + 1))
            assert "studio has taken the board alone" in str(await failure("hold", clock() + 60))
            assert all(state.is_hold for state in await here.states())

    run(main())


def test_a_motion_that_waits_in_the_hub_is_not_sent_after_its_time() -> None:
    async def main() -> None:
        async with shared() as here, here.program("studio") as studio:
            transport = LocalTransport(here.hub, who="script", session_id="s")
            program = transport.join()
            program.bounds = Bounds(here.hub.stops, asyncio.get_running_loop().time() + 1)
            await studio.call("board.hold")
            program.receive(here.hub.board.codec.encode(SetServoParameterRequest(ALL_SERVOS, 0, 0)))
            await asyncio.sleep(2)
            await studio.call("board.release")
            await asyncio.sleep(1)
            assert all(state.is_hold for state in await here.states())
            assert program.counters.refused == 1
            program.leave()

    run(main())


def test_the_hold_and_the_lease_end_with_their_program() -> None:
    async def main() -> None:
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

    run(main())


def test_a_program_that_is_renamed_keeps_its_lease() -> None:
    async def main() -> None:
        async with shared() as here, here.program("tablet") as tablet, here.program("studio") as studio:
            await tablet.call("status")
            await studio.call("lease.take", dead_man=60)
            await studio.call("rename", who="Tablet 2")
            renamed = await tablet.until("program")
            assert (renamed["event"], renamed["who"], renamed["session"]) == (
                "renamed",
                "Tablet 2",
                "session of studio",
            )
            assert (await tablet.call("status"))["lease"]["who"] == "Tablet 2"
            with pytest.raises(RpcFailed, match="Tablet 2"):
                await tablet.call("move", targets={"1": 10}, duration=0.1)
            with pytest.raises(RpcFailed, match="who"):
                await studio.call("rename", who="x" * 201)

    run(main())


def test_programs_go_on_when_the_board_is_plugged_in_again(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        virtual = VirtualBoard(3)
        socket = Socket(virtual)
        monkeypatch.setattr(connecting, "create", socket.transport)
        async with (
            connect("virtual://", reconnect=True, angle_unit=None) as upstream,
            share(upstream, name="rex") as hub,
        ):
            here = Shared(hub, virtual)
            async with here.program("page") as page:
                await page.call("servos.watch", hz=10)
                await page.call("move", targets={"1": 30}, duration=0.1, wait=True)
                socket.pull()
                assert (await page.until("connection"))["state"] == "lost"
                for _ in range(10):
                    with pytest.raises(RpcFailed):
                        await page.call("records.list")
                socket.plug(virtual)
                assert (await page.until("connection", 2))["state"] == "connected"
                count = len(page.of("servos"))
                page.tell("servos.ack", number=count)
                await page.until("servos", count + 1)
                await page.call("move", targets={"1": 60}, duration=0.1, wait=True)
                assert (await page.call("records.list"))["records"] == []
            await here.interface.close()

    run(main())


def test_each_method_says_what_it_does() -> None:
    for method in METHODS.values():
        assert method.summary.endswith("."), method.name
        assert isinstance(method.role, Role)
