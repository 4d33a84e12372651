"""What ends or interrupts the use of a shared board: other programs, losses, refusals, and the end of the hub.

Modules: servolink.hub.engine.upstream, servolink.hub.hub.
"""

from __future__ import annotations

import asyncio

import pytest
from msgspec import Struct

from servolink.client import connect
from servolink.control import HoldNotice, RefusedNotice
from servolink.errors import OpenError, WrongBoard
from servolink.hub.hub import Hub, share
from servolink.motion import Ticket
from servolink.protocol import (
    ClearAllDataRequest,
    ClearAllDataResponse,
    Packet,
    QueryActionListRequest,
    QueryActionListResponse,
    QueryActionRequest,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    SetServoParameterRequest,
    SetServoParameterResponse,
    SubscribeButtonEventRequest,
    SubscribeButtonEventResponse,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from tests.client.piped_board import LOST, PipedBoard, late, lie
from tests.hub.fake_board_hub import START, STOP, kinds, on_hub, shared
from tests.hub.local_transport import LocalTransport
from tests.hub.raw_program import RawProgram


def test_while_a_program_holds_the_board_others_wait() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other = RawProgram(hub, "one"), RawProgram(hub)
        assert hub.begin_exclusive_use(one.session.session_id, "an import")
        assert not hub.begin_exclusive_use(other.session.session_id, "an import")
        other.send(QueryServoListRequest())
        assert await one.ask(QueryProjectIDRequest()) is not None
        assert await other.ask(STOP) is None  # done, and behind the query that waits
        assert fake.executed_of(SetServoParameterRequest) == [STOP]
        assert other.heard == []
        one.session.leave()
        await asyncio.sleep(0.1)
        assert kinds(other.heard) == [QueryServoListResponse, SetServoParameterResponse]

    on_hub(use)


def test_while_everything_is_deleted_others_wait_and_are_told() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other, notices = RawProgram(hub, "one"), RawProgram(hub), list[Struct]()
        hub.listen(lambda notice, session: notices.append(notice))
        fake.plan(ClearAllDataRequest, late(10))
        one.send(ClearAllDataRequest())
        await asyncio.sleep(1)
        assert hub.exclusive_use is not None
        assert (hub.exclusive_use.who, hub.exclusive_use.reason) == ("one", "it sends ClearAllDataRequest")
        other.send(QueryActionListRequest())
        await asyncio.sleep(8)
        assert fake.executed_of(QueryActionListRequest) == []
        await asyncio.sleep(2)
        assert one.heard == [ClearAllDataResponse(1)]
        assert kinds(other.heard) == [QueryActionListResponse]
        holds = [notice.hold for notice in notices if isinstance(notice, HoldNotice)]
        assert [hold and hold.who for hold in holds] == ["one", None]

    on_hub(use)


def test_a_lost_board_answers_nobody_until_it_is_back() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        fake.vanish()
        assert await program.ask(QueryServoListRequest(), seconds=1) is None
        assert hub.status().state == "lost"
        assert program.session.waiting == 0

    on_hub(use)


def test_who_leaves_disturbs_nobody() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other = RawProgram(hub), RawProgram(hub)
        for number in range(5):
            one.send(QueryActionRequest(number))
        other.send(QueryActionListRequest())
        one.session.leave()
        one.session.leave()
        one.send(QueryServoListRequest())
        await asyncio.sleep(1)
        assert one.heard == []
        assert kinds(other.heard) == [QueryActionListResponse]
        assert len(fake.executed) <= 2
        assert [program.who for program in hub.status().programs] == [other.session.who]

    on_hub(use)


def test_a_door_with_a_defect_costs_only_its_own_program() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        broken, other = RawProgram(hub), RawProgram(hub)

        def sink(data: bytes) -> None:
            raise OSError("the door is broken")

        broken.session._sink = sink
        broken.send(QueryServoListRequest())
        assert await other.ask(QueryServoListRequest()) is not None
        assert [program.session for program in hub.status().programs] == [other.session.session_id]
        assert hub.state == "connected"

    on_hub(use)


def test_a_session_begins_once() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        transport = LocalTransport(hub, session_id="secret")
        async with connect(transport):
            with pytest.raises(OpenError, match="has begun already"):
                await connect(LocalTransport(hub, session_id="secret"))
        async with connect(LocalTransport(hub, session_id="secret")):
            pass

    on_hub(use)


async def test_the_end_of_the_hub_ends_the_sessions_and_leaves_the_board() -> None:
    ended = asyncio.Event()
    async with connect("virtual://", angle_unit=None) as upstream:
        async with share(upstream, name="rex") as hub:
            program = RawProgram(hub)
            program.session.on_end = ended.set
            program.send(QueryServoListRequest())
        assert ended.is_set()
        program.send(QueryServoListRequest())
        assert len(await upstream.servo_ids()) == 16
    assert program.heard == []


def test_what_the_board_refuses_is_refused_to_the_program() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        fake.plan(ClearAllDataRequest, lie(ClearAllDataResponse(0)))
        assert await program.ask(ClearAllDataRequest()) == ClearAllDataResponse(0)
        fake.plan(SubscribeButtonEventRequest, lie(SubscribeButtonEventResponse(0)))
        assert await program.ask(SubscribeButtonEventRequest(1)) == SubscribeButtonEventResponse(0)
        assert await program.ask(SubscribeButtonEventRequest(7)) == SubscribeButtonEventResponse(0)
        assert not program.session.is_subscribed
        assert await program.ask(SubscribeButtonEventRequest(1)) == SubscribeButtonEventResponse(1)

    on_hub(use)


def test_another_board_than_that_of_the_profile_is_not_changed() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program, notices = RawProgram(hub), list[Struct]()
        hub.listen(lambda notice, session: notices.append(notice))

        async def refuse(packet: Packet, ticket: Ticket) -> None:
            raise WrongBoard("another board is here", packet)

        hub.board.connection.preparations = (refuse,)
        assert await program.ask(WriteProjectIDRequest(3)) == WriteProjectIDResponse(0)
        assert await program.ask(QueryProjectIDRequest()) == QueryProjectIDResponse(0)
        assert [notice.reason for notice in notices if isinstance(notice, RefusedNotice)] == ["another board is here"]

    on_hub(use)


@pytest.mark.parametrize("is_there", [True, False])
async def test_a_stop_has_a_second_when_the_hub_ends(is_there: bool) -> None:
    fake = PipedBoard()
    async with shared(fake) as hub:
        await RawProgram(hub).ask(START)
        fake.plan(SetServoParameterRequest, LOST)
        if not is_there:
            fake.usual_of[SetServoParameterRequest] = LOST
        stopping = hub.begin_stop("a page")
        began = asyncio.get_running_loop().time()
    assert fake.executed_of(SetServoParameterRequest) == ([START, STOP] if is_there else [START])
    assert asyncio.get_running_loop().time() < began + 1.5
    assert stopping.done()
    if not is_there:
        assert stopping.cancelled() or stopping.exception()
