"""Status of a hub, its board, the servos and its programs."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from servolink.motion.angles import AngleUnit

ConnectionState = Literal["connected", "lost", "closed"]
LeaseEvent = Literal["taken", "taken over", "asked for", "given back", "left", "over", "beats stopped"]


def about(description: str) -> Meta:
    """Return what describes a field in the reference and in the schema."""
    return Meta(description=description)


class LeaseStatus(Struct, frozen=True):
    """Who may move the robot."""

    session: str
    who: str
    since: float
    """Seconds since it got the lease."""
    dead_man: float | None
    """Seconds without a beat of the holder after which the board is stopped, None if no beats are expected."""


class HoldStatus(Struct, frozen=True):
    """Who holds the board alone."""

    session: str
    who: str
    reason: str


class ProgramStatus(Struct, frozen=True):
    """One program, and what has passed between it and the hub."""

    session: str
    who: str
    door: str
    role: str
    since: float
    """Seconds since it joined."""
    waiting: int
    """Requests that are not over."""
    requests: int
    responses: int
    unanswered: int
    refused: int
    ignored: int
    garbage: int
    """Bytes that belong to no frame."""


class HubStatus(Struct, frozen=True):
    """A hub, its board and its programs."""

    name: str
    url: str
    state: ConnectionState
    since: float
    """Seconds since the hub began."""
    programs: tuple[ProgramStatus, ...]
    lease: LeaseStatus | None
    hold: HoldStatus | None
    responses: int
    """Responses and button events sent to programs, of those that have left too."""
    noise: int
    """Bytes from the board that belong to no frame."""
    doors: tuple[str, ...] = ()
    """The addresses at which programs reach it."""
    another: str = ""
    """Who answers in place of a board that is lost, and who is expected; empty if nobody does."""


class BoardState(Struct, frozen=True):
    """The board, without the programs that use it."""

    state: Annotated[ConnectionState, about("the hub's connection to the board")]
    lease: LeaseStatus | None
    hold: HoldStatus | None
    another: Annotated[str, about("who answers in place of the lost board, and who is expected; empty: nobody")]


class ServoNow(Struct, frozen=True):
    """A servo as it reports itself."""

    servo_id: int
    angle: int
    angle_unit: AngleUnit | None
    current_raw: int
    temperature_raw: int
    servo_type: int
    is_start: Annotated[bool, about("whether it may move; a stopped servo ignores movements")]
    is_hold: Annotated[bool, about("whether it holds its angle; a released servo is limp")]
