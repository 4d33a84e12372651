"""Status of a hub, its board and its programs."""

from __future__ import annotations

from typing import Literal

from msgspec import Struct

ConnectionState = Literal["connected", "lost", "closed"]
LeaseEvent = Literal["taken", "taken over", "asked for", "given back", "left", "over", "beats stopped"]


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
