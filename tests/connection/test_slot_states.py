"""Slots: which are live or overdue, what a stop does to them, and what stands in the way of a request.

Module: servolink.connection.call.
"""

from __future__ import annotations

from typing import Any

import pytest

from servolink.connection.call import Call, Slot
from servolink.connection.slots import FENCES_ONLY, Obstacle, Slots
from servolink.protocol import (
    ALL_SERVOS,
    AddActionRequest,
    ClearAllDataRequest,
    Command,
    DeleteActionRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    QueryProjectIDResponse,
    QueryRemainPowerResponse,
    QueryServoRequest,
    Request,
    SendDummyDataRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
    TransmissionModeSettingRequest,
    WriteProjectIDRequest,
)
from tests.connection.slot_trace import (
    DONE,
    POWER,
    STOP,
    TELEMETRY,
    Trace,
    add,
    angles,
    ask,
)


@pytest.fixture
def trace() -> Trace:
    return Trace()


# --- live and overdue slots -----------------------------------------------------------------------------------------


def test_the_first_live_slot_is_neither_over_nor_overdue(trace: Trace) -> None:
    assert not trace.slots.live
    first = trace.send("T#1", TELEMETRY)
    second = trace.send("P#2", POWER)
    assert trace.slots.live[0] is first
    trace.slots.expire(first)
    assert trace.slots.live[0] is second
    assert trace.slots.overdue == 1
    trace.hear(QueryRemainPowerResponse(1))
    assert not trace.slots.live
    assert trace.slots.overdue == 0


def test_a_slot_may_begin_overdue(trace: Trace) -> None:
    slot = Slot(POWER, trace.slots.lanes[POWER.packet_id + 1], None, overdue=True)
    trace.slots.open(slot)
    assert not trace.slots.live
    assert trace.slots.overdue == 1


def test_slots_without_proof_are_counted(trace: Trace) -> None:
    trace.send("T#1", TELEMETRY)
    trace.send("T#2", TELEMETRY)
    trace.slots.unanswerable = 2
    trace.hear(angles(1))
    assert trace.slots.unproved == trace.slots.unanswerable == 2  # equal ones prove little
    trace.hear(angles(2))
    assert trace.slots.unproved == trace.slots.unanswerable == 0


def test_slots_are_counted_from_a_fence_that_may_prove_them(trace: Trace) -> None:
    trace.send("T#1", TELEMETRY)
    trace.send("T#2", TELEMETRY)
    trace.slots.open(Slot(POWER, trace.slots.lanes[POWER.packet_id + 1], None, is_fence=True))
    assert trace.slots.unproved == 1


def test_clearing_closes_all_slots(trace: Trace) -> None:
    slots = [trace.send("T#1", TELEMETRY), trace.send("C#2", add(1)), trace.send("D#3", add(2))]
    trace.hear(DONE)
    trace.slots.expire(slots[0])
    assert trace.slots.clear() == slots
    assert trace.open == ""
    assert (trace.slots.unmatched, trace.slots.overdue, list(trace.slots.live)) == (0, 0, [])
    assert trace.slots.clear() == []
    assert trace.slots.obstacle(ClearAllDataRequest()) is Obstacle.NONE


# --- stops ----------------------------------------------------------------------------------------------------------


def test_responses_on_the_lane_of_a_stop_prove_nothing_until_it_is_settled(trace: Trace) -> None:
    trace.send("S#1", SetServoParameterRequest(1, 1, 1))
    trace.stop("stop#2")
    trace.stop("stop#3")
    assert trace.hear(SetServoParameterResponse(ALL_SERVOS, 0, 1)) == []
    assert trace.hear(SetServoParameterResponse(1, 1, 1)) == []
    trace.send("T#4", TELEMETRY)
    assert trace.hear(angles(1)) == [("S#1", None), ("stop#2", None), ("stop#3", None), ("T#4", angles(1))]
    assert not trace.slots.lanes[STOP.packet_id + 1].stopped
    trace.send("S#5", SetServoParameterRequest(1, 1, 1))
    assert trace.hear(SetServoParameterResponse(1, 1, 1)) == [("S#5", SetServoParameterResponse(1, 1, 1))]


