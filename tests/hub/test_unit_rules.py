"""Units of the board between programs that want different ones: an angle is never read in another's unit."""

from __future__ import annotations

import math

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from servolink.hub.engine.unit_switch import UnitReservation
from servolink.motion import AngleUnit, ServoUnits, is_accepted, servos_concerned, unit_request
from servolink.protocol import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    QueryActionRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
    Step,
)

ALL_DEGREE, ALL_ADC = SetAngleUnitRequest(ALL_SERVOS, 0), SetAngleUnitRequest(ALL_SERVOS, 1)
SERVOS = (1, 2, 3)
MISSING = 9

programs = st.sampled_from(["ann", "bob", "cid"])
servo_ids = st.sampled_from([*SERVOS, MISSING, ALL_SERVOS])
fates = st.sampled_from(["answered", "answered", "lost before", "lost after"])
packets = st.one_of(
    st.builds(QueryServoRequest, servo_ids),
    st.lists(st.builds(Step, servo_ids, st.just(0), st.just(0)), max_size=3).map(
        lambda steps: ExecuteActionRequest(tuple(steps))
    ),
    st.sampled_from([ExecuteMacroRequest(1), ExecuteActionExRequest(1), QueryActionRequest(1)]),
)


class Units(RuleBasedStateMachine):
    """Three programs on one board, which loses responses and is switched off and on."""

    def __init__(self) -> None:
        super().__init__()
        self.units = ServoUnits()
        self.programs = {"ann": ServoUnits("degree"), "bob": ServoUnits("adc"), "cid": ServoUnits("degree")}
        self.board: dict[int, AngleUnit] = {1: "degree", 2: "adc", 3: "adc"}

    def ask(self, request: SetAngleUnitRequest, fate: str) -> bool:
        """Do what the hub does with a request; return whether it was accepted."""
        if fate == "lost before":
            self.units.forget()
            return False
        addressed = SERVOS if request.servo_id == ALL_SERVOS else [request.servo_id]
        response = SetAngleUnitResponse(request.servo_id, request.unit_type)
        if MISSING in addressed:
            response = SetAngleUnitResponse(0, 1 - request.unit_type)
        else:
            self.board |= dict.fromkeys(addressed, "adc" if request.unit_type else "degree")
        if fate == "lost after":
            self.units.forget()
            return False
        if is_accepted(request, response):
            self.units.set(request)
            return True
        self.units.forget(request.servo_id)
        return False

    @rule(program=programs, servo_id=servo_ids, unit_type=st.integers(0, 1), fate=fates)
    def set_unit(self, program: str, servo_id: int, unit_type: int, fate: str) -> None:
        request = SetAngleUnitRequest(servo_id, unit_type)
        if self.ask(request, fate):
            self.programs[program].set(request)

    @rule(program=programs, packet=packets, fate=fates)
    def send(self, program: str, packet: Packet, fate: str) -> None:
        wanted, servo_ids = self.programs[program], servos_concerned(packet)
        for request in self.units.needed(wanted, servo_ids):
            if not self.ask(request, fate):
                assert fate != "answered", "a board rejects units of servos that it does not have"
                return  # the packet is not sent
        assert self.units.needed(wanted, servo_ids) == ()
        for servo_id in concerned(packet):
            assert self.board[servo_id] == wanted.of(servo_id)

    @rule()
    def reconnect(self) -> None:
        self.board = dict.fromkeys(SERVOS, "degree")
        self.units.forget()


def concerned(packet: Packet) -> set[int]:
    """Return the servos of the board whose angles a packet sends or asks for."""
    match packet:
        case QueryActionRequest():
            return set()
        case QueryServoRequest():
            named = {packet.servo_id}
        case ExecuteActionRequest():
            named = {step.servo_id for step in packet.steps}
        case _:
            return set(SERVOS)
    return set(SERVOS) if ALL_SERVOS in named else named - {MISSING}


TestUnits = Units.TestCase


def known(*accepted: SetAngleUnitRequest) -> ServoUnits:
    units = ServoUnits()
    for request in accepted:
        units.set(request)
    return units


def program(unit: AngleUnit = "degree", **units: AngleUnit) -> ServoUnits:
    return known(
        unit_request(ALL_SERVOS, unit),
        *(unit_request(int(name.removeprefix("servo_")), own) for name, own in units.items()),
    )


def needed(units: ServoUnits, packet: Packet, wanted: ServoUnits) -> tuple[SetAngleUnitRequest, ...]:
    return units.needed(wanted, servos_concerned(packet))


def test_programs_with_the_same_unit_cost_one_request() -> None:
    assert needed(ServoUnits(), QueryServoRequest(1), program()) == (ALL_DEGREE,)
    units = known(ALL_DEGREE)
    assert needed(units, QueryServoRequest(1), program()) == ()
    assert needed(units, QueryServoRequest(1), program("adc")) == (ALL_ADC,)


def test_a_servo_with_its_own_unit_is_set_by_a_request_of_its_own() -> None:
    units = known(ALL_DEGREE)
    assert needed(units, QueryServoRequest(2), program(servo_2="adc")) == (SetAngleUnitRequest(2, 1),)
    units = known(ALL_DEGREE, SetAngleUnitRequest(2, 1))
    assert needed(units, QueryServoRequest(ALL_SERVOS), program()) == (SetAngleUnitRequest(2, 0),)
    assert needed(units, QueryServoRequest(1), program()) == ()


def test_packets_without_angles_need_no_unit() -> None:
    assert needed(ServoUnits(), QueryActionRequest(1), program()) == ()
    assert needed(ServoUnits(), ExecuteActionRequest(()), program()) == ()


@pytest.mark.parametrize(
    ("request_", "holder", "may_set"),
    [
        (ALL_DEGREE, program(), True),
        (ALL_ADC, program(), False),
        (SetAngleUnitRequest(1, 0), program(servo_2="adc"), True),
        (SetAngleUnitRequest(2, 0), program(servo_2="adc"), False),
        (ALL_DEGREE, program(servo_2="adc"), False),
    ],
)
def test_units_stay_while_the_macro_of_another_program_runs(
    request_: SetAngleUnitRequest, holder: ServoUnits, *, may_set: bool
) -> None:
    units, other = UnitReservation(), program("adc")
    units.keep_for(holder, 10.0)
    assert units.allows(request_, other, 9.9) == may_set
    assert units.allows(request_, holder, 9.9)
    assert units.allows(request_, other, 10.0)
    units.release()
    assert units.allows(request_, other, 9.9)


def test_a_macro_of_unknown_end_is_over_when_the_servos_rest() -> None:
    units, holder, other = UnitReservation(), program(), program("adc")
    units.keep_for(holder, math.inf)
    assert not units.allows(ALL_ADC, other, 1e9)
    units.rested()
    assert units.allows(ALL_ADC, other, 0.0)
    units.keep_for(holder, 10.0)
    units.rested()  # in a pause of the macro
    assert not units.allows(ALL_ADC, other, 9.0)
