"""A hub that stood still, as the computer slept or the process was stopped: nothing moves late, and leases are over."""

from __future__ import annotations

import asyncio
from typing import cast

import pytest

from servolink.control import ProblemNotice, RefusedNotice
from servolink.hub.engine.hub_gates import LONGEST_GAP, SETTLING
from tests.client.piped_board import late, now
from tests.hub.control_program import RpcFailed, shared
from tests.hub.shared_world import MOVE, STOP, world
from tests.support.sleeping import HOUR, Computer, computer, set_wall_clock
from tests.virtual_time import VirtualTimeLoop

__all__ = ["computer"]

MINUTE = 60.0


class Standing:
    """The two ways in which a hub stands still."""

    def __init__(self, way: str, computer: Computer) -> None:
        self._way = way
        self._computer = computer

    def stand(self, seconds: float = HOUR) -> None:
        if self._way == "asleep":
            self._computer.sleep(seconds)
        else:
            cast("VirtualTimeLoop", asyncio.get_running_loop()).stall(seconds)


@pytest.fixture(params=["asleep", "stopped"])
def standing(request: pytest.FixtureRequest, computer: Computer) -> Standing:
    return Standing(request.param, computer)


async def test_motions_that_waited_or_come_right_after_it_are_not_sent(standing: Standing) -> None:
    async with world() as there:
        ann = there.join("ann")
        await asyncio.sleep(0.2)
        there.fake.usual = late(0.05)
        for _ in range(5):
            ann.send(MOVE)
        standing.stand()
        ann.send(MOVE)  # was in the socket already
        await asyncio.sleep(SETTLING - 0.1)
        ann.send(MOVE)
        await asyncio.sleep(SETTLING)
        assert len(there.motions) <= 1  # which was sent before
        reasons = [notice.reason for notice in there.of(RefusedNotice)]
        assert reasons
        assert all("the hub stood still for" in reason for reason in reasons)
        assert len([notice for notice in there.of(ProblemNotice) if "moves nothing" in notice.text]) == 1
        assert await there.move(ann)


async def test_a_stop_gets_through_right_after_it(standing: Standing) -> None:
    async with world() as there:
        ann = there.join("ann")
        standing.stand()
        assert await ann.ask(STOP) is not None


async def test_the_lease_is_over(standing: Standing) -> None:
    async with world() as there:
        ann, bob = there.join("ann"), there.join("bob")
        assert await there.move(ann)
        assert not await there.move(bob)
        standing.stand(MINUTE)
        await asyncio.sleep(1.0 + SETTLING)
        assert there.hub.lease is None
        assert there.lease_events[-1] == "over"
        assert await there.move(bob)


async def test_a_dead_mans_beats_that_waited_do_not_keep_the_lease(standing: Standing) -> None:
    async with world() as there:
        ann = there.join("ann")
        assert there.hub.leases.take(ann.session.session_id, dead_man=0.35)
        standing.stand(MINUTE)
        there.hub.leases.beat(ann.session.session_id)
        assert there.hub.lease is None
        await asyncio.sleep(0.2)
        assert STOP in [packet for _, packet in there.fake.executed]


async def test_a_short_break_is_no_standstill(standing: Standing) -> None:
    async with world() as there:
        ann = there.join("ann")
        standing.stand(LONGEST_GAP / 2)
        assert await there.move(ann)


async def test_a_hub_without_programs_does_not_beat() -> None:
    async with world() as there:
        ann = there.join("ann")
        assert there.hub.standstill._timer is not None
        ann.session.leave()
        assert there.hub.standstill._timer is None


async def test_moves_by_the_control_interface_are_refused_after_it(standing: Standing) -> None:
    async with shared() as here, here.program("ann") as ann:
        move = {"targets": {"1": 40}, "duration": 0.1}
        await ann.call("move", **move)
        standing.stand()
        with pytest.raises(RpcFailed, match="nothing was moved: the hub stood still for") as failed:
            await ann.call("move", **move)
        assert failed.value.kind == "MotionRefused"
        await asyncio.sleep(SETTLING)
        await ann.call("move", **move)


async def test_the_deadline_of_a_request_is_on_the_clock_of_the_event_loop(computer: Computer) -> None:
    async with shared() as here, here.program("ann") as ann:
        move = {"targets": {"1": 40}, "duration": 0.1}
        await ann.call("move", **move, until=now() + 5)
        with pytest.raises(RpcFailed, match="the time by which it was to begin has passed"):
            await ann.call("move", **move, until=now() - 5)


@pytest.mark.parametrize("jump", [HOUR, -HOUR])
async def test_a_wall_clock_that_is_set_changes_nothing(jump: float, monkeypatch: pytest.MonkeyPatch) -> None:
    async with world() as there:
        ann, bob = there.join("ann"), there.join("bob")
        assert await there.move(ann)
        set_wall_clock(monkeypatch, jump)
        assert there.hub.lease is not None
        assert not await there.move(bob)
        assert await there.move(ann)
        await asyncio.sleep(20)
        assert there.lease_events == ["taken", "over"]
