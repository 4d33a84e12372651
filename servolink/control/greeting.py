"""Greeting and Welcome: the first line of a program to a hub, and the first line of the hub to the program."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Raw, Struct

from servolink.control.roles import RoleName

VERSION = 1
"""Version of greeting, welcome, and all later messages."""
MOST_GREETING = 4096
"""Bytes of a greeting, at most."""
GREETING_LIMIT = 2.0
"""Seconds until a hub disconnects a program without a greeting."""


class Greeting(Struct, kw_only=True, forbid_unknown_fields=True):
    """The first line of a program."""

    servolink: int = VERSION
    """Version of greeting, welcome, and all later messages."""
    wants: Literal["frames", "rpc"]
    """Content of the connection: frames of packets, or JSON-RPC."""
    who: Annotated[str, Meta(max_length=200)]
    """The program as a person reads it, such as `servolink watch (pid 1234)`."""
    role: RoleName = "edit"
    byte_order: Literal["little", "big"] = "little"
    angle_unit: Literal["degree", "adc"] = "degree"
    """The unit of the servos for which the session sets none."""
    dead_man: Annotated[float, Meta(ge=0.1, le=60)] | None = None
    """Seconds without a beat until the hub stops the motions of this program; None for no limit. Only for RPC."""
    session: str | None = None
    """Session of an RPC connection; None for a new session."""
    token: str = ""
    """The secret of the hub's private file; only where there are no Unix sockets."""


class Welcome(Struct, kw_only=True):
    """The first line of the hub, if it lets the program in."""

    servolink: int
    """Version of the hub's messages."""
    session: str
    """Identifier that ties the connections of a program; not secret: `status` lists all sessions."""
    name: str
    url: str
    """The address of the board behind the hub."""
    role: RoleName
    patience: float = 0.0
    """Seconds after which the hub gives a request up."""
    has_control: bool = False
    """Whether the hub answers JSON-RPC too."""
    profile: Raw = Raw(b"null")
    """The profile of the board, in JSON; null if there is none."""
    lease: Raw = Raw(b"null")
    hold: Raw = Raw(b"null")


class Refusal(Struct, forbid_unknown_fields=True):
    """The first and only line of the hub, if it does not let the program in."""

    error: str
