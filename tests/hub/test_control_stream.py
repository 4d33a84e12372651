"""Streams of set-points through a hub: on the control interface, and from a board on share://.

Modules: servolink.control.tightening, servolink.hub.methods.motion_methods.
"""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest

from servolink.client import connect
from servolink.control import Tighten
from servolink.errors import MotionRefused, Reason, RequestRefused, ServolinkError
from servolink.hub.hub import Hub
from servolink.hub.methods.control_session import ControlInterface
from servolink.motion import Degrees, MotionLimits, motion_limits
from servolink.virtual import VirtualBoard
from tests.hub.control_program import RpcFailed, Shared, shared
from tests.hub.door_hub import on_hub, sharing


def at_zero(here: Shared) -> None:
    """Let all servos stand at 0 degrees."""
    for servo in here.virtual.servos.values():
        servo.angle = 0.0


async def test_set_points_are_kept_to_the_limits_of_the_board_and_of_the_program() -> None:
    async with shared(angle_limits=(-80, 80)) as here, here.program("pad") as pad:
        await pad.call("limits.tighten", angles={"2": [-10, 10]}, source="the stage")
        more = [{"angles": {"3": [0, 5]}}]
        number = (await pad.call("stream.begin", hz=100, limits=more))["stream"]
        sent = await pad.call("stream.send", stream=number, targets={"1": 300, "2": 300.5, "3": -3})
        assert sent == {"sent": {"1": 80, "2": 10, "3": 0}}
        assert here.hub.lease is not None
        assert here.hub.lease.who == "pad"
        await asyncio.sleep(0.1)
        assert [round(here.angle(servo_id)) for servo_id in (1, 2, 3)] == [80, 10, 0]


async def test_a_way_too_long_for_the_cap_is_shortened_by_the_hub() -> None:
    async with shared(speed_cap=100) as here, here.program("pad") as pad:
        at_zero(here)
        number = (await pad.call("stream.begin", limits=[{"speed_caps": {"2": 50}}]))["stream"]
        angles = list[tuple[int, int]]()
        for _ in range(50):
            sent = (await pad.call("stream.send", stream=number, targets={"1": 170, "2": -170}))["sent"]
            angles.append((sent["1"], sent["2"]))
        assert angles[0] == (7, -3)
        assert 85 <= angles[-1][0] <= 110
        assert -55 <= angles[-1][1] <= -40
        assert here.hub.programs["session of pad"].counters.refused == 0


async def test_a_servo_outside_its_limits_comes_back_by_small_moves_and_by_a_stream() -> None:
    async with shared(angle_limits=(-90, 90), speed_cap=200) as here, here.program("pad") as pad:
        here.virtual.servos[1].angle = 170.0
        for angle in (172, 150):
            with pytest.raises(RpcFailed, match=r"outside its limits -90\.\.90"):
                await pad.call("move", targets={"1": angle}, duration=1)
        await pad.call("move", targets={"1": 161}, duration=1, wait=True)
        number = (await pad.call("stream.begin"))["stream"]
        sent = [await pad.call("stream.send", stream=number, targets={"1": 170}) for _ in range(40)]
        assert sent[-1] == {"sent": {"1": 90}}


async def test_of_set_points_that_come_too_fast_the_latest_is_sent() -> None:
    async with shared() as here, here.program("pad") as pad:
        number = (await pad.call("stream.begin", hz=10))["stream"]
        sending = [pad.begin("stream.send", stream=number, targets={"1": angle}) for angle in range(20)]
        sent = [(await one)["sent"] for one in sending]
        assert sent[-1] == {"1": 19}
        assert sum(map(bool, sent)) <= 2


@pytest.mark.parametrize("stop", ["stop", "move.end"])
async def test_a_stop_of_anybody_ends_a_stream(stop: str) -> None:
    async with shared() as here, here.program("pad") as pad, here.program("tablet", "watch") as tablet:
        number = (await pad.call("stream.begin"))["stream"]
        await pad.call("stream.send", stream=number, targets={"1": 10})
        await (tablet if stop == "stop" else pad).call(stop)
        for _ in range(2):
            with pytest.raises(RpcFailed, match="nothing was moved: a stop came first"):
                await pad.call("stream.send", stream=number, targets={"1": 90})
        await pad.call("servo.set", servo=1, start=True, hold=True)
        number = (await pad.call("stream.begin"))["stream"]
        assert await pad.call("stream.send", stream=number, targets={"1": 90}) == {"sent": {"1": 90}}


async def test_a_gap_and_a_newer_stream_end_a_stream() -> None:
    async with shared() as here, here.program("pad") as pad:
        first = (await pad.call("stream.begin", gap=0.2))["stream"]
        await pad.call("stream.send", stream=first, targets={"1": 10})
        await asyncio.sleep(0.3)
        with pytest.raises(RpcFailed, match=r"no set-point was given for more than 0\.2 s; begin another"):
            await pad.call("stream.send", stream=first, targets={"1": 20})
        second = (await pad.call("stream.begin"))["stream"]
        with pytest.raises(RpcFailed, match="this program has no stream 1; begin one"):
            await pad.call("stream.send", stream=first, targets={"1": 20})
        assert await pad.call("stream.send", stream=second, targets={"1": 20}) == {"sent": {"1": 20}}


