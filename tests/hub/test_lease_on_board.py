"""The motion lease and stops through a hub: what reaches the board, when, and what each program gets.

Module: servolink.hub.engine.lease_keeper.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from msgspec import Struct

from servolink.boards import SafetyLimits
from servolink.client import connect
from servolink.control import LeaseNotice, ProblemNotice, RefusedNotice, Role
from servolink.hub.hub import share
from servolink.protocol import (
    ALL_SERVOS,
    AddServoParameterRequest,
    AddServoParameterResponse,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    Packet,
    QueryServoListRequest,
    QueryServoRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
)
from servolink.virtual import VirtualBoard
from tests.client.piped_board import LOST, late, now
from tests.client.sockets import Socket
from tests.hub.raw_program import RawProgram
from tests.hub.shared_world import MOVE, START, STOP, World, on_hub, world
from tests.plugged import plugged

RELEASE = SetServoParameterRequest(1, 0, 0)
MOTIONS: list[Packet] = [
    MOVE,
    ExecuteActionExRequest(1),
    ExecuteMacroRequest(1),
    START,
    RELEASE,
    AddServoParameterRequest(()),
]


# --- one holder -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("packet", MOTIONS)
def test_motion_without_the_lease_is_refused_as_a_board_would(packet: Packet) -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("servolink teach"), there.join("bob")
        assert await there.move(ann)
        assert not await there.move(bob, packet)
        refused = there.of(RefusedNotice)
        assert [one.packet for one in refused] == [type(packet).__name__]
        assert there.sessions_of(RefusedNotice) == [bob.session.session_id]
        assert "the servos of rex are moved by servolink teach" in refused[0].reason
        assert "servolink share --take rex" in refused[0].reason
        assert (bob.session.counters.refused, ann.session.counters.refused) == (1, 0)
        expected: dict[Any, list[Packet]] = {
            ExecuteMacroRequest: [ExecuteMacroResponse(0)],
            AddServoParameterRequest: [AddServoParameterResponse(0)],
            SetServoParameterRequest: [SetServoParameterResponse(1, 1, 1)],
        }
        assert bob.heard == expected.get(type(packet), [])

    on_hub(use)


@pytest.mark.parametrize(
    ("packet", "seconds"),
    [(MOVE, 2.0), (ExecuteActionExRequest(1), 3.0), (ExecuteMacroRequest(1), 4.0)],
)
def test_the_lease_ends_10_s_after_the_computed_end(packet: Packet, seconds: float) -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        assert await there.move(ann, packet)
        await asyncio.sleep(seconds + 10 - 0.5)
        assert not await there.move(bob)
        await asyncio.sleep(0.2)
        assert await there.move(bob)
        assert there.lease_events == ["taken", "over", "taken"]

    on_hub(use)


@pytest.mark.parametrize("packet", [START, RELEASE, AddServoParameterRequest(())])
def test_the_lease_for_a_motion_of_unknown_end_lasts_until_the_servos_have_rested(packet: Packet) -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        there.fake.servos[2].move(90, 30.0, now())  # something else turns, for 30 s
        assert await there.move(ann, packet)
        await asyncio.sleep(39)
        assert not await there.move(bob)
        await asyncio.sleep(5)
        assert await there.move(bob)

    on_hub(use)


def test_a_later_motion_of_unknown_end_is_waited_for_too() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        await there.move(ann, START)
        await asyncio.sleep(1.6)
        await there.move(ann, START)  # shortly before the servos have rested long enough
        there.fake.servos[2].move(90, 30.0, now())
        await asyncio.sleep(35)
        assert not await there.move(bob)

    on_hub(use)


def test_each_motion_makes_the_lease_last_longer() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        for _ in range(5):
            assert await there.move(ann)
            await asyncio.sleep(9)
        assert not await there.move(bob)
        ann.session.leave()
        assert await there.move(bob)
        assert there.lease_events == ["taken", "left", "taken"]
        assert there.fake.executed_of(SetServoParameterRequest) == []  # what ann began ends by itself

    on_hub(use)


def test_the_lease_is_given_back_asked_for_and_taken_over_openly() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        first, second = ann.session.session_id, bob.session.session_id
        await there.move(ann)
        there.hub.leases.ask(second)
        assert not there.hub.leases.take(second)
        assert there.hub.leases.take(second, force=True)
        assert await there.move(bob)
        assert not await there.move(ann)
        there.hub.leases.give(first)  # which it has not got any more
        assert there.hub.status().lease is not None
        there.hub.leases.give(second)
        assert there.hub.status().lease is None
        changes = there.of(LeaseNotice)
        assert [(change.event, change.by, change.lease and change.lease.session) for change in changes] == [
            ("taken", "ann", first),
            ("asked for", "bob", first),
            ("taken over", "bob", second),
            ("given back", None, None),
        ]
        assert there.sessions_of(LeaseNotice) == [first, second, second, ""]

    on_hub(use)


def test_what_still_waits_when_the_lease_is_taken_over_is_not_sent() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        await there.move(ann)
        there.fake.plan(QueryServoListRequest, late(1.0))
        bob.send(QueryServoListRequest())
        await asyncio.sleep(0.1)
        ann.send(MOVE)  # waits behind the slow query
        await asyncio.sleep(0.1)
        there.hub.leases.take(bob.session.session_id, force=True)
        await asyncio.sleep(3)
        assert len(there.motions) == 1

    on_hub(use)


def test_a_motion_is_not_sent_if_the_lease_is_lost_while_it_waits_for_its_units() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob", unit="adc")
        there.fake.plan(QueryServoRequest, late(1.0))
        bob.send(QueryServoRequest(1))
        await asyncio.sleep(0.1)
        ann.send(MOVE)
        await asyncio.sleep(0.1)
        there.hub.leases.take(bob.session.session_id, force=True)
        await asyncio.sleep(3)
        assert there.motions == []
        assert there.sessions_of(RefusedNotice) == [ann.session.session_id]

    on_hub(use, depth=4)


@pytest.mark.parametrize(
    ("packet", "limits", "seconds"),
    [
        (MOVE, SafetyLimits(speed_cap=60), 0.2),  # while the servos are read
        (ExecuteMacroRequest(1), SafetyLimits(speed_cap=60), 0.2),
        (ExecuteActionExRequest(1), SafetyLimits(soft_start=10), 4.0),  # while they go softly to the first pose
    ],
)
def test_a_motion_is_not_sent_if_the_lease_is_lost_while_it_is_checked(
    packet: Packet, limits: SafetyLimits, seconds: float
) -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        there.fake.usual_of[QueryServoRequest] = late(0.4)
        ann.send(packet)
        await asyncio.sleep(seconds)
        before = len(there.motions)
        there.hub.leases.take(bob.session.session_id, force=True)
        await asyncio.sleep(20)
        assert len(there.motions) == before
        assert ["moved by bob" in one.reason for one in there.of(RefusedNotice)] == [True]
        there.hub.leases.give(bob.session.session_id)
        ann.send(packet)
        await asyncio.sleep(20)
        assert isinstance(there.motions[-1], type(packet))

    on_hub(use, limits)


@pytest.mark.parametrize("packet", [ExecuteActionExRequest(1), ExecuteMacroRequest(1)])
def test_a_soft_start_whose_lease_is_taken_away_is_refused_with_the_reason(packet: Packet) -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        ann.send(packet)
        await asyncio.sleep(1)
        assert len(there.motions) == 1
        there.hub.leases.take(bob.session.session_id, force=True)
        bob.send(START)  # which no soft start comes before
        await asyncio.sleep(20)
        assert there.motions[1:] == [START]
        (refused,) = there.of(RefusedNotice)
        assert "was not run: the servos of rex are moved by bob" in refused.reason
        assert "have not reached" not in refused.reason

    on_hub(use, SafetyLimits(soft_start=10))


@pytest.mark.parametrize("packet", [ExecuteActionExRequest(1), MOVE, START])
@pytest.mark.parametrize("seconds", [0.0, 0.003, 1.0])
def test_a_program_that_has_left_neither_moves_nor_takes_the_lease(packet: Packet, seconds: float) -> None:
    async def use(there: World) -> None:
        ann = there.join("ann")
        there.fake.usual_of[QueryServoRequest] = late(1.5)
        ann.send(packet)
        await asyncio.sleep(seconds)
        before = len(there.motions)
        ann.session.leave()
        assert there.hub.lease is None
        await asyncio.sleep(20)
        assert len(there.motions) == before
        assert there.hub.lease is None

    on_hub(use, SafetyLimits(soft_start=10))


# --- stop -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("servo_id", [1, ALL_SERVOS])
def test_anybody_stops_before_everything_that_waits(servo_id: int) -> None:
    async def use(there: World) -> None:
        ann, watcher = there.join("ann"), there.join("watcher", role=Role.WATCH)
        await there.move(ann)
        there.fake.usual_of[QueryServoListRequest] = late(0.2)
        for _ in range(20):
            ann.send(QueryServoListRequest())
        ann.send(MOVE)
        await asyncio.sleep(0.05)
        asked = now()
        response = await watcher.ask(SetServoParameterRequest(servo_id, 0, 1))
        assert response == SetServoParameterResponse(servo_id, 0, 1)
        assert there.fake.sent_of(SetServoParameterRequest) == [asked]
        await asyncio.sleep(8)
        assert len(there.motions) == 1
        assert [one.reason for one in there.of(RefusedNotice)] == ["a stop came first"]
        assert there.hub.lease is not None
        assert there.hub.lease.who == "ann"

    on_hub(use)


def test_a_stop_of_one_servo_does_not_end_the_motion_of_others() -> None:
    async def use(there: World) -> None:
        ann, bob = there.join("ann"), there.join("bob")
        await there.move(ann, ExecuteActionRequest((Step(1, 30, 3000), Step(2, 30, 3000))))
        assert await bob.ask(SetServoParameterRequest(1, 0, 1)) is not None
        await asyncio.sleep(38)
        assert not await there.move(bob)

    on_hub(use)


# --- dead man ---------------------------------------------------------------------------------------------------------


def stops(there: World) -> list[float]:
    """Return when the board got a stop."""
    return [at for at, packet in there.fake.executed if packet == STOP]


@pytest.mark.parametrize("programs", [0, 8])
def test_the_board_stops_within_400_ms_of_the_last_beat(programs: int) -> None:
    async def use(there: World) -> None:
        studio = there.join("studio")
        there.fake.usual_of[QueryServoListRequest] = late(0.05)
        for number in range(programs):  # a line that is never free
            other = there.join(f"program {number}")
            for _ in range(60):
                other.send(QueryServoListRequest())
        assert there.hub.leases.take(studio.session.session_id, dead_man=0.35)
        studio.send(ExecuteActionRequest((Step(1, 90, 3000),)))
        for _ in range(20):
            await asyncio.sleep(0.1)
            there.hub.leases.beat(studio.session.session_id)
        last_beat = now()
        assert stops(there) == []
        await asyncio.sleep(5)
        assert len(stops(there)) == 1
        assert stops(there)[0] - last_beat <= 0.4
        assert there.lease_events == ["taken", "beats stopped"]
        assert there.hub.lease is None
        assert not any(servo.moving for servo in there.fake.servos.values())

    on_hub(use)


def test_a_holder_with_a_dead_man_time_that_vanishes_stops_the_board_at_once() -> None:
    async def use(there: World) -> None:
        studio = there.join("studio")
        there.hub.leases.take(studio.session.session_id, dead_man=0.35)
        await there.move(studio, ExecuteActionRequest((Step(1, 90, 3000),)))
        there.hub.leases.beat(studio.session.session_id)
        left = now()
        studio.session.leave()
        await asyncio.sleep(5)
        assert stops(there)[0] - left <= 0.01
        assert len(stops(there)) == 1

    on_hub(use)


@pytest.mark.parametrize("dead_man", [None, 0.35])
async def test_a_hub_that_ends_stops_the_board_only_if_somebody_watched_over_it(dead_man: float | None) -> None:
    async with world() as there:
        studio = there.join("studio")
        there.hub.leases.take(studio.session.session_id, dead_man=dead_man)
        await there.move(studio, ExecuteActionRequest((Step(1, 90, 3000),)))
    assert len(stops(there)) == (dead_man is not None)


async def test_a_board_that_cannot_be_stopped_is_stopped_when_it_is_back(monkeypatch: pytest.MonkeyPatch) -> None:
    virtual = VirtualBoard(2)
    socket = Socket(virtual)
    url = plugged(monkeypatch, socket.transport)
    async with (
        connect(url, reconnect=True, angle_unit=None) as board,
        share(board, name="rex") as hub,
    ):
        notices: list[Struct] = []
        hub.listen(lambda notice, session: notices.append(notice))
        studio = RawProgram(hub, "studio")
        hub.leases.take(studio.session.session_id, dead_man=0.35)
        studio.send(ExecuteActionRequest((Step(1, 90, 3000),)))
        await asyncio.sleep(0.1)
        socket.pull()
        await asyncio.sleep(5)
        assert virtual.servos[1].is_start
        socket.plug(virtual)
        await asyncio.sleep(10)
        assert not virtual.servos[1].is_start
        assert [notice.text for notice in notices if isinstance(notice, ProblemNotice)] == [
            "studio has gone silent: the board is stopped as soon as it is connected again"
        ]


def test_a_stop_that_cannot_be_confirmed_is_reported() -> None:
    async def use(there: World) -> None:
        studio = there.join("studio")
        there.hub.leases.take(studio.session.session_id, dead_man=0.35)
        await there.move(studio)
        there.fake.usual_of[QueryServoRequest] = LOST
        await asyncio.sleep(10)
        assert ["could not be confirmed" in problem.text for problem in there.of(ProblemNotice)] == [True]

    on_hub(use)
