"""Slots: which sending a response settles, rule by rule, and the traces with which simpler rules go wrong."""

from __future__ import annotations

from typing import Any

import pytest

from servolink.connection.call import Call, Content, Slot
from servolink.connection.slots import FENCES_ONLY, Obstacle, Slots
from servolink.errors import DecodeError
from servolink.protocol.codec import PACKETS
from servolink.protocol.editing import (
    AddActionRequest,
    AddActionResponse,
    DeleteActionRequest,
    DeleteActionResponse,
    ExecuteMacroRequest,
    QueryActionRequest,
    QueryActionResponse,
    QueryProjectIDRequest,
    QueryProjectIDResponse,
    WriteProjectIDRequest,
)
from servolink.protocol.joystick import SetActiveJoystickTableRequest
from servolink.protocol.packet import Command, Request, Response
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionRequest,
    QueryServoRequest,
    QueryServoResponse,
    ServoState,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SetServoParameterResponse,
)
from servolink.protocol.settings import (
    ClearAllDataRequest,
    QueryRemainPowerRequest,
    QueryRemainPowerResponse,
    SendDummyDataRequest,
    TransmissionModeSettingRequest,
)

TELEMETRY = QueryServoRequest(ALL_SERVOS)
PROJECT, POWER = QueryProjectIDRequest(), QueryRemainPowerRequest()
STOP = SetServoParameterRequest(ALL_SERVOS, 0, 1)
DONE, FAILED = AddActionResponse(1), AddActionResponse(0)
NONE = QueryActionResponse(0)
UNREADABLE = DecodeError("the count does not fit the length")


def ask(key: int) -> QueryActionRequest:
    return QueryActionRequest(key)


def said(key: int, caption: str = "") -> QueryActionResponse:
    return QueryActionResponse(key, caption)


def add(key: int) -> AddActionRequest:
    return AddActionRequest(key)


def angles(number: int) -> QueryServoResponse:
    return QueryServoResponse(tuple(ServoState(servo_id, number, 0, 0, 0, 0, 1) for servo_id in (1, 2)))


class Trace:
    """Slots under names, and what becomes of them."""

    def __init__(self) -> None:
        self.slots = Slots()
        self._names: dict[Slot, str] = {}

    def send(self, name: str, request: Request[Any], *, overdue: bool = False) -> Slot:
        slot = Slot(request, self.slots.lanes[request.packet_id + 1], None)
        self._names[slot] = name
        self.slots.open(slot)
        if overdue:
            self.slots.expire(slot)
        return slot

    def stop(self, name: str) -> None:
        slot = Slot(STOP, self.slots.lanes[STOP.packet_id + 1], None)
        self._names[slot] = name
        self.slots.open_stop(slot)

    def hear(self, content: Response, response_id: int | None = None) -> list[tuple[str, Content | None]] | None:
        return self._named(self.slots.settle(response_id or content.packet_id, content))

    def hear_unreadable(self, request: Request[Any]) -> list[tuple[str, Content | None]] | None:
        return self._named(self.slots.settle(request.packet_id + 1, UNREADABLE))

    def _named(self, settled: list[tuple[Slot, Content | None]] | None) -> list[tuple[str, Content | None]] | None:
        assert settled is None or all(not slot.open for slot, _ in settled)
        return None if settled is None else [(self._names[slot], content) for slot, content in settled]

    @property
    def open(self) -> str:
        lanes = self.slots.lanes.values()
        open_slots = {slot for lane in lanes for slot in lane.slots}
        assert all(slot.open == (slot in open_slots) for slot in self._names)
        return " ".join(name for slot, name in self._names.items() if slot.open)


@pytest.fixture
def trace() -> Trace:
    return Trace()


def test_each_request_has_the_lane_of_its_response_and_no_two_share_one(trace: Trace) -> None:
    requests = [declared.packet_id for declared in PACKETS.values() if issubclass(declared, Request)]
    assert [lane.response_id for lane in trace.slots.lanes.values()] == [packet_id + 1 for packet_id in requests]
    assert len(trace.slots.lanes) == 28


# --- candidates -----------------------------------------------------------------------------------------------------


def test_a_response_without_a_candidate_settles_nothing(trace: Trace) -> None:
    assert trace.hear(angles(1)) is None
    trace.send("A#1", ask(1))
    assert trace.hear(said(2)) is None
    assert trace.hear(said(1), response_id=12345) is None
    trace.send("B#2", ask(2))
    assert trace.hear(said(3)) is None
    assert trace.open == "A#1 B#2"


def test_one_candidate_is_exact_and_settles_all_that_is_older_on_every_lane(trace: Trace) -> None:
    trace.send("A#1", ask(1))
    trace.send("T#2", TELEMETRY)
    trace.send("C#3", add(1))
    trace.send("B#4", ask(2))
    trace.send("P#5", POWER)
    assert trace.hear(said(2, "b")) == [("A#1", None), ("T#2", None), ("C#3", None), ("B#4", said(2, "b"))]
    assert trace.open == "P#5"


