"""What a hub asks of the program that sends a packet: a role, and the lease for motion. Its clients ask that, too."""

from __future__ import annotations

from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.packet import Packet, Query
from servolink.transports.share import RoleName

_ROLES: dict[type[Packet], RoleName] = {
    # The mode, the unit and the subscription belong to one program (`SessionState`): others do not notice them.
    settings.TransmissionModeSettingRequest: "watch",
    servos.SetAngleUnitRequest: "watch",
    joystick.SubscribeButtonEventRequest: "watch",
    settings.SendDummyDataRequest: "watch",
    servos.ExecuteActionExRequest: "run",
    editing.ExecuteMacroRequest: "run",
    joystick.SetActiveJoystickTableRequest: "run",
    servos.SetServoParameterRequest: "move",
    servos.ExecuteActionRequest: "move",
}
"""The role that a packet needs, if it is neither a query nor a change of what is stored."""

_MOTIONS = (
    servos.SetServoParameterRequest,
    servos.ExecuteActionRequest,
    servos.ExecuteActionExRequest,
    editing.ExecuteMacroRequest,
    editing.AddServoParameterRequest,  # a servo turns to its new correction at once
)


def needed_role_name(packet: Packet) -> RoleName:
    """Return the lowest role that may send `packet`. What is not known here needs the highest."""
    if isinstance(packet, Query) or is_stop(packet):
        return "watch"
    return _ROLES.get(type(packet), "edit")


def is_stop(packet: Packet) -> bool:
    """Return whether `packet` stops and holds a servo or all of them, which anybody may do at any time (3.2.3)."""
    return isinstance(packet, servos.SetServoParameterRequest) and (packet.is_start, packet.is_hold) == (0, 1)


def is_motion(packet: Packet) -> bool:
    """Return whether `packet` can make a servo turn, or drop what it holds, so that it needs the lease."""
    return isinstance(packet, _MOTIONS) and not is_stop(packet)
