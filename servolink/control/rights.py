"""Rights: which packets a program may send by its role, and which methods it may call by their scope."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, Flag, IntEnum, auto
from typing import Literal

from servolink.control.error_codes import Code, RpcError
from servolink.errors import quote
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


class Touches(Flag):
    """Parts changed by a method, except by stopping servos; HOST is for methods that only show such parts, too."""

    NOTHING = 0
    """No change: readings, and stops of servos."""
    SESSION = auto()
    """Connection of the calling program: lease, limits, feeds, streams, questions and their answers."""
    MOTION = auto()
    """Servos, which may turn."""
    BOARD = auto()
    """Content and settings of the board, with their drafts."""
    HOST = auto()
    """Computer of the board: settings, files and other boards, for the owner only."""


class Origin(Enum):
    """Place of the caller of a method."""

    HERE = auto()
    """Program of this computer, page of the studio, or client of a hub."""
    LINK = auto()
    """Page of the studio that was opened through a link."""
    AFAR = auto()
    """Program at the broker of a fleet."""


@dataclass(frozen=True, slots=True)
class Scope:
    """Scope of a method."""

    touches: Touches
    from_afar: bool = False
    """Whether programs at the broker of a fleet may call the method."""

    @classmethod
    def unknown(cls) -> Scope:
        """Return the scope of an undeclared method, such as a method of another version of servolink."""
        return cls(Touches.SESSION | Touches.MOTION | Touches.BOARD | Touches.HOST)

    def __post_init__(self) -> None:
        """Raise ValueError for `from_afar` with SESSION or HOST."""
        if self.from_afar and self.touches & (Touches.SESSION | Touches.HOST):
            raise ValueError(f"a method that touches {self.words} cannot come from afar")

    @property
    def moves(self) -> bool:
        """Whether servos may turn, so that a late call must not be carried out."""
        return Touches.MOTION in self.touches

    @property
    def words(self) -> str:
        """Touched parts for people, such as `motion, board`."""
        return ", ".join(str(each.name).lower() for each in Touches if each in self.touches) or "nothing"

    def check(self, name: str, origin: Origin) -> None:
        """Raise RpcError if the method `name` may not be called from `origin`."""
        if origin is Origin.LINK and Touches.HOST in self.touches:
            raise RpcError(
                Code.FORBIDDEN,
                "this page was opened through a link",
                remedy="use the page on the machine of the studio",
            )
        if origin is Origin.AFAR and not self.from_afar:
            raise RpcError(
                Code.METHOD_NOT_FOUND,
                f"there is no method {quote(name)} from afar",
                remedy="use one of the methods of the reference of fleets",
            )
