"""Programs of a hub: the order of their responses, their turns, joined queries, and what belongs to each of them.

Module: servolink.hub.engine.program.
"""

from __future__ import annotations

import asyncio

from servolink.client import connect
from servolink.hub.engine.program import MOST_HELD, REQUEST_BYTES
from servolink.hub.hub import Hub, share
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    QueryActionRequest,
    QueryMemorySizeRequest,
    QueryMemorySizeResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    QueryServoListRequest,
    QueryServoListResponse,
    QueryServoRequest,
    QueryServoResponse,
    SendDummyDataRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
    Step,
    SubscribeButtonEventRequest,
    SubscribeButtonEventResponse,
    TransmissionModeSettingRequest,
    TransmissionModeSettingResponse,
    WriteProjectIDRequest,
    WriteProjectIDResponse,
    encode_frame,
)
from servolink.testing import Fate
from tests.client.piped_board import LATENCY, SWALLOWED, PipedBoard
from tests.hub.fake_board_hub import MOVE, STOP, kinds, on_hub, shared
from tests.hub.local_transport import LocalTransport
from tests.hub.raw_program import RawProgram

# --- order --------------------------------------------------------------------------------------------------------


def test_responses_leave_in_the_order_of_the_requests() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        for request in (QueryMemorySizeRequest(), QueryServoListRequest(), QueryProjectIDRequest()):
            program.send(request)
        program.send(TransmissionModeSettingRequest(1))  # which the hub answers itself
        await asyncio.sleep(1)
        assert kinds(program.heard) == [
            QueryMemorySizeResponse,
            QueryServoListResponse,
            QueryProjectIDResponse,
            TransmissionModeSettingResponse,
        ]

    on_hub(use)
    on_hub(use, depth=4)


def test_an_unanswered_request_is_passed_over_when_the_board_is_given_up() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        fake.usual_of[QueryMemorySizeRequest] = SWALLOWED
        program = RawProgram(hub)
        for request in (QueryMemorySizeRequest(), QueryServoListRequest()):
            program.send(request)
        await asyncio.sleep(2)
        assert program.heard == []
        await asyncio.sleep(2)
        assert kinds(program.heard) == [QueryServoListResponse]
        assert program.session.counters.unanswered == 1
        assert program.session.waiting == 0

    on_hub(use)
    on_hub(use, depth=4)


def test_packets_without_a_response_keep_their_place() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        sent = [QueryProjectIDRequest(), SendDummyDataRequest(b"1"), WriteProjectIDRequest(7), MOVE]
        for packet in (*sent, SendDummyDataRequest(b"2"), QueryProjectIDRequest()):
            program.send(packet)
        await asyncio.sleep(1)
        arrived = [packet for _, packet in fake.executed if not isinstance(packet, SetAngleUnitRequest)]
        assert arrived == [*sent, SendDummyDataRequest(b"2"), QueryProjectIDRequest()]
        assert program.heard[0] == QueryProjectIDResponse(0)
        assert program.heard[-1] == QueryProjectIDResponse(7)

    on_hub(use)


def test_what_fills_the_reports_of_a_hid_board_is_not_noise_in_the_status() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        fake.usual_of[QueryServoListRequest] = Fate(damage=lambda frame: frame + bytes(-len(frame) % 64))
        program = RawProgram(hub)
        for _ in range(3):
            assert await program.ask(QueryServoListRequest()) is not None
        assert sum(hub.board.stats.skipped.values()) > 50
        assert hub.status().noise == 0
        fake.deliver(b"noise")
        assert await program.ask(QueryServoListRequest()) is not None
        assert hub.status().noise == 5

    on_hub(use)


# --- turns and joined queries -------------------------------------------------------------------------------------


def test_a_program_that_floods_waits_in_its_own_queue() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        flood, other = RawProgram(hub), RawProgram(hub)
        for number in range(500):
            flood.send(QueryActionRequest(number))
        assert await other.ask(QueryServoListRequest()) is not None
        assert [packet for _, packet in fake.executed].index(QueryServoListRequest()) <= 2

    on_hub(use)


