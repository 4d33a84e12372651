"""The row of gates: its order, and what passes without being asked."""

from __future__ import annotations

import asyncio
import itertools

import pytest
from msgspec.structs import replace

from servolink.connection.gates import Gate, Gates
from servolink.errors import ConnectionLost, MotionRefused, RequestError, ServolinkError
from servolink.motion import StopCounter, Ticket
from servolink.protocol import (
    ALL_SERVOS,
    PACKETS,
    Effect,
    ExecuteActionRequest,
    Packet,
    Query,
    QueryServoListRequest,
    Response,
    SetServoParameterRequest,
    Step,
)
from tests.client.piped_board import PipedBoard, connected, now

MOVE = ExecuteActionRequest((Step(1, 0, 1),))
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
RELEASE = SetServoParameterRequest(ALL_SERVOS, 0, 0)
START = SetServoParameterRequest(1, 1, 1)


def refusing(name: str) -> Gate:
    def refuse(packet: Packet, ticket: Ticket) -> ServolinkError:
        return MotionRefused(name)

    return refuse


def test_gates_are_asked_in_one_order_whichever_was_closed_first() -> None:
    order = ("line", "identity", "role", "exclusive_use", "lease", "ticket", "limits")
    assert Gates.__struct_fields__ == order
    ticket = StopCounter().ticket()
    for one, other in itertools.combinations(order, 2):
        for names in ((one, other), (other, one)):
            gates = Gates()
            for name in names:
                gates = replace(gates, **{name: refusing(name)})
            assert str(gates.refusal(MOVE, ticket)) == one


def test_a_stop_and_a_query_pass_closed_gates() -> None:
    gates = Gates(*map(refusing, Gates.__struct_fields__))
    ticket = StopCounter().ticket()
    passing: tuple[Packet, ...] = (STOP, SetServoParameterRequest(7, 0, 1), QueryServoListRequest())
    assert [gates.refusal(packet, ticket) for packet in passing] == [None, None, None]
    refused: tuple[Packet, ...] = (MOVE, START, RELEASE)
    assert None not in [gates.refusal(packet, ticket) for packet in refused]


async def test_a_stop_is_sent_through_closed_gates_and_a_motion_is_not() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        connection.gates = Gates(*map(refusing, Gates.__struct_fields__))
        await connection.send_stop(STOP)
        await connection.request(SetServoParameterRequest(2, 0, 1))
        for packet in (START, RELEASE):
            with pytest.raises(MotionRefused, match="line"):
                await connection.request(packet)
        with pytest.raises(MotionRefused, match="line"):
            await connection.send(MOVE)
        await connection.request(QueryServoListRequest())
        assert board.executed_of(SetServoParameterRequest) == [STOP, SetServoParameterRequest(2, 0, 1)]
        assert not board.executed_of(ExecuteActionRequest)


async def test_gates_are_asked_after_everything_that_is_awaited() -> None:
    board = PipedBoard()
    async with connected(board) as connection:
        asked: list[Packet] = []

        async def stop_meanwhile(packet: Packet, ticket: Ticket) -> None:
            await asyncio.sleep(1)
            connection.stops.stop()

        def note(packet: Packet, ticket: Ticket) -> None:
            asked.append(packet)

        connection.preparations = (stop_meanwhile,)
        connection.gates = replace(connection.gates, identity=note)
        with pytest.raises(RequestError, match="ExecuteActionRequest was not sent: a stop came first"):
            await connection.send(MOVE)
        with pytest.raises(RequestError, match="SetServoParameterRequest was not sent: a stop came first"):
            await connection.request(START)
        await connection.request(RELEASE)  # goes limp after a stop, too
        assert asked == [MOVE, START, RELEASE]


async def test_a_ticket_ends_at_its_time_and_with_its_connection() -> None:
    async with connected(PipedBoard()) as connection:
        late = connection.stops.ticket(until=now() + 1)
        await connection.send(MOVE, ticket=late)
        await asyncio.sleep(1.1)
        for packet in (MOVE, RELEASE, START):
            assert "time by which it was to begin has passed" in str(connection.gates.refusal(packet, late))
        await connection.send(MOVE, ticket=late.begun())
        with pytest.raises(ConnectionLost, match="the connection was lost after it was asked for"):
            await connection.send(MOVE, ticket=StopCounter().ticket())


async def test_after_a_stop_the_ticket_gate_refuses_every_motion_but_a_release() -> None:
    async with connected(PipedBoard()) as connection:
        ticket = connection.stops.ticket()
        connection.stops.stop()
        for declared in PACKETS.values():
            if issubclass(declared, Query | Response):
                continue
            needed = len(declared.__struct_fields__) - len(declared.__struct_defaults__)
            packet = declared(*[1] * needed)
            expects = packet.is_motion and packet.effect is not Effect.GOES_LIMP
            assert (connection.gates.refusal(packet, ticket) is not None) == expects, packet
