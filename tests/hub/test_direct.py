"""Programs in the process of the hub, whose packets do not become bytes.

Modules: servolink.connection.packet_connection, servolink.hub.doors.direct.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from servolink.control import Role
from servolink.errors import (
    ConnectionLost,
    EncodeError,
    OutcomeUnknown,
    RequestRefused,
    RequestTimeout,
)
from servolink.hub.doors.direct import DirectProgram
from servolink.hub.engine.hub_gates import LeaseRefused, MotionOver
from servolink.protocol import (
    ButtonEventResponse,
    Codec,
    ExecuteActionRequest,
    Packet,
    QueryActionRequest,
    QueryProjectIDRequest,
    QueryServoListRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    Step,
    SubscribeButtonEventRequest,
    WriteProjectIDRequest,
)
from tests.client.piped_board import LOST, SWALLOWED, late, now
from tests.hub.shared_world import MOVE, START, STOP, World
from tests.hub.shared_world import on_hub as on_world

HERE = "here"


def on_hub(use: Callable[[World, DirectProgram], Awaitable[None]]) -> None:
    async def main(there: World) -> None:
        await use(there, DirectProgram(there.hub, who=HERE))

    on_world(main)


def test_a_packet_is_encoded_once_and_its_response_decoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[str] = []

    def encode(self: Codec, packet: Packet, *, unchecked: bool = False) -> bytes:
        encoded.append(type(packet).__name__)
        return real(self, packet, unchecked=unchecked)

    async def use(there: World, here: DirectProgram) -> None:
        await here.request(SetAngleUnitRequest(255, 0))
        monkeypatch.setattr(Codec, "encode", encode)
        await here.send(MOVE)
        await here.request(WriteProjectIDRequest(7))
        assert (await here.request(QueryProjectIDRequest())).project_id == 7
        # The fake board encodes its responses.
        assert [name for name in encoded if "Response" not in name] == [
            "ExecuteActionRequest",
            "WriteProjectIDRequest",
            "QueryProjectIDRequest",
        ]

    real = Codec.encode
    on_hub(use)


def test_a_refusal_is_an_error_of_its_own_kind() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        bob = there.join("bob")
        assert await there.move(bob)
        with pytest.raises(LeaseRefused, match=r"^nothing was moved: the servos of rex are moved by bob"):
            await here.send(MOVE)
        with pytest.raises(LeaseRefused):
            await here.request(START)
        watcher = DirectProgram(there.hub, who="watcher", role=Role.WATCH)
        with pytest.raises(RequestRefused, match="WriteProjectIDRequest needs the role edit"):
            await watcher.request(WriteProjectIDRequest(1))
        with pytest.raises(EncodeError, match="interval: -1 is outside"):
            await here.send(ExecuteActionRequest((Step(1, 1, -1),)))
        assert len(there.motions) == 1
        assert there.hub.status().programs[0].refused == 3

    on_hub(use)


def test_a_stop_passes_every_gate_and_ends_earlier_motions() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        bob, ticket = there.join("bob"), here.stops.ticket()
        there.hub.begin_exclusive_use(bob.session.session_id, "testing")
        with pytest.raises(MotionOver, match="bob has taken exclusive use of the board"):
            await here.send(MOVE)
        assert await here.send_stop(STOP)
        await here.request(SetServoParameterRequest(1, 0, 1))
        there.hub.end_exclusive_use(bob.session.session_id)
        with pytest.raises(MotionOver, match=r"^nothing was moved: a stop came first"):
            await here.send(MOVE, ticket=ticket)
        with pytest.raises(MotionOver, match="the time by which it was to begin has passed"):
            await here.send(MOVE, ticket=here.stops.ticket(until=now() - 1))
        assert there.motions == []

    on_hub(use)


def test_a_motion_on_its_way_is_not_sent_after_a_stop_of_another_program() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        await here.request(SetAngleUnitRequest(255, 0))
        bob = there.join("bob")
        there.fake.plan(QueryServoListRequest, late(1.0))
        bob.send(QueryServoListRequest())
        await asyncio.sleep(0.1)
        moving = asyncio.create_task(here.send(MOVE))
        await asyncio.sleep(0.1)
        await there.hub.stop("somebody")
        with pytest.raises(MotionOver, match="nothing was moved: a stop came first"):
            await moving
        assert there.motions == []

    on_hub(use)


def test_what_the_board_does_not_answer_fails_as_on_another_connection() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        there.fake.usual_of[QueryActionRequest] = SWALLOWED
        with pytest.raises(RequestTimeout):
            await here.request(QueryActionRequest(1))
        there.fake.plan(SetServoParameterRequest, LOST)
        with pytest.raises(OutcomeUnknown):
            await here.request(START)
        there.fake.usual_of[QueryActionRequest] = late(2.0)
        begun = now()
        with pytest.raises(RequestTimeout):
            await here.request(QueryActionRequest(1), timeout=0.5)
        assert now() == pytest.approx(begun + 0.5)

    on_hub(use)


def test_what_waits_while_another_program_has_the_board_is_given_up_and_never_sent() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        bob = there.join("bob")
        there.hub.begin_exclusive_use(bob.session.session_id, "testing")
        begun = now()
        with pytest.raises(RequestTimeout, match="bob has exclusive use of the board"):
            await here.request(WriteProjectIDRequest(9))
        assert now() == pytest.approx(begun + here.patience + 1)
        cancelled = asyncio.create_task(here.request(WriteProjectIDRequest(8)))
        await asyncio.sleep(0.1)
        assert here.queue.exchanges
        cancelled.cancel()
        await asyncio.wait([cancelled])
        assert not here.queue.exchanges
        there.hub.end_exclusive_use(bob.session.session_id)
        await asyncio.sleep(1)
        assert not there.fake.executed_of(WriteProjectIDRequest)

    on_hub(use)


def test_button_events_arrive() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        events: list[ButtonEventResponse] = []
        here.answers.on_event = events.append
        await here.request(SubscribeButtonEventRequest(1))
        event = ButtonEventResponse(3, ButtonEventResponse.PRESS)
        there.hub._deliver(event)
        assert events == [event]

    on_hub(use)


def test_the_end_of_the_hub_ends_what_waits() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        ends: list[ConnectionLost] = []
        here.answers.on_end = ends.append
        there.fake.usual_of[QueryServoRequest] = late(2.0)
        asking = asyncio.create_task(here.request(QueryServoRequest(1)))
        await asyncio.sleep(0.1)
        await there.hub.close()
        with pytest.raises(ConnectionLost, match="the hub has ended"):
            await asking
        with pytest.raises(ConnectionLost, match="the hub has ended"):
            await here.send(MOVE)
        await here.close()
        assert len(ends) == 1

    on_hub(use)


def test_a_session_id_is_used_once() -> None:
    async def use(there: World, here: DirectProgram) -> None:
        with pytest.raises(ValueError, match="has begun already"):
            DirectProgram(there.hub, who=HERE, session_id=here.session_id)
        await here.close()
        assert here.session_id not in there.hub.programs
        DirectProgram(there.hub, who=HERE, session_id=here.session_id)

    on_hub(use)