def test_a_stop_drops_what_its_lane_keeps(trace: Trace) -> None:
    trace.send("S#1", SetServoParameterRequest(1, 1, 1))
    trace.send("S#2", SetServoParameterRequest(2, 1, 1))
    assert trace.hear(SetServoParameterResponse(0, 1, 1)) == []
    assert trace.slots.unmatched == 1
    trace.stop("stop#3")
    assert trace.slots.unmatched == 0


def test_a_stop_holds_nothing_back(trace: Trace) -> None:
    trace.stop("stop#1")
    assert not trace.slots.live
    assert trace.slots.obstacle(TELEMETRY) is Obstacle.NONE
    assert trace.slots.obstacle(SetServoParameterRequest(1, 1, 1)) is Obstacle.FENCE


# --- obstacles ------------------------------------------------------------------------------------------------------

ALONE: list[Request[Any]] = [
    ClearAllDataRequest(),
    TransmissionModeSettingRequest(1),
    SetAngleUnitRequest(1, 0),
    ExecuteMacroRequest(1),
    SetServoParameterRequest(1, 1, 1),
]


@pytest.mark.parametrize("exclusive", ALONE, ids=lambda packet: type(packet).__name__)
def test_some_packets_bear_nothing_beside_them(exclusive: Request[Any], trace: Trace) -> None:
    others: list[Request[Any] | Command] = [
        TELEMETRY,
        add(1),
        exclusive,
        ExecuteActionRequest(),
        SendDummyDataRequest(),
    ]
    assert trace.slots.obstacle(exclusive) is Obstacle.NONE
    assert all(trace.slots.obstacle(exclusive, [other]) is Obstacle.WAIT for other in others)
    assert all(trace.slots.obstacle(other, [exclusive]) is Obstacle.WAIT for other in others)
    slot = trace.send("P#1", POWER)
    assert trace.slots.obstacle(exclusive) is Obstacle.WAIT
    trace.slots.expire(slot)
    assert trace.slots.obstacle(exclusive) is Obstacle.FENCE
    trace.slots.clear()
    slot = trace.send("X#2", exclusive)
    assert all(trace.slots.obstacle(other) is Obstacle.WAIT for other in others)
    trace.slots.expire(slot)
    assert all(trace.slots.obstacle(other) is Obstacle.FENCE for other in others)
    trace.slots.clear()
    assert all(trace.slots.obstacle(other) is Obstacle.NONE for other in others)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (QueryServoRequest(ALL_SERVOS), QueryServoRequest(3)),
        (add(1), add(1)),
        (AddActionRequest(1, "new"), AddActionRequest(1, "newer")),
        (WriteProjectIDRequest(1), WriteProjectIDRequest(2)),
        (DeleteActionRequest(1), DeleteActionRequest(1)),
    ],
)
def test_some_requests_of_one_lane_wait_for_each_other(one: Request[Any], other: Request[Any], trace: Trace) -> None:
    assert trace.slots.obstacle(one, [other]) is Obstacle.WAIT
    slot = trace.send("X#1", one)
    assert trace.slots.obstacle(other) is Obstacle.WAIT
    trace.slots.expire(slot)
    assert trace.slots.obstacle(other) is Obstacle.FENCE


@pytest.mark.parametrize(
    ("one", "other"),
    [(TELEMETRY, TELEMETRY), (ask(1), ask(2)), (add(1), add(2)), (TELEMETRY, add(1)), (POWER, ExecuteActionRequest())],
)
def test_others_do_not(one: Request[Any], other: Request[Any] | Command, trace: Trace) -> None:
    assert trace.slots.obstacle(other, [one]) is Obstacle.NONE
    trace.send("X#1", one)
    assert trace.slots.obstacle(other) is Obstacle.NONE


def test_an_equal_query_waits_while_others_are_open_on_its_lane(trace: Trace) -> None:
    trace.send("A#1", ask(1))
    trace.send("A#2", ask(1))  # perhaps a repeat
    assert trace.slots.obstacle(ask(1)) is Obstacle.NONE
    assert trace.slots.obstacle(ask(2)) is Obstacle.NONE
    trace.send("B#3", ask(2))
    assert trace.slots.obstacle(ask(1)) is Obstacle.WAIT
    assert trace.slots.obstacle(ask(3)) is Obstacle.NONE


