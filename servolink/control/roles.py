"""Roles: which packets a program may send."""

from __future__ import annotations

from enum import IntEnum
from typing import Literal

from servolink.protocol import (
    Effect,
    ExecuteActionExRequest,
    ExecuteActionRequest,
    ExecuteMacroRequest,
    Packet,
    Query,
    SendDummyDataRequest,
    SetActiveJoystickTableRequest,
    SetAngleUnitRequest,
    SetServoParameterRequest,
    SubscribeButtonEventRequest,
    TransmissionModeSettingRequest,
)

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

    @classmethod
    def needed_for(cls, packet: Packet) -> Role:
        """Return the lowest role that may send `packet`. Unknown packets need the highest role."""
        if isinstance(packet, Query) or packet.effect is Effect.STOPS:
            return cls.WATCH
        return _ROLES.get(type(packet), cls.EDIT)


_ROLES: dict[type[Packet], Role] = {
    # Mode, unit and subscription belong to a single program, unnoticed by other programs.
    TransmissionModeSettingRequest: Role.WATCH,
    SetAngleUnitRequest: Role.WATCH,
    SubscribeButtonEventRequest: Role.WATCH,
    SendDummyDataRequest: Role.WATCH,
    ExecuteActionExRequest: Role.RUN,
    ExecuteMacroRequest: Role.RUN,
    SetActiveJoystickTableRequest: Role.RUN,
    SetServoParameterRequest: Role.MOVE,
    ExecuteActionRequest: Role.MOVE,
}
"""Role needed for a packet other than a query or a change of stored content."""
