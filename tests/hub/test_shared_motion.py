"""Motion and stops of programs that share a board.

Module: servolink.hub.engine.sending.
"""

from __future__ import annotations

import asyncio

from msgspec import Struct

from servolink.control import RefusedNotice, Role
from servolink.errors import OutcomeUnknown
from servolink.hub.hub import Hub
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionRequest,
    QueryActionRequest,
    QueryActionResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
)
from tests.client.piped_board import LOST, SWALLOWED, PipedBoard, late
from tests.hub.fake_board_hub import MOVE, START, STOP, kinds, on_hub
from tests.hub.raw_program import RawProgram


def test_motion_of_all_programs_that_waits_is_not_sent_after_a_stop() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other, notices = RawProgram(hub), RawProgram(hub), list[Struct]()
        hub.listen(lambda notice, session: notices.append(notice))
        for number in range(3):
            one.send(QueryActionRequest(number))
        one.send(MOVE)
        one.send(QueryServoListRequest())
        assert await other.ask(STOP) == SetServoParameterResponse(ALL_SERVOS, 0, 1)
        await asyncio.sleep(1)
        assert fake.executed_of(ExecuteActionRequest) == []
        assert kinds(one.heard) == [*[QueryActionResponse] * 3, QueryServoListResponse]
        refused = [notice for notice in notices if isinstance(notice, RefusedNotice)]
        assert [(notice.packet, notice.reason) for notice in refused] == [("ExecuteActionRequest", "a stop came first")]

    on_hub(use)


def test_a_motion_that_waits_for_its_unit_is_not_sent_after_a_stop() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other = RawProgram(hub), RawProgram(hub)
        one.send(MOVE)  # first its unit is set
        await asyncio.sleep(0.001)
        assert len(fake.executed_of(SetAngleUnitRequest)) == 1
        await other.ask(STOP)
        await asyncio.sleep(1)
        assert fake.executed_of(ExecuteActionRequest) == []

    on_hub(use)


def test_a_stop_of_one_servo_says_what_the_servo_reports() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub, role=Role.WATCH)
        one = SetServoParameterRequest(2, 0, 1)
        assert await program.ask(one) == SetServoParameterResponse(2, 0, 1)
        assert await program.ask(SetServoParameterRequest(99, 0, 1)) == SetServoParameterResponse(0, 1, 0)
        fake.plan(SetServoParameterRequest, LOST)
        await program.ask(START)
        assert await program.ask(one) == SetServoParameterResponse(2, 0, 1)

    on_hub(use)


def test_a_stop_of_one_servo_is_sent_again_until_the_servo_reports_it() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program, one = RawProgram(hub), SetServoParameterRequest(2, 0, 1)
        await program.ask(START)
        fake.plan(SetServoParameterRequest, LOST, LOST)
        assert await program.ask(one) == SetServoParameterResponse(2, 0, 1)
        assert [packet for _, packet in fake.sent].count(one) == 3
        fake.usual_of[QueryServoRequest] = SWALLOWED
        assert await program.ask(one) is None
        assert program.session.counters.unanswered == 1

    on_hub(use)


def test_many_stops_at_once_cost_the_board_few() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        programs = [RawProgram(hub, role=Role.WATCH) for _ in range(20)]
        pages = [asyncio.ensure_future(hub.stop("a page")) for _ in range(100)]  # the way of the control interface
        responses = await asyncio.gather(*(program.ask(STOP) for program in programs for _ in range(10)))
        assert responses == [SetServoParameterResponse(ALL_SERVOS, 0, 1)] * 200
        await asyncio.gather(*pages)
        assert fake.executed_of(SetServoParameterRequest) == [STOP]

    on_hub(use)


def test_who_gives_up_a_stop_does_not_end_that_of_the_others() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        fake.usual_of[QueryServoRequest] = SWALLOWED
        stops = [asyncio.ensure_future(hub.stop("a page")) for _ in range(3)]
        await asyncio.sleep(0.1)
        stops[0].cancel()
        results = await asyncio.gather(*stops, return_exceptions=True)
        assert [type(result) for result in results] == [asyncio.CancelledError, OutcomeUnknown, OutcomeUnknown]
        del fake.usual_of[QueryServoRequest]
        await hub.stop("a page")

    on_hub(use)


def test_a_stop_behind_a_motion_is_sent_although_another_one_is_under_way() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other = RawProgram(hub), RawProgram(hub)
        one.send(MOVE)
        await asyncio.sleep(0.1)
        fake.plan(QueryServoRequest, late(1))  # the stop is not confirmed for so long
        one.send(STOP)
        one.send(MOVE)
        await asyncio.sleep(0.1)
        other.send(STOP)
        await asyncio.sleep(5)
        sent = [packet for _, packet in fake.sent if packet in (STOP, MOVE)]
        assert sent[:4] == [MOVE, STOP, MOVE, STOP]
        assert [len(program.heard) for program in (one, other)] == [1, 1]

    on_hub(use, depth=4)


def test_a_program_in_mode_0_can_stop_the_board_all_the_same() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        program.send(TransmissionModeSettingRequest(0))
        assert await program.ask(STOP, seconds=2) is None
        assert fake.executed_of(SetServoParameterRequest) == [STOP]

    on_hub(use)


def test_a_program_without_the_lease_or_the_role_moves_nothing() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other, watcher = RawProgram(hub, "one"), RawProgram(hub, "other"), RawProgram(hub, role=Role.WATCH)
        await one.ask(START)
        assert hub.lease is not None
        assert hub.lease.who == "one"
        assert await other.ask(SetServoParameterRequest(1, 0, 0)) == SetServoParameterResponse(1, 1, 1)
        other.send(MOVE)
        assert await watcher.ask(WriteProjectIDRequest(3)) == WriteProjectIDResponse(0)
        await asyncio.sleep(0.1)
        assert fake.executed_of(ExecuteActionRequest) == []
        assert [program.session.counters.refused for program in (one, other, watcher)] == [0, 2, 1]
        one.session.leave()
        other.send(MOVE)
        await asyncio.sleep(0.1)
        assert fake.executed_of(ExecuteActionRequest) == [MOVE]

    on_hub(use)


def test_a_motion_of_a_program_that_has_left_is_not_sent() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        program.send(MOVE)  # first its unit is set
        await asyncio.sleep(0.001)
        assert len(fake.executed_of(SetAngleUnitRequest)) == 1
        program.session.leave()
        await asyncio.sleep(1)
        assert fake.executed_of(ExecuteActionRequest) == []
        assert hub.lease is None

    on_hub(use)