def test_the_content_of_an_unreadable_response_fits_all(trace: Trace) -> None:
    trace.send("A#1", ask(1))
    assert trace.hear_unreadable(ask(1)) == [("A#1", UNREADABLE)]
    trace.send("A#2", ask(1))
    trace.send("B#3", ask(2))
    assert trace.hear_unreadable(ask(1)) == []  # kept: it may be the response to either
    assert trace.hear(said(2)) == [("A#2", UNREADABLE), ("B#3", said(2))]


# --- equal queries --------------------------------------------------------------------------------------------------


def test_the_oldest_of_equal_queries_gets_the_response(trace: Trace) -> None:
    for name in ("T#1", "T#2", "T#3"):
        trace.send(name, TELEMETRY)
    assert trace.hear(angles(1)) == [("T#1", angles(1))]
    assert trace.hear(angles(2)) == [("T#2", angles(2))]
    assert trace.hear(angles(3)) == [("T#3", angles(3))]
    assert trace.open == ""


def test_with_equal_queries_only_what_is_older_than_the_oldest_is_over(trace: Trace) -> None:
    trace.send("P#1", POWER)
    trace.send("T#2", TELEMETRY)
    trace.send("J#3", PROJECT)
    trace.send("T#4", TELEMETRY)
    assert trace.hear(angles(1)) == [("P#1", None), ("T#2", angles(1))]
    assert trace.open == "J#3 T#4"


def test_equal_queries_settle_no_lane_that_keeps_a_response(trace: Trace) -> None:
    trace.send("C#1", add(1))
    trace.send("D#2", add(2))
    trace.send("T#3", TELEMETRY)
    trace.send("T#4", TELEMETRY)
    assert trace.hear(DONE) == []
    assert trace.hear(angles(1)) == [("T#3", angles(1))]
    assert trace.open == "C#1 D#2 T#4"
    assert trace.hear(angles(2)) == [("C#1", None), ("D#2", None), ("T#4", angles(2))]  # one for two: nobody's


def test_equal_queries_drop_what_their_own_lane_keeps(trace: Trace) -> None:
    """A#1 lost, B#2 "none", B#3 answered: "none" must not go to A."""
    trace.send("A#1", ask(1))
    trace.send("B#2", ask(2))
    trace.send("B#3", ask(2))
    assert trace.hear(NONE) == []
    assert trace.hear(said(2)) == [("A#1", None), ("B#2", said(2))]
    assert trace.slots.kept == 0
    assert trace.open == "B#3"


def test_repeatable_settings_are_treated_as_queries(trace: Trace) -> None:
    trace.send("S#1", SetActiveJoystickTableRequest(1))
    trace.send("S#2", SetActiveJoystickTableRequest(1))
    [settled] = trace.slots.settle(SetActiveJoystickTableRequest.packet_id + 1, FAILED) or []
    assert settled[1] is FAILED
    assert trace.open == "S#2"


def test_equal_commands_are_not(trace: Trace) -> None:
    """Nothing opens two; if it did, neither would get the result of the other."""
    trace.send("C#1", add(1))
    trace.send("C#2", add(1))
    assert trace.hear(DONE) == []


# --- kept responses -------------------------------------------------------------------------------------------------


def test_as_many_kept_responses_as_open_slots_are_theirs_in_order(trace: Trace) -> None:
    trace.send("C#1", add(1))
    trace.send("D#2", add(2))
    trace.send("E#3", add(3))
    assert trace.hear(DONE) == []
    assert trace.hear(FAILED) == []
    assert trace.slots.kept == 2
    assert trace.hear(DONE) == [("C#1", DONE), ("D#2", FAILED), ("E#3", DONE)]
    assert trace.slots.kept == 0


def test_a_later_proof_delivers_as_many_kept_responses_as_there_are_older_slots(trace: Trace) -> None:
    trace.send("C#1", add(1))
    trace.send("D#2", add(2))
    trace.send("P#3", POWER)
    trace.send("E#4", add(3))
    trace.hear(DONE)
    trace.hear(FAILED)
    power = QueryRemainPowerResponse(5)
    assert trace.hear(power) == [("C#1", DONE), ("D#2", FAILED), ("P#3", power)]
    assert trace.hear(DONE) == [("E#4", DONE)]


def test_fewer_kept_responses_than_older_slots_belong_to_nobody(trace: Trace) -> None:
    trace.send("C#1", add(1))
    trace.send("D#2", add(2))
    trace.send("P#3", POWER)
    trace.hear(DONE)
    power = QueryRemainPowerResponse(5)
    assert trace.hear(power) == [("C#1", None), ("D#2", None), ("P#3", power)]
    assert trace.slots.kept == 0


def test_an_exact_response_leaves_nothing_kept(trace: Trace) -> None:
    """A board that breaks the order: what is kept cannot belong to what is still open."""
    trace.send("P#1", POWER)
    trace.send("C#2", add(1))
    trace.send("D#3", add(2))
    trace.hear(DONE)
    assert trace.hear(QueryRemainPowerResponse(1)) == [("P#1", QueryRemainPowerResponse(1))]
    assert trace.slots.kept == 0
    assert trace.open == "C#2 D#3"


