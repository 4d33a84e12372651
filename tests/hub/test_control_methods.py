"""What programs can do through the control interface of a hub.

Module: servolink.hub.methods.methods.
"""

from __future__ import annotations

from typing import Any

import pytest

from servolink.client import connect
from servolink.control import Role
from servolink.hub.hub import share
from servolink.hub.methods.control_session import METHODS
from servolink.protocol import ServoParameter
from servolink.virtual import VirtualBoard
from tests.client.sockets import Socket
from tests.hub.control_program import RpcFailed, Shared, shared
from tests.hub.local_transport import LocalTransport
from tests.plugged import plugged


async def test_the_status_says_who_is_connected_and_who_has_the_lease() -> None:
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


async def test_a_program_can_have_tighter_limits_than_the_board() -> None:
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


async def test_a_servo_that_does_not_arrive_is_named_and_its_motion_is_not_to_be_repeated() -> None:
    async with shared() as here, here.program() as studio:
        here.virtual.servos[2].is_start = False
        with pytest.raises(RpcFailed, match=r"servo 2 is at .*, not at 60, 1 s after") as failed:
            await studio.call("move", targets={"1": 60, "2": 60}, duration=0.5, wait=True)
        assert (failed.value.code, failed.value.kind) == (500, "TargetNotReached")


async def test_servos_move_by_id_and_by_caption() -> None:
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


async def test_what_the_board_says_of_itself_can_be_read() -> None:
    async with shared() as here, here.program("tablet", "watch") as tablet:
        assert (await tablet.call("servos.parameters"))["servos"] == []
        await here.hub.board.add_servo_parameters([ServoParameter(1, -2, "hip")])
        assert (await tablet.call("servos.parameters"))["servos"] == [
            {"servo_id": 1, "adjusted_degree": -2, "servo_caption": "hip"}
        ]
        assert 0 < (await tablet.call("battery"))["percent"] <= 100


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
async def test_an_impossible_movement_is_refused_with_the_reason(params: Any, kind: str, text: str) -> None:
    async with shared(angle_limits=(-90, 90)) as here, here.program() as studio:
        before = await here.states()
        with pytest.raises(RpcFailed) as failed:
            await studio.call("move", **params)
        assert failed.value.kind == kind
        assert text in str(failed.value)
        assert [state.angle for state in await here.states()] == [state.angle for state in before]


async def test_another_program_is_told_who_has_the_lease_and_how_to_take_it() -> None:
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


async def test_a_program_that_has_a_board_uses_its_lease_and_hold_and_nothing_more() -> None:
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


async def test_a_program_that_is_renamed_keeps_its_lease() -> None:
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


async def test_programs_go_on_when_the_board_is_plugged_in_again(monkeypatch: pytest.MonkeyPatch) -> None:
    virtual = VirtualBoard(3)
    socket = Socket(virtual)
    url = plugged(monkeypatch, socket.transport)
    async with (
        connect(url, reconnect=True, angle_unit=None) as upstream,
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


def test_each_method_says_what_it_does() -> None:
    for method in METHODS.values():
        assert method.summary.endswith("."), method.name
        assert isinstance(method.role, Role)
