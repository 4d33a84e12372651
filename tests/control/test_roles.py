"""The role that each of the document's requests needs, and which of them move a robot."""

from __future__ import annotations

import pytest
from msgspec.structs import fields

from servolink.control.rights import Role
from servolink.motion import carries_angles
from servolink.protocol import ALL_SERVOS, PACKETS, ButtonEventResponse, Effect, Packet, SetServoParameterRequest
from tests.protocol.declared import DOCUMENT

REQUESTS = [each["name"] for each in DOCUMENT["packets"] if each["direction"] == "client-to-server"]

ROLES = {
    "TransmissionModeSettingRequest": Role.WATCH,
    "ClearAllDataRequest": Role.EDIT,
    "QueryMemorySizeRequest": Role.WATCH,
    "QueryRemainPowerRequest": Role.WATCH,
    "SendDummyDataRequest": Role.WATCH,
    "QueryServoListRequest": Role.WATCH,
    "QueryServoRequest": Role.WATCH,
    "SetServoParameterRequest": Role.MOVE,
    "SetAngleUnitRequest": Role.WATCH,
    "ExecuteActionRequest": Role.MOVE,
    "ExecuteActionExRequest": Role.RUN,
    "QueryActionListRequest": Role.WATCH,
    "QueryActionRequest": Role.WATCH,
    "AddActionRequest": Role.EDIT,
    "DeleteActionRequest": Role.EDIT,
    "QueryMacroListRequest": Role.WATCH,
    "QueryMacroRequest": Role.WATCH,
    "AddMacroRequest": Role.EDIT,
    "DeleteMacroRequest": Role.EDIT,
    "ExecuteMacroRequest": Role.RUN,
    "QueryServoParameterRequest": Role.WATCH,
    "AddServoParameterRequest": Role.EDIT,
    "WriteProjectIDRequest": Role.EDIT,
    "QueryProjectIDRequest": Role.WATCH,
    "QueryJoystickTableListRequest": Role.WATCH,
    "QueryJoystickTableRequest": Role.WATCH,
    "AddJoystickTableRequest": Role.EDIT,
    "DeleteJoystickTableRequest": Role.EDIT,
    "SetActiveJoystickTableRequest": Role.RUN,
    "QueryActiveJoystickTableRequest": Role.WATCH,
    "SubscribeButtonEventRequest": Role.WATCH,
}

MOTIONS = {
    "SetServoParameterRequest",
    "ExecuteActionRequest",
    "ExecuteActionExRequest",
    "ExecuteMacroRequest",
    "AddServoParameterRequest",
}
ANGLES = {
    "QueryServoRequest",
    "ExecuteActionRequest",
    "ExecuteActionExRequest",
    "ExecuteMacroRequest",
    "AddServoParameterRequest",
}


def example(name: str) -> Packet:
    """Return a packet of this name whose numbers are all 1 and whose lists are empty; 20030 starts and holds."""
    declared = PACKETS.by_name[name]
    required = [field for field in fields(declared) if field.required]
    return declared(*(1 for _ in required))


def test_every_request_of_the_document_has_its_role() -> None:
    assert {name: Role.needed_for(example(name)) for name in REQUESTS} == ROLES


def test_motions_need_the_lease_and_nothing_else_does() -> None:
    assert {name for name in REQUESTS if example(name).is_motion} == MOTIONS


def test_angles_are_in_servo_states_movements_and_what_is_stored() -> None:
    assert {name for name in REQUESTS if carries_angles(example(name))} == ANGLES


def test_nothing_that_a_watcher_may_send_moves_or_writes() -> None:
    changing = {name for name in REQUESTS if name.startswith(("Add", "Delete", "Write", "Clear"))}
    allowed = {name for name in REQUESTS if Role.needed_for(example(name)) == Role.WATCH}
    assert allowed & (MOTIONS | changing) == set()


def test_unknown_packets_need_the_highest_role() -> None:
    assert Role.needed_for(ButtonEventResponse(1, 1)) == Role.EDIT


@pytest.mark.parametrize("servo_id", [0, 1, 254, ALL_SERVOS])
def test_anybody_may_stop(servo_id: int) -> None:
    packet = SetServoParameterRequest(servo_id, 0, 1)
    assert (packet.effect is Effect.STOPS, packet.is_motion, Role.needed_for(packet)) == (True, False, Role.WATCH)


@pytest.mark.parametrize("flags", [(1, 1), (1, 0), (0, 0), (0, 2), (2, 1)])
def test_releasing_and_starting_are_motions(flags: tuple[int, int]) -> None:
    packet = SetServoParameterRequest(1, *flags)
    assert (packet.effect is Effect.STOPS, packet.is_motion, Role.needed_for(packet)) == (False, True, Role.MOVE)


def test_each_role_includes_those_before_it() -> None:
    assert [str(role) for role in sorted(Role)] == ["watch", "run", "move", "edit"]