def test_an_overdue_slot_asks_for_a_fence_before_a_new_equal_query_or_command(trace: Trace) -> None:
    trace.send("T#1", TELEMETRY, overdue=True)
    assert trace.slots.obstacle(TELEMETRY) is Obstacle.FENCE_BESIDE
    assert trace.slots.obstacle(POWER) is Obstacle.NONE
    trace.slots.clear()
    trace.send("C#1", add(1), overdue=True)
    assert trace.slots.obstacle(add(2)) is Obstacle.FENCE_BESIDE
    assert trace.slots.obstacle(ask(1)) is Obstacle.NONE
    trace.slots.clear()
    trace.send("A#1", ask(1), overdue=True)
    assert trace.slots.obstacle(ask(2)) is Obstacle.NONE  # its key tells it from the overdue one


def test_with_many_overdue_slots_only_fences_are_sent(trace: Trace) -> None:
    for number in range(FENCES_ONLY):
        assert trace.slots.obstacle(POWER) is Obstacle.NONE
        trace.send(f"A#{number}", ask(number + 1), overdue=True)
    assert trace.slots.obstacle(POWER) is Obstacle.FENCE
    trace.send("P", POWER)
    assert trace.hear(QueryRemainPowerResponse(1)) is not None
    assert trace.slots.obstacle(TELEMETRY) is Obstacle.NONE
    assert QueryProjectIDResponse.packet_id in trace.slots.lanes


# --- whose response is next ---------------------------------------------------------------------------------------


def caller(request: Request[Any] = TELEMETRY, *, is_over: bool = False) -> Call:
    return Call(request, 3.0, 0.0, is_over=is_over)


def opened(slots: Slots, owner: Call | None, request: Request[Any] = TELEMETRY, *, is_fence: bool = False) -> Slot:
    slot = Slot(request, slots.lanes[request.packet_id + 1], owner, is_fence=is_fence)
    slots.open(slot)
    if owner is not None and not is_fence:
        owner.open_slots += 1
        owner.latest = slot
    return slot


def test_each_caller_hands_its_slot_down_to_the_next_one() -> None:
    slots, lost, callers = Slots(), caller(), [caller() for _ in range(3)]
    of_callers = [opened(slots, each) for each in callers]
    assert of_callers[0].lane.hand_down(lost) is callers[2]
    assert [slot.call for slot in of_callers] == [lost, *callers[:2]]
    assert [each.latest for each in (lost, *callers[:2])] == of_callers
    assert [each.open_slots for each in (lost, *callers)] == [1, 1, 1, 0]


def test_the_slot_of_a_call_that_is_over_ends_that() -> None:
    slots, lost, callers = Slots(), caller(), [caller(), caller(is_over=True), caller()]
    of_callers = [opened(slots, each) for each in callers]
    assert of_callers[0].lane.hand_down(lost) is callers[0]
    assert [slot.call for slot in of_callers] == [lost, callers[0], callers[2]]


def test_fences_and_other_requests_are_not_handed_down() -> None:
    slots, lost, other = Slots(), caller(POWER), caller(ask(1))
    fence = opened(slots, other, POWER, is_fence=True)
    assert fence.lane.hand_down(lost) is lost
    assert fence.call is other
    slot = opened(slots, other, ask(1))
    assert slot.lane.hand_down(wanted := caller(ask(2))) is wanted
    opened(slots, caller(ask(2)), ask(2))
    assert slot.lane.hand_down(wanted) is wanted
    assert slot.call is other


def test_on_a_lane_that_was_stopped_nothing_is_handed_down() -> None:
    slots, mover, lost = Slots(), caller(STOP), caller(STOP)
    slot = opened(slots, mover, STOP)
    slots.open_stop(Slot(STOP, slot.lane, None))
    assert slot.lane.hand_down(lost) is lost
    assert slot.call is mover


def test_a_slot_that_is_overdue_is_not_handed_down_as_it_wakes_nobody() -> None:
    slots, lost, callers = Slots(), caller(), [caller(), caller()]
    late, awaited = (opened(slots, each) for each in callers)
    slots.expire(late)
    assert late.lane.hand_down(lost) is callers[1]
    assert (late.call, awaited.call, lost.latest) == (callers[0], lost, awaited)
