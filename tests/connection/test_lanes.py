"""Lanes: what is owed, and what an answer proves."""

from __future__ import annotations

import asyncio

from servolink.connection.lanes import Lanes, PendingRequest
from servolink.protocol.codec import PACKETS
from servolink.protocol.editing import QueryProjectIDRequest
from servolink.protocol.packet import Request, Response
from servolink.protocol.settings import QueryMemorySizeRequest, QueryRemainPowerRequest
from tests.virtual_time import run

PROJECT, MEMORY, POWER = QueryProjectIDRequest(), QueryMemorySizeRequest(), QueryRemainPowerRequest()


def sending(lanes: Lanes, request: Request[Response]) -> PendingRequest:
    answer: asyncio.Future[Response | None] = asyncio.get_running_loop().create_future()
    return PendingRequest(request, lanes.next_number(), 0.0, 1.0, 1.0, answer)


def test_each_request_has_the_lane_of_its_response_and_no_two_share_one() -> None:
    lanes = Lanes()
    requests = [declared.packet_id for declared in PACKETS.values() if issubclass(declared, Request)]
    assert [lane.response_id for lane in lanes.by_response_id.values()] == [packet_id + 1 for packet_id in requests]
    assert len(lanes.by_response_id) == 28
    assert lanes.of(PROJECT).response_id == 30131


def test_sendings_are_numbered_from_one() -> None:
    lanes = Lanes()
    assert [lanes.next_number() for _ in range(3)] == [1, 2, 3]


def test_only_lanes_with_a_sending_are_pending() -> None:
    async def main() -> None:
        lanes = Lanes()
        assert list(lanes.pending()) == []
        waiting = lanes.of(MEMORY).pending = sending(lanes, MEMORY)
        assert list(lanes.pending()) == [(lanes.of(MEMORY), waiting)]

    run(main())


def test_a_lane_is_in_doubt_while_something_is_owed_on_it() -> None:
    async def main() -> None:
        lanes = Lanes()
        lanes.owe(lanes.of(MEMORY), sending(lanes, MEMORY))
        assert lanes.in_doubt(lanes.of(MEMORY))
        assert not lanes.in_doubt(lanes.of(POWER))
        assert not lanes.in_doubt(None)

    run(main())


def test_everything_is_in_doubt_after_a_sending_that_nothing_may_follow() -> None:
    lanes = Lanes()
    lanes.fence_first = lanes.next_number()
    assert lanes.in_doubt(lanes.of(POWER))
    assert lanes.in_doubt(None)
    lanes.answered(1)
    assert not lanes.in_doubt(None)


def test_an_answer_settles_what_was_sent_up_to_it_and_nothing_later() -> None:
    async def main() -> None:
        lanes = Lanes()
        for request in (PROJECT, MEMORY, POWER):
            lanes.owe(lanes.of(request), sending(lanes, request))
        lanes.fence_first = 3
        lanes.answered(2)
        assert [lanes.of(request).owed is None for request in (PROJECT, MEMORY, POWER)] == [True, True, False]
        assert lanes.in_doubt(None)

    run(main())
