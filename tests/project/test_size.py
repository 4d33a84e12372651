"""What a project takes of a board's memory."""

from __future__ import annotations

import pytest

from servolink.project.model import Project, stored_size
from servolink.protocol import (
    OVERHEAD,
    RECORD_TYPES,
    Action,
    AddServoParameterRequest,
    Button,
    Codec,
    JoystickTable,
    Macro,
    MacroCommand,
    Record,
    ServoParameter,
    Step,
)

WAVE = Action(1, "wave", (Step(1, 30, 50), Step(2, -30, 50)))
SHOW = Macro(1, "show", (MacroCommand(1), MacroCommand(500, 1), MacroCommand(1)))
PAD = JoystickTable(1, "pad", (Button(4, "A", 1),))


@pytest.mark.parametrize(("record", "size"), [(WAVE, 48), (SHOW, 74), (PAD, 87), (Action(2), 38)])
def test_a_record_takes_its_length_on_the_wire(record: Record, size: int) -> None:
    kind = next(kind for kind in RECORD_TYPES if isinstance(record, kind.record_class))
    assert stored_size(record) == size == len(Codec().encode(kind.add(record))) - OVERHEAD


def test_servo_parameters_take_what_each_adds_to_their_request() -> None:
    one, two = (len(Codec().encode(AddServoParameterRequest((ServoParameter(1),) * count))) for count in (1, 2))
    assert stored_size(ServoParameter(1, 3, "elbow")) == two - one == 35


def test_a_project_takes_what_its_records_take_and_nothing_for_parameters_that_say_nothing() -> None:
    parameters = (ServoParameter(1, 3, "elbow"), ServoParameter(2))
    assert (Project(7, parameters, (WAVE,), (SHOW,), (PAD,), 1)).total_size() == 35 + 48 + 74 + 87
    assert Project(7).total_size() == 0
