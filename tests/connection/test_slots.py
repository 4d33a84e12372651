"""Slots: which request a response belongs to."""

from __future__ import annotations

import pytest

from servolink.protocol import (
    PACKETS,
    DeleteActionRequest,
    DeleteActionResponse,
    QueryRemainPowerResponse,
    Request,
    SetActiveJoystickTableRequest,
)
from tests.connection.slot_trace import (
    DONE,
    FAILED,
    NONE,
    POWER,
    PROJECT,
    TELEMETRY,
    UNREADABLE,
    Trace,
    add,
    angles,
    ask,
    said,
)


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
    assert trace.slots.unmatched == 0
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
    assert trace.slots.unmatched == 2
    assert trace.hear(DONE) == [("C#1", DONE), ("D#2", FAILED), ("E#3", DONE)]
    assert trace.slots.unmatched == 0


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
    assert trace.slots.unmatched == 0


def test_an_exact_response_leaves_nothing_kept(trace: Trace) -> None:
    """A board that breaks the order: what is kept cannot belong to what is still open."""
    trace.send("P#1", POWER)
    trace.send("C#2", add(1))
    trace.send("D#3", add(2))
    trace.hear(DONE)
    assert trace.hear(QueryRemainPowerResponse(1)) == [("P#1", QueryRemainPowerResponse(1))]
    assert trace.slots.unmatched == 0
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
