"""Roles: which packets a program may send."""

from __future__ import annotations

from enum import IntEnum

from servolink.control.greeting import RoleName
from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.packet import Effect, Packet, Query, is_motion


class Role(IntEnum):
    """What a program may do. Each role includes those before it."""

    WATCH = 1
    """Read and stop."""
    RUN = 2
    """Run stored actions and macros too."""
    MOVE = 3
    """Move, start and release servos too."""
    EDIT = 4
    """Change what is stored too."""

    def __str__(self) -> str:
        """Return the name for people, such as `watch`."""
        return self.name.lower()


_ROLES: dict[type[Packet], RoleName] = {
    # The mode, the unit and the subscription belong to one program: others do not notice them.
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


def needed_role_name(packet: Packet) -> RoleName:
    """Return the lowest role that may send `packet`. What is not known here needs the highest."""
    if isinstance(packet, Query) or packet.effect is Effect.STOPS:
        return "watch"
    return _ROLES.get(type(packet), "edit")


def needed_role(packet: Packet) -> Role:
    """Return the lowest role that may send `packet`. What is not known here needs the highest."""
    return Role[needed_role_name(packet).upper()]


def carries_angles(packet: Packet) -> bool:
    """Return whether the meaning of `packet`, or of its response, depends on the angle unit of servos (3.2.4).

    That is so for angles sent and reported, and for everything stored that the board applies to its servos.
    """
    if isinstance(packet, servos.SetServoParameterRequest):
        return False
    return is_motion(packet) or isinstance(packet, servos.QueryServoRequest)
