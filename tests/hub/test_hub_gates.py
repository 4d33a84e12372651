"""What a program may send, and what it gets for a packet that is not sent."""

from __future__ import annotations

import asyncio

import pytest

from servolink.control import HoldStatus, Role
from servolink.errors import Reason
from servolink.hub.engine.hub_gates import (
    LeaseGate,
    LeaseRefused,
    Standstill,
    refuse_other_use,
    refuse_role,
    refused_response,
    stops_all,
)
from servolink.hub.rules.lease import MotionLease
from servolink.motion import StopCounter, Ticket
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    AddActionResponse,
    AddServoParameterRequest,
    AddServoParameterResponse,
    ClearAllDataRequest,
    ClearAllDataResponse,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    ExecuteMacroResponse,
    Packet,
    QueryServoRequest,
    ServoState,
    SetServoParameterRequest,
    SetServoParameterResponse,
)
from servolink.support import time_with_sleep

MOVE = ExecuteActionRequest(())
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)


def gate() -> tuple[LeaseGate, MotionLease]:
    lease = MotionLease()
    return LeaseGate(lease, "rex", {"ann": "servolink move (pid 7)", "bob": "evil\x1b[2J"}.__getitem__), lease


def by(session: str) -> Ticket:
    return StopCounter().ticket(who=session)


def test_while_one_program_holds_the_lease_others_learn_who_has_it() -> None:
    checks, lease = gate()
    assert checks.refuse(MOVE, by("ann"), 100.0) is None
    lease.take("ann", 100.0)
    assert checks.refuse(MOVE, by("ann"), 101.0) is None
    refusal = checks.refuse(MOVE, by("bob"), 103.5)
    assert isinstance(refusal, LeaseRefused)
    assert str(refusal) == (
        "the servos of rex are moved by servolink move (pid 7), which has had the lease for 3 s: wait until it is "
        "free, or take it over with `servolink share --take rex`"
    )


def test_names_of_programs_are_escaped() -> None:
    checks, lease = gate()
    lease.take("bob", 0.0)
    assert "by evil\\x1b[2J, which has had the lease for 2 min:" in checks.reason("ann", 150.0)
    assert "for 3 h:" in checks.reason("ann", 3 * 3600)


def test_a_program_that_lost_the_lease_learns_how_to_get_it_back() -> None:
    checks, lease = gate()
    lease.take("ann", 0.0)
    lease.take("bob", 1.0, force=True)
    lease.left("bob", 2.0)
    assert str(checks.refuse(MOVE, by("ann"), 3.0)) == (
        "the right to move the servos of rex was taken from this program: `servolink share --give rex` gives it back"
    )


def test_nobody_is_named_while_the_lease_is_free() -> None:
    assert gate()[0].reason("ann", 0.0) == ""


@pytest.mark.parametrize("packet", [STOP, QueryServoRequest(1), ExecuteMacroRequest(1), AddActionRequest(1)])
def test_only_motion_needs_the_lease_and_a_stop_does_not(packet: Packet) -> None:
    checks, lease = gate()
    lease.take("ann", 0.0)
    assert (checks.refuse(packet, by("bob"), 1.0) is not None) == isinstance(packet, ExecuteMacroRequest)
    assert lease.holder == "ann"


def test_a_packet_without_its_role_is_refused() -> None:
    assert str(refuse_role(MOVE, Role.RUN)) == (
        "ExecuteActionRequest needs the role move, and this program has the role run"
    )
    assert refuse_role(MOVE, Role.MOVE) is None
    assert refuse_role(STOP, Role.WATCH) is None


RELEASE = SetServoParameterRequest(1, 0, 0)


@pytest.mark.parametrize("packet", [MOVE, RELEASE, ExecuteMacroRequest(1), AddServoParameterRequest(())])
async def test_a_motion_is_refused_after_a_stop_and_after_its_time(packet: Packet) -> None:
    stops, standstill = StopCounter(), Standstill(lambda reason: None)
    ticket = stops.ticket(until=time_with_sleep() + 10.0, who="ann")
    await asyncio.sleep(9.9)
    assert standstill.refuse(packet, ticket, stops) is None
    await asyncio.sleep(0.2)
    assert str(standstill.refuse(packet, ticket, stops)) == "the time by which it was to begin has passed"
    assert standstill.refuse(packet, ticket.begun(), stops) is None
    stops.stop()
    assert str(standstill.refuse(packet, ticket, stops)) == "a stop came first"
    for other in (STOP, QueryServoRequest(1), AddActionRequest(1)):
        assert standstill.refuse(other, ticket, stops) is None


def test_another_program_with_exclusive_use_is_named() -> None:
    hold = HoldStatus("bob", "bob", "a project is being written")
    assert refuse_other_use(None, "ann") is None
    assert refuse_other_use(hold, "bob") is None
    refusal = refuse_other_use(hold, "ann")
    assert refusal is not None
    assert (str(refusal), refusal.reason) == (
        "nothing was moved: bob has taken exclusive use of the board",
        Reason.EXCLUSIVE_USE,
    )


def state(servo_id: int, is_start: int, is_hold: int) -> ServoState:
    return ServoState(servo_id, 0, 0, 0, 0, is_start, is_hold)


@pytest.mark.parametrize(
    ("packet", "response"),
    [
        (MOVE, None),
        (ExecuteActionExRequest(1), None),
        (ExecuteMacroRequest(1), ExecuteMacroResponse(0)),
        (AddServoParameterRequest(()), AddServoParameterResponse(0)),
        (AddActionRequest(1), AddActionResponse(0)),
        (ClearAllDataRequest(), ClearAllDataResponse(0)),
        (SetServoParameterRequest(2, 1, 1), SetServoParameterResponse(2, 0, 1)),
        (SetServoParameterRequest(9, 1, 1), None),
        (SetServoParameterRequest(ALL_SERVOS, 1, 1), SetServoParameterResponse(ALL_SERVOS, 0, 1)),
        (SetServoParameterRequest(ALL_SERVOS, 0, 0), SetServoParameterResponse(ALL_SERVOS, 0, 1)),
    ],
)
def test_a_refused_packet_is_answered_as_by_a_board_that_refuses(packet: Packet, response: Packet | None) -> None:
    assert refused_response(packet, [state(1, 1, 1), state(2, 0, 1)]) == response


def test_the_response_for_all_servos_differs_from_the_request_if_any_servo_does() -> None:
    packet = SetServoParameterRequest(ALL_SERVOS, 0, 0)
    assert refused_response(packet, [state(1, 0, 0), state(2, 0, 0)]) == SetServoParameterResponse(ALL_SERVOS, 0, 0)
    assert refused_response(packet, [state(1, 0, 0), state(2, 1, 1)]) == SetServoParameterResponse(ALL_SERVOS, 1, 1)
    assert refused_response(packet) is None


def test_only_a_stop_of_all_servos_ends_every_motion() -> None:
    assert stops_all(STOP)
    assert not stops_all(SetServoParameterRequest(1, 0, 1))
    assert not stops_all(SetServoParameterRequest(ALL_SERVOS, 0, 0))
