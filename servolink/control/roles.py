"""Roles: which packets a program may send."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal

from servolink.protocol import editing, joystick, servos, settings
from servolink.protocol.packet import Effect, Packet, Query

RoleName = Literal["watch", "run", "move", "edit"]
"""A role as JSON and addresses have it."""


class Role(IntEnum):
    """Rights of a program. Each role includes all earlier roles."""

    WATCH = 1
    """Read everything, and stop all servos."""
    RUN = 2
    """Also run stored actions and macros."""
    MOVE = 3
    """Also move, start and release servos."""
    EDIT = 4
    """Also change stored records and settings."""

    def __str__(self) -> str:
        """Return the name for people, such as `watch`."""
        return self.name.lower()

    @classmethod
    def parse(cls, name: str) -> Role:
        """Return the role of a name. Raise KeyError for any other text."""
        return cls[name.upper()]


_ROLES: dict[type[Packet], Role] = {
    # The mode, the unit and the subscription belong to one program: others do not notice them.
    settings.TransmissionModeSettingRequest: Role.WATCH,
    servos.SetAngleUnitRequest: Role.WATCH,
    joystick.SubscribeButtonEventRequest: Role.WATCH,
    settings.SendDummyDataRequest: Role.WATCH,
    servos.ExecuteActionExRequest: Role.RUN,
    editing.ExecuteMacroRequest: Role.RUN,
    joystick.SetActiveJoystickTableRequest: Role.RUN,
    servos.SetServoParameterRequest: Role.MOVE,
    servos.ExecuteActionRequest: Role.MOVE,
}
"""The role that a packet needs, if it is neither a query nor a change of what is stored."""


def needed_role(packet: Packet) -> Role:
    """Return the lowest role that may send `packet`. Unknown packets need the highest role."""
    if isinstance(packet, Query) or packet.effect is Effect.STOPS:
        return Role.WATCH
    return _ROLES.get(type(packet), Role.EDIT)