async def test_a_stream_needs_role_lease_and_a_board_that_nobody_has_exclusively() -> None:
    async with shared() as here, here.program("script") as script, here.program("pad") as pad:
        async with here.program("tablet", "watch") as tablet:
            with pytest.raises(RpcFailed, match="needs the role move"):
                await tablet.call("stream.begin")
        number = (await pad.call("stream.begin"))["stream"]
        await script.call("lease.take")
        with pytest.raises(RpcFailed, match="moved by script") as refused:
            await pad.call("stream.send", stream=number, targets={"1": 20})
        assert refused.value.kind == "MotionRefused"
        assert "lease.ask" in refused.value.remedy
        await script.call("lease.give")
        await script.call("board.hold")
        with pytest.raises(RpcFailed, match="script has taken exclusive use of the board"):
            await pad.call("stream.send", stream=number, targets={"1": 20})
        await script.call("board.release")
        assert await pad.call("stream.send", stream=number, targets={"1": 20}) == {"sent": {"1": 20}}
        fast = [pad.begin("stream.send", stream=number, targets={"1": angle}) for angle in (10, 40)]
        await script.call("board.hold")  # while the second one waits for its turn
        assert await fast[0] == {"sent": {}}
        with pytest.raises(RpcFailed, match="script has taken exclusive use of the board"):
            await fast[1]


@pytest.mark.parametrize(
    ("targets", "kind"),
    [({"9": 1}, "NotFound"), ({"1": 1e9}, "EncodeError"), ({}, "EncodeError"), ({"999": 1}, "EncodeError")],
)
async def test_wrong_set_points_are_refused_with_one_typed_error(targets: dict[str, float], kind: str) -> None:
    async with shared() as here, here.program("pad") as pad:
        number = (await pad.call("stream.begin"))["stream"]
        with pytest.raises(RpcFailed) as refused:
            await pad.call("stream.send", stream=number, targets=targets)
        assert refused.value.kind in {kind, "MotionRefused"}
        assert await pad.call("stream.send", stream=number, targets={"1": 20}) == {"sent": {"1": 20}}


@pytest.mark.parametrize("params", [{"hz": 0}, {"hz": 101}, {"hz": 50, "gap": 0.02}, {"gap": 11}])
async def test_an_impossible_stream_is_refused(params: dict[str, float]) -> None:
    async with shared() as here, here.program("pad") as pad:
        with pytest.raises(RpcFailed) as refused:
            await pad.call("stream.begin", **params)
        assert refused.value.kind == "invalid_params"


@pytest.mark.parametrize(
    "limits",
    [
        motion_limits((-80, math.inf), 100, 20, "an argument"),
        motion_limits({1: (-80, 80), 7: (0, 5.5)}, {1: 50, 2: math.inf}),
        motion_limits((-80, 80)).tightened(motion_limits({1: (0, 200)}, 30)),
    ],
)
def test_limits_survive_the_way_to_the_hub(limits: MotionLimits) -> None:
    found = MotionLimits()
    for message in Tighten.messages(limits):
        found = found.tightened(message.limits())
    for servo_id in (1, 2, 7):
        low, high = limits.of(servo_id) or (-32768, 32767)
        assert (found.of(servo_id) or (-32768, 32767)) == (low, min(high, 32767))
        cap = limits.cap_of(servo_id)
        assert found.cap_of(servo_id) == (None if cap == math.inf else cap)
        assert found.soft_speed_of(servo_id) == limits.soft_speed_of(servo_id)
    with pytest.raises(ValueError, match="must be a servo id"):
        Tighten(speed_caps={"all": 5}).limits()


def test_a_board_on_share_streams_through_the_hub_within_its_own_limits_too() -> None:
    async def use(hub: Hub, virtual: VirtualBoard) -> None:
        interface = ControlInterface(hub)
        for servo in virtual.servos.values():
            servo.angle = 0.0
        async with sharing(hub, interface.open_channel) as url:
            async with connect(url, angle_limits={2: (-10, 10)}, speed_cap=500) as board, connect(url) as other:
                stream = board.stream(hz=100)
                sent = await stream.send({1: Degrees(170), 2: 170, 3: -170.4})
                assert sent == {1: 30, 2: 10, 3: -30}
                with pytest.raises(MotionRefused, match="are moved by"):
                    await other.stream().send({1: 5})
                await other.stop()
                with pytest.raises(ServolinkError, match="stop") as stopped:
                    await stream.send({1: 0})
                assert stopped.value.reason is Reason.STOP
                with pytest.raises(RequestRefused, match="servo 1 is stopped or released"):  # as the stream would be
                    await board.move({1: 5}, duration=0.1)
                assert (await board.move({1: 5}, duration=0.1, dry_run=True, start=True)) == 0.1
            async with connect(f"{url}?role=watch") as watcher:
                with pytest.raises(RequestRefused, match="needs the role move"):
                    await watcher.stream().send({1: 5})
        await interface.close()

    options: dict[str, Any] = {"angle_limits": (-80, 80)}
    on_hub(use, **options)
