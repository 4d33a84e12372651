"""Units of the board between programs that want different ones: an angle is never read in another's unit."""

from __future__ import annotations

import math

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from servolink.hub.rules.session_state import SessionState
from servolink.hub.rules.units import BoardUnits
from servolink.motion.angles import AngleUnit
from servolink.protocol.editing import ExecuteMacroRequest, QueryActionRequest
from servolink.protocol.packet import Packet
from servolink.protocol.records import Step
from servolink.protocol.servos import (
    ALL_SERVOS,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    QueryServoRequest,
    SetAngleUnitRequest,
    SetAngleUnitResponse,
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
        self.units = BoardUnits()
        self.states = {"ann": SessionState("degree"), "bob": SessionState("adc"), "cid": SessionState("degree")}
        self.board: dict[int, AngleUnit] = {1: "degree", 2: "adc", 3: "adc"}

    def ask(self, request: SetAngleUnitRequest, fate: str) -> bool:
        """Do what the hub does with a request; return whether it was accepted."""
        self.units.asking(request)
        if fate == "lost before":
            return False
        addressed = SERVOS if request.servo_id == ALL_SERVOS else [request.servo_id]
        response = SetAngleUnitResponse(request.servo_id, request.unit_type)
        if MISSING in addressed:
            response = SetAngleUnitResponse(0, 1 - request.unit_type)
        else:
            self.board |= dict.fromkeys(addressed, "adc" if request.unit_type else "degree")
        return fate == "answered" and self.units.answered(request, response)

    @rule(program=programs, servo_id=servo_ids, unit_type=st.integers(0, 1), fate=fates)
    def set_unit(self, program: str, servo_id: int, unit_type: int, fate: str) -> None:
        request = SetAngleUnitRequest(servo_id, unit_type)
        if self.ask(request, fate):
            self.states[program].set_unit(request)

    @rule(program=programs, packet=packets, fate=fates)
    def send(self, program: str, packet: Packet, fate: str) -> None:
        state = self.states[program]
        for request in self.units.needed(packet, state):
            if not self.ask(request, fate):
                assert fate != "answered", "a board rejects units of servos that it does not have"
                return  # the packet is not sent
        assert self.units.needed(packet, state) == ()
        for servo_id in concerned(packet):
            assert self.board[servo_id] == state.unit_of(servo_id)

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


def known(*accepted: SetAngleUnitRequest) -> BoardUnits:
    units = BoardUnits()
    for request in accepted:
        units.asking(request)
        assert units.answered(request, SetAngleUnitResponse(request.servo_id, request.unit_type))
    return units


def program(unit: AngleUnit = "degree", **units: AngleUnit) -> SessionState:
    state = SessionState(unit)
    state.units = {int(name.removeprefix("servo_")): unit for name, unit in units.items()}
    return state


def test_programs_with_the_same_unit_cost_one_request() -> None:
    units = BoardUnits()
    assert units.needed(QueryServoRequest(1), program()) == (ALL_DEGREE,)
    units = known(ALL_DEGREE)
    assert units.needed(QueryServoRequest(1), program()) == ()
    assert units.needed(QueryServoRequest(1), program("adc")) == (ALL_ADC,)


def test_a_servo_with_its_own_unit_is_set_alone() -> None:
    units = known(ALL_DEGREE)
    assert units.needed(QueryServoRequest(2), program(servo_2="adc")) == (SetAngleUnitRequest(2, 1),)
    units = known(ALL_DEGREE, SetAngleUnitRequest(2, 1))
    assert units.needed(QueryServoRequest(ALL_SERVOS), program()) == (SetAngleUnitRequest(2, 0),)
    assert units.needed(QueryServoRequest(1), program()) == ()


def test_packets_without_angles_need_no_unit() -> None:
    assert BoardUnits().needed(QueryActionRequest(1), program()) == ()
    assert BoardUnits().needed(ExecuteActionRequest(()), program()) == ()


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
    request_: SetAngleUnitRequest, holder: SessionState, *, may_set: bool
) -> None:
    units, other = known(ALL_DEGREE), program("adc")
    units.keep_for(holder, 10.0)
    assert units.may_set(request_, other, 9.9) == may_set
    assert units.may_set(request_, holder, 9.9)
    assert units.may_set(request_, other, 10.0)
    units.release()
    assert units.may_set(request_, other, 9.9)


def test_a_macro_of_unknown_end_is_over_when_the_servos_rest() -> None:
    units, holder, other = known(ALL_DEGREE), program(), program("adc")
    units.keep_for(holder, math.inf)
    assert not units.may_set(ALL_ADC, other, 1e9)
    units.rested()
    assert units.may_set(ALL_ADC, other, 0.0)
    units.keep_for(holder, 10.0)
    units.rested()  # in a pause of the macro
    assert not units.may_set(ALL_ADC, other, 9.0)