def test_a_program_with_many_requests_is_not_read_until_there_is_room() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program, read_on = RawProgram(hub).session, asyncio.Event()
        program.on_room = read_on.set
        frame = hub.board.codec.encode(QueryActionRequest(1))
        most = MOST_HELD // (REQUEST_BYTES + 4)  # the content is an id
        program.receive(frame * most)
        was_full = [program.is_full]
        program.receive(frame)
        was_full.append(program.is_full)
        async with asyncio.timeout(10):
            await read_on.wait()
        assert [*was_full, program.is_full] == [False, True, False]

    on_hub(use)


def test_large_requests_count_for_what_they_hold() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub).session
        frame = hub.board.codec.encode(AddActionRequest(1, "", tuple(Step(1, 0, 1) for _ in range(6_000))))
        counts = 0
        while not program.is_full:
            program.receive(frame)
            counts += 1
        assert counts == 1 + MOST_HELD // (len(frame) + REQUEST_BYTES)
        program.leave()
        assert not program.is_full

    on_hub(use)


def test_a_stop_does_not_wait_behind_a_thousand_requests_of_its_program() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        holder, program = RawProgram(hub), RawProgram(hub)
        hub.begin_exclusive_use(holder.session.session_id, "an import")
        for number in range(1000):
            assert not program.session.is_full
            program.send(QueryActionRequest(number))
        program.send(STOP)
        await asyncio.sleep(1)
        assert fake.executed_of(SetServoParameterRequest) == [STOP]
        assert program.heard == []  # its responses keep their order
        hub.end_exclusive_use(holder.session.session_id)
        await asyncio.sleep(100)
        assert len(program.heard) == 1001
        assert program.heard[-1] == SetServoParameterResponse(ALL_SERVOS, 0, 1)

    on_hub(use)


def test_one_response_answers_all_who_asked_the_same_before_it_was_sent() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        programs = [RawProgram(hub) for _ in range(5)]
        responses = await asyncio.gather(*(program.ask(QueryServoListRequest()) for program in programs))
        assert kinds([response for response in responses if response]) == [QueryServoListResponse] * 5
        assert len(fake.executed_of(QueryServoListRequest)) <= 2

    on_hub(use)


def test_who_joined_a_query_is_answered_although_its_program_has_left() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        leaver, joiner, other = RawProgram(hub), RawProgram(hub), RawProgram(hub, unit="adc")
        query = QueryServoRequest(1)
        await other.ask(query)
        other.send(QueryMemorySizeRequest())  # until it is answered, the queries of both wait and are joined
        for program in (leaver, joiner):
            program.send(query)
        while len(fake.sent_of(SetAngleUnitRequest)) < 2:  # the second one is for these two
            await asyncio.sleep(LATENCY / 4)
        leaver.session.leave()
        await asyncio.sleep(1)
        assert kinds(joiner.heard) == [QueryServoResponse]
        assert joiner.session.counters.unanswered == 0

    on_hub(use)


def test_a_query_is_not_joined_past_a_change_of_its_own_program() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        one, other = RawProgram(hub), RawProgram(hub)
        for packet in (QueryMemorySizeRequest(), WriteProjectIDRequest(5), QueryProjectIDRequest()):
            one.send(packet)
        for _ in range(3):
            other.send(QueryProjectIDRequest())
        await asyncio.sleep(1)
        assert one.heard[1:] == [WriteProjectIDResponse(1), QueryProjectIDResponse(5)]
        assert len(other.heard) == 3

    on_hub(use)


def test_equal_queries_of_one_program_are_all_answered() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        for _ in range(10):
            program.send(QueryRemainPowerRequest())
        await asyncio.sleep(1)
        assert kinds(program.heard) == [QueryRemainPowerResponse] * 10
        assert len(fake.executed_of(QueryRemainPowerRequest)) <= 2

    on_hub(use)


# --- what belongs to one program ----------------------------------------------------------------------------------


def test_a_program_in_mode_0_hears_nothing_until_it_leaves_it() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program, other = RawProgram(hub), RawProgram(hub)
        assert await program.ask(TransmissionModeSettingRequest(0)) == TransmissionModeSettingResponse(0)
        program.send(QueryServoListRequest())
        await asyncio.sleep(5)
        assert len(program.heard) == 1
        assert await other.ask(QueryServoListRequest()) is not None
        assert await program.ask(TransmissionModeSettingRequest(1)) == TransmissionModeSettingResponse(1)
        assert await program.ask(QueryServoListRequest()) is not None
        assert fake.executed_of(TransmissionModeSettingRequest) == []

    on_hub(use)


