"""Options of a connection: as arguments of `connect`, and in the address of a board."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from msgspec import Struct
from msgspec.structs import force_setattr

from servolink.connection.times import PATIENCE
from servolink.errors import quote
from servolink.protocol import ByteOrder, Codec
from servolink.support import SECONDS, as_number, check_seconds, is_integer
from servolink.transports import Address

TransmissionMode: TypeAlias = Literal["auto", "keep", 1]
"""When opening a connection sets the transmission mode (3.1.1) to 1, in which a board speaks this protocol.

"auto": if the board does not answer. 1: always. "keep": never.
"""

MOST_DEPTH = 64


class ConnectionOptions(Struct, frozen=True):
    """Options for talking to a board. Raise TypeError or ValueError for a wrong option."""

    byte_order: ByteOrder = "little"
    caption_encoding: str = "utf-8"
    transmission_mode: TransmissionMode = "auto"
    patience: float = PATIENCE
    """Seconds to ask for one response, repeats included, from the first sending of the request."""
    depth: int = 1
    """How many queries may be under way at once, at most."""
    write_depth: int = 1
    """The same for requests while something is changed."""
    answers_twice: bool = False
    """Whether the board may answer each request twice, as a repeating adapter makes it."""
    late_copies: bool = False
    """Whether copies of responses may come seconds later, so that each request is proved, in twice the time."""
    ignore_extra: bool = False
    """Whether responses may have more content than the document says, which is ignored."""

    def __post_init__(self) -> None:
        """Check all options, as documented for `connect`."""
        Codec(self.byte_order, self.caption_encoding)
        if self.transmission_mode not in ("auto", "keep", 1) or isinstance(self.transmission_mode, bool):
            raise ValueError(f"transmission_mode must be 'auto', 'keep' or 1, not {quote(self.transmission_mode)}")
        for name in ("patience", "depth", "write_depth"):
            force_setattr(self, name, as_number(getattr(self, name)))
        check_seconds("patience", self.patience)
        for name in ("answers_twice", "late_copies", "ignore_extra"):
            if not isinstance(getattr(self, name), bool):
                raise TypeError(f"{name} must be True or False, not {quote(getattr(self, name))}")
        for name, depth in (("depth", self.depth), ("write_depth", self.write_depth)):
            if not is_integer(depth):
                raise TypeError(f"{name} must be an integer, not {quote(depth)}")
            if not 1 <= depth <= MOST_DEPTH:
                raise ValueError(f"{name} must be 1..{MOST_DEPTH}, not {quote(depth)}")


def options_in(url: str) -> dict[str, Any]:
    """Return the options of the connection in the address `url`, by name. Raise InvalidAddress for a wrong one."""
    address, default = Address.parse(url), ConnectionOptions()
    mode = address.choice("transmission_mode", "auto", ("auto", "keep", "1"))
    encoding = address.text("caption_encoding", default.caption_encoding)
    try:
        Codec(caption_encoding=encoding)
    except ValueError as error:
        raise address.refusal(f"option caption_encoding: {error}") from None
    options = {
        "byte_order": address.choice("byte_order", default.byte_order, ("little", "big")),
        "caption_encoding": encoding,
        "transmission_mode": 1 if mode == "1" else mode,
        "patience": address.number("patience", default.patience, *SECONDS),
        "depth": address.integer("depth", default.depth, 1, MOST_DEPTH),
        "write_depth": address.integer("write_depth", default.write_depth, 1, MOST_DEPTH),
        "answers_twice": address.choice("answers_twice", "no", ("no", "yes")) == "yes",
        "late_copies": address.choice("late_copies", "no", ("no", "yes")) == "yes",
        "ignore_extra": address.choice("ignore_extra", "no", ("no", "yes")) == "yes",
    }
    return {name: options[name] for name in address.connection_options}
