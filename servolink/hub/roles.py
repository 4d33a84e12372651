"""Roles: what a program may do."""

from __future__ import annotations

from enum import IntEnum

from servolink.client.roles import needed_role_name
from servolink.protocol import editing, servos
from servolink.protocol.packet import Packet


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


_STORED_MOTIONS = (servos.ExecuteActionExRequest, editing.ExecuteMacroRequest, editing.AddServoParameterRequest)


def needed_role(packet: Packet) -> Role:
    """Return the lowest role that may send `packet`. What is not known here needs the highest."""
    return Role[needed_role_name(packet).upper()]


def carries_angles(packet: Packet) -> bool:
    """Return whether the meaning of `packet`, or of its response, depends on the angle unit of servos (3.2.4).

    That is so for angles sent and reported, and for everything stored that the board applies to its servos.
    """
    return isinstance(packet, (servos.QueryServoRequest, servos.ExecuteActionRequest, *_STORED_MOTIONS))