def test_bytes_that_a_board_ignores_are_counted() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        session = program.session
        session.receive(b"no frame at all")
        program.send(QueryServoListResponse((1, 2)))  # which only boards send
        session.receive(encode_frame(20050, b"\x02" + bytes(5), "little"))  # its count contradicts its length
        session.receive(encode_frame(12345, b"", "little"))  # an unknown id
        assert await program.ask(QueryServoListRequest()) is not None
        assert session.counters.ignored == 2
        assert session.garbage > len("no frame at all")
        assert len(fake.executed) == 1

    on_hub(use)


def test_half_a_frame_swallows_nothing_that_comes_later() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        program.session.receive(encode_frame(10050, bytes(60000), "little")[:20])
        await asyncio.sleep(0.3)
        assert await program.ask(QueryServoListRequest()) is not None

    on_hub(use)


def test_a_frame_of_which_the_rest_is_read_late_is_whole() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program, read_on = RawProgram(hub).session, asyncio.Event()
        program.on_room = read_on.set
        frame, many = hub.board.codec.encode(QueryServoListRequest()), MOST_HELD // REQUEST_BYTES + 1
        program.pause()
        program.receive(frame * many + frame[:8])
        assert program.is_full
        await asyncio.sleep(1)
        program.resume()
        async with asyncio.timeout(10):
            await read_on.wait()
        program.receive(frame[8:])
        assert program.counters.requests == many + 1

    on_hub(use)


async def test_button_events_go_to_those_who_asked() -> None:
    fake = PipedBoard()
    async with shared(fake) as hub:
        one, other, third = (RawProgram(hub) for _ in range(3))
        on, off = SubscribeButtonEventRequest(1), SubscribeButtonEventRequest(0)
        done = SubscribeButtonEventResponse(1)
        assert [await one.ask(on), await other.ask(on), await one.ask(off)] == [done] * 3
        assert fake.executed_of(SubscribeButtonEventRequest) == [on]
        fake.press_button(4, asyncio.get_running_loop().time())
        fake.deliver(b"".join(fake._said[-1:]))
        await asyncio.sleep(0.1)
        assert [len(program.heard) for program in (one, other, third)] == [2, 2, 0]
        other.session.leave()
        await asyncio.sleep(0.1)
        assert fake.executed_of(SubscribeButtonEventRequest) == [on, off]


def test_a_subscription_that_is_confirmed_after_its_program_has_left_is_ended() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        program = RawProgram(hub)
        program.send(SubscribeButtonEventRequest(1))
        await asyncio.sleep(LATENCY / 2)
        program.session.leave()
        await asyncio.sleep(1)
        assert fake.executed_of(SubscribeButtonEventRequest)[1:] == [SubscribeButtonEventRequest(0)]

    on_hub(use)


async def test_each_program_gets_angles_in_its_own_unit() -> None:
    async with (
        connect("virtual://?servos=3", angle_unit=None) as upstream,
        share(upstream, name="rex") as hub,
        connect(LocalTransport(hub)) as one,
        connect(LocalTransport(hub, unit="adc"), angle_unit=None) as other,
    ):
        await one.move({1: 60}, duration=0.1, wait=True)
        query = QueryServoRequest(1)
        for _ in range(3):
            degrees, steps = await asyncio.gather(one.request(query), other.request(query))
            assert degrees.servos[0].angle == 60
            assert steps.servos[0].angle > 360


def test_captions_keep_bytes_that_no_encoding_knows() -> None:
    async def use(hub: Hub, fake: PipedBoard) -> None:
        contents, program = list[bytes](), RawProgram(hub)
        caption = b"\xff\xfe\x00after the end".ljust(32, b"\x00")
        action = encode_frame(30030, (7).to_bytes(4, "little") + caption + bytes(2), "little")
        fake._session.receive(action, asyncio.get_running_loop().time())
        program.session._sink = contents.append
        program.send(QueryActionRequest(7))
        await asyncio.sleep(0.1)
        assert caption in contents[0]

    on_hub(use)
