"""Notices: what a hub reports to those who listen, and its status; plain data for any door."""

from __future__ import annotations

from typing import Literal, TypeAlias

from msgspec import Struct

from servolink.control.status import ConnectionState, LeaseEvent, LeaseStatus


class ProgramJoined(Struct, frozen=True, tag="program_joined"):
    """A program has begun to use the board."""

    session: str
    who: str
    door: str
    role: str


class ProgramLeft(Struct, frozen=True, tag="program_left"):
    """A program has gone."""

    session: str
    who: str


class ProgramRenamed(Struct, frozen=True, tag="program_renamed"):
    """A program has another name from now on."""

    session: str
    who: str


class ConnectionChanged(Struct, frozen=True, tag="connection_changed"):
    """The connection to the board was lost, restored or closed, or another board answers while it is lost."""

    state: ConnectionState
    another: str = ""
    """Who answers in place of a board that is lost, and who is expected; empty if nobody does."""


class LeaseChanged(Struct, frozen=True, tag="lease_changed"):
    """The motion lease has another holder, is free, or is asked for."""

    event: LeaseEvent
    before: str | None
    """The session that held it."""
    holder: LeaseStatus | None
    """Who holds it now, None if it is free."""
    by: str | None
    """The session that took it or asks for it, None if time or a loss ended it."""


class HoldChanged(Struct, frozen=True, tag="hold_changed"):
    """A program holds the board alone from now on, or does not any more: then `session` and `who` are None."""

    session: str | None
    who: str | None
    reason: str


class Refused(Struct, frozen=True, tag="refused"):
    """A packet of a program was not sent to the board."""

    session: str
    who: str
    packet: str
    """The name of the packet, such as `ExecuteActionRequest`."""
    reason: str


class ButtonPressed(Struct, frozen=True, tag="button"):
    """A button of the joystick was pressed or released."""

    button_id: int
    event: int


class Stopped(Struct, frozen=True, tag="stopped"):
    """Servos are being stopped: no motion that was asked for before is sent any more."""

    are_all: bool
    session: str
    """Who stops them; empty for the hub itself."""


class Problem(Struct, frozen=True, tag="problem"):
    """Something that people should look at."""

    text: str


class RecordingChanged(Struct, frozen=True, tag="recording"):
    """Somebody has started or stopped the recording of the hub, or put a mark into it."""

    event: Literal["started", "stopped", "marked"]
    who: str
    name: str
    """The name of the file."""
    text: str = ""
    """The words of a mark."""


Notice: TypeAlias = (
    ProgramJoined
    | ProgramLeft
    | ProgramRenamed
    | ConnectionChanged
    | LeaseChanged
    | HoldChanged
    | Refused
    | Stopped
    | ButtonPressed
    | Problem
    | RecordingChanged
)
