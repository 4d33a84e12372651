"""Units of servos: what is stored after each answer, and the requests from one set of units to another."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from servolink.motion.angles import AngleUnit, ServoUnits
from servolink.protocol import ALL_SERVOS, SetAngleUnitRequest

SERVOS = (1, 2, 3)
requests = st.builds(SetAngleUnitRequest, st.sampled_from([*SERVOS, ALL_SERVOS]), st.integers(0, 1))
units_of_all = st.sampled_from(["degree", "adc"])


def after(unit: AngleUnit | None, accepted: list[SetAngleUnitRequest]) -> ServoUnits:
    units = ServoUnits(unit)
    for request in accepted:
        units.set(request)
        assert units.has(request)
    return units


@given(units_of_all, st.lists(requests))
def test_units_are_those_of_a_board_that_accepted_the_same(
    unit: AngleUnit, accepted: list[SetAngleUnitRequest]
) -> None:
    units, board = after(unit, accepted), dict[int, AngleUnit]((servo_id, unit) for servo_id in SERVOS)
    for request in accepted:
        for servo_id in board if request.servo_id == ALL_SERVOS else [request.servo_id]:
            board[servo_id] = "adc" if request.unit_type else "degree"
    assert {servo_id: units.of(servo_id) for servo_id in board} == board


@given(
    st.one_of(st.none(), units_of_all),
    st.lists(requests),
    units_of_all,
    st.lists(requests),
    st.one_of(st.none(), st.sets(st.sampled_from(SERVOS))),
)
def test_the_requests_needed_lead_from_one_set_of_units_to_the_other(
    first: AngleUnit | None,
    before: list[SetAngleUnitRequest],
    unit: AngleUnit,
    accepted: list[SetAngleUnitRequest],
    servo_ids: set[int] | None,
) -> None:
    units, wanted = after(first, before), after(unit, accepted)
    for request in units.needed(wanted, servo_ids):
        units.set(request)
    assert units.needed(wanted, servo_ids) == ()
    for servo_id in SERVOS if servo_ids is None else servo_ids:
        assert units.of(servo_id) == wanted.of(servo_id)
    if servo_ids is None:
        assert units == wanted


def test_units_that_are_not_known_are_not_asked_for() -> None:
    assert ServoUnits("adc").needed(ServoUnits()) == ()
    units = ServoUnits()
    units.set(SetAngleUnitRequest(3, 1))
    units.forget(2)
    assert ServoUnits().needed(units) == (SetAngleUnitRequest(3, 1),)


def test_a_lost_answer_makes_one_unit_unknown_or_all() -> None:
    units = after("degree", [SetAngleUnitRequest(2, 1)])
    units.forget(2)
    assert [units.of(servo_id) for servo_id in (1, 2)] == ["degree", None]
    units.forget()
    assert units == ServoUnits()