def test_the_lanes_of_a_settled_part_are_matched_apart(trace: Trace) -> None:
    trace.send("C#1", add(1))
    trace.send("X#2", DeleteActionRequest(7))
    trace.send("D#3", add(2))
    trace.send("Y#4", DeleteActionRequest(8))
    trace.send("P#5", POWER)
    trace.send("E#6", add(3))
    trace.hear(DONE)
    trace.hear(DeleteActionResponse(1))
    trace.hear(FAILED)
    power = QueryRemainPowerResponse(1)
    settled = [("C#1", DONE), ("D#3", FAILED), ("X#2", None), ("Y#4", None), ("P#5", power)]
    assert trace.hear(power) == settled


# --- the counterexamples of docs/design/matching.md -----------------------------------------------------------------


def test_a_slot_is_not_forgotten_when_it_is_overdue(trace: Trace) -> None:
    """Simpler: a slot ends with its timeout. T#1 times out, is answered, T#2 is sent and gets #1: stale."""
    trace.send("T#1", TELEMETRY, overdue=True)
    trace.send("T#2", TELEMETRY)
    assert trace.hear(angles(1)) == [("T#1", angles(1))]
    assert trace.hear(angles(2)) == [("T#2", angles(2))]


def test_responses_are_not_handed_out_in_turn(trace: Trace) -> None:
    """Simpler: the next slot of the lane. A#1 lost, B#2 answered: A would get B."""
    trace.send("A#1", ask(1))
    trace.send("B#2", ask(2))
    assert trace.hear(said(2)) == [("A#1", None), ("B#2", said(2))]


def test_none_does_not_go_to_the_oldest(trace: Trace) -> None:
    """Simpler: "none" to the oldest. A#1 lost, B#2 "none": A would not exist."""
    trace.send("A#1", ask(1))
    trace.send("B#2", ask(2))
    assert trace.hear(NONE) == []
    trace.send("P#3", POWER)
    power = QueryRemainPowerResponse(1)
    assert trace.hear(power) == [("A#1", None), ("B#2", None), ("P#3", power)]


def test_a_result_does_not_go_to_the_oldest(trace: Trace) -> None:
    """Simpler: results to the oldest. C#1 lost, D#2 answered: C would be "done"."""
    trace.send("C#1", add(1))
    trace.send("D#2", add(2))
    assert trace.hear(DONE) == []
    trace.send("A#3", ask(2))  # read back
    assert trace.hear(said(2)) == [("C#1", None), ("D#2", None), ("A#3", said(2))]


def test_the_newest_of_equal_queries_does_not_get_the_response(trace: Trace) -> None:
    """Simpler: the newest of equal ones. T#1 answered, T#2 sent, the response would go to T#2: stale."""
    trace.send("T#1", TELEMETRY)
    trace.send("T#2", TELEMETRY)
    assert trace.hear(angles(1)) == [("T#1", angles(1))]


# --- repeats and fences ---------------------------------------------------------------------------------------------


def test_a_repeat_needs_no_fence_and_the_first_response_settles_its_first_slot(trace: Trace) -> None:
    trace.send("A#1", ask(1), overdue=True)
    trace.send("A#2", ask(1))
    assert trace.hear(said(1)) == [("A#1", said(1))]
    assert trace.hear(said(1)) == [("A#2", said(1))]


def test_the_first_answer_to_a_fence_that_is_still_owed_proves_what_is_older_than_its_first_sending(
    trace: Trace,
) -> None:
    trace.send("T#1", TELEMETRY, overdue=True)
    trace.send("P#2", POWER, overdue=True)
    trace.send("A#3", ask(1), overdue=True)
    trace.send("P#4", POWER)
    assert trace.hear(QueryRemainPowerResponse(1)) == [("T#1", None), ("P#2", QueryRemainPowerResponse(1))]
    assert trace.open == "A#3 P#4"
    assert trace.hear(QueryRemainPowerResponse(2)) == [("A#3", None), ("P#4", QueryRemainPowerResponse(2))]


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
    assert (trace.slots.kept, trace.slots.overdue, list(trace.slots.live)) == (0, 0, [])
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
    assert trace.slots.kept == 1
    trace.stop("stop#3")
    assert trace.slots.kept == 0


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


@pytest.mark.parametrize("alone", ALONE, ids=lambda packet: type(packet).__name__)
def test_some_packets_bear_nothing_beside_them(alone: Request[Any], trace: Trace) -> None:
    others: list[Request[Any] | Command] = [TELEMETRY, add(1), alone, ExecuteActionRequest(), SendDummyDataRequest()]
    assert trace.slots.obstacle(alone) is Obstacle.NONE
    assert all(trace.slots.obstacle(alone, [other]) is Obstacle.WAIT for other in others)
    assert all(trace.slots.obstacle(other, [alone]) is Obstacle.WAIT for other in others)
    slot = trace.send("P#1", POWER)
    assert trace.slots.obstacle(alone) is Obstacle.WAIT
    trace.slots.expire(slot)
    assert trace.slots.obstacle(alone) is Obstacle.FENCE
    trace.slots.clear()
    slot = trace.send("X#2", alone)
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
    return Call(request, 3.0, 0, 0.0, is_over=is_over)


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
