"""Status of a hub, its board, the servos and its programs."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from servolink.motion import AngleUnit

ConnectionState = Literal["connected", "lost", "closed"]


def about(description: str) -> Meta:
    """Return the description of a field for the reference and the schema."""
    return Meta(description=description)


class LeaseStatus(Struct, frozen=True):
    """Program with the motion lease."""

    session: str
    who: str
    since: float
    """Seconds since the program got the lease."""
    dead_man: float | None
    """Seconds without a beat of the holder until the hub stops the board; None if no beats are expected."""


class HoldStatus(Struct, frozen=True):
    """Program with exclusive use of the board."""

    session: str
    who: str
    reason: str


class ProgramStatus(Struct, frozen=True):
    """Program of a hub, with the counts of its traffic."""

    session: str
    who: str
    door: str
    role: str
    since: float
    """Seconds since the program joined."""
    waiting: int
    """Requests under way or waiting."""
    requests: int
    responses: int
    unanswered: int
    refused: int
    ignored: int
    garbage: int
    """Bytes that belong to no frame."""


class HubStatus(Struct, frozen=True):
    """Hub, board and programs at one time."""

    name: str
    url: str
    state: ConnectionState
    since: float
    """Seconds since the hub began."""
    programs: tuple[ProgramStatus, ...]
    lease: LeaseStatus | None
    hold: HoldStatus | None
    responses: int
    """Responses and button events sent to programs, including programs that have left."""
    noise: int
    """Bytes from the board that belong to no frame."""
    doors: tuple[str, ...] = ()
    """Addresses of the doors of the hub."""
    another: str = ""
    """Description of a different board in place of the lost one; else empty."""


class BoardState(Struct, frozen=True):
    """Board of a hub, without its programs."""

    state: Annotated[ConnectionState, about("the hub's connection to the board")]
    lease: LeaseStatus | None
    hold: HoldStatus | None
    another: Annotated[
        str, about("description of a different board in place of the lost one, and of the expected one; else empty")
    ]
    unanswered: Annotated[
        tuple[str, ...], about("names of queries that the board does not answer, such as `QueryMemorySize`")
    ] = ()


class ServoNow(Struct, frozen=True, omit_defaults=True):
    """Servo with its reported values."""

    servo_id: int
    angle: int
    angle_unit: AngleUnit | None
    current_raw: int
    temperature_raw: int
    servo_type: int
    is_start: Annotated[bool, about("whether it may move; a stopped servo ignores movements")]
    is_hold: Annotated[bool, about("whether it holds its angle; a released servo is limp")]
    lag: Annotated[
        int | None,
        about("degrees between the angle and the planned angle; left out if the plan is unknown"),
    ] = None
    doubt: Annotated[
        str, about("why these values cannot be true, such as `not measured`; left out for plausible values")
    ] = ""
