"""Stopping: a stop goes to the board before everything, and counts when the servos report it."""

from __future__ import annotations

from collections.abc import Iterable

from servolink.client.board import Board
from servolink.errors import DecodeError, OutcomeUnknown, RequestTimeout
from servolink.protocol.servos import (
    ALL_SERVOS,
    QueryServoRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
)

_TRIES = 3


async def stop(board: Board, packet: SetServoParameterRequest) -> SetServoParameterResponse:
    """Stop and hold one servo or all at once, and return what they report then.

    Raise OutcomeUnknown or ConnectionLost if that cannot be confirmed.
    """
    if packet.servo_id == ALL_SERVOS:
        await board.stop()
        return SetServoParameterResponse(ALL_SERVOS, 0, 1)
    for _ in range(_TRIES):
        connection = board.connection
        await connection.send_stop(packet)
        query = QueryServoRequest(packet.servo_id)
        try:
            states = (await connection.request(query, timeout=connection.patience / _TRIES, first=True)).servos
        except (RequestTimeout, DecodeError):
            continue
        if not states:
            return SetServoParameterResponse(0, 1, 0)  # as a board answers that has no such servo
        if (states[0].is_start, states[0].is_hold) == (0, 1):
            return SetServoParameterResponse(packet.servo_id, 0, 1)
    raise OutcomeUnknown(f"a stop was sent {_TRIES} times and could not be confirmed", packet)


async def stop_each(board: Board, servo_ids: Iterable[int]) -> None:
    """Stop and hold some servos: the stops leave together, and one reading confirms them.

    Raise OutcomeUnknown if one of them does not report it, RequestTimeout or ConnectionLost if nothing is reported.
    """
    connection = board.connection
    wanted = set(servo_ids)
    for servo_id in wanted:
        await connection.send_stop(SetServoParameterRequest(servo_id, 0, 1))
    query = QueryServoRequest(ALL_SERVOS)
    states = (await connection.request(query, timeout=connection.patience / _TRIES, first=True)).servos
    stopped = {state.servo_id for state in states if (state.is_start, state.is_hold) == (0, 1)}
    if missing := sorted(wanted - stopped):
        raise OutcomeUnknown(f"servos {missing} were asked to stop, and do not report that they are stopped", query)
