"""Greeting and Welcome: the first line of a program to a hub, and the first line of the hub to the program."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import msgspec
from msgspec import UNSET, Meta, Raw, Struct, UnsetType

from servolink.control.rights import RoleName

VERSION = 1
"""Version of greeting, welcome, and all later messages."""


class Greeting(Struct, kw_only=True, forbid_unknown_fields=True):
    """The first line of a program."""

    MOST_BYTES: ClassVar[int] = 4096
    """Bytes of a greeting, at most."""

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
    group: Annotated[str, Meta(max_length=64)] | UnsetType = UNSET
    """Group of RPC connections, such as the pages of a link, which read the board like a single program."""
    token: str = ""
    """The secret of the hub's private file; only where there are no Unix sockets."""

    @classmethod
    def read(cls, line: bytes) -> Greeting:
        """Return the greeting in the first line of a program. Raise ValueError with the reason for a refusal."""
        if len(line) > cls.MOST_BYTES:
            raise ValueError(f"a greeting has at most {cls.MOST_BYTES} bytes")
        try:
            version = msgspec.json.decode(line, type=_Versioned).servolink
            if version != VERSION:
                raise ValueError(f"this hub has version {VERSION} of its protocol, not {version}: update servolink")
            return msgspec.json.decode(line, type=cls)
        except msgspec.MsgspecError as error:
            raise ValueError(f"this is not a greeting: {error}") from None


class _Versioned(Struct):
    servolink: int


class Welcome(Struct, kw_only=True):
    """First line of a hub to an admitted program."""

    VERSION: ClassVar[int] = VERSION

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
    has_forecast: bool = False
    """Whether motions are tried on a twin, so that `motion.check` tells before a motion why it would be refused."""
    profile: Raw = Raw(b"null")
    """The profile of the board, in JSON; null if there is none."""
    lease: Raw = Raw(b"null")
    hold: Raw = Raw(b"null")
    stops: int | None = None
    """Number of stops so far, to be acknowledged by programs that may move servos; None from an earlier hub."""


class Refusal(Struct, forbid_unknown_fields=True):
    """First and only line of a hub to a refused program."""

    error: str
