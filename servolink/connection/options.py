"""Options of a connection: as arguments of `connect`, and in the address of a board."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

from msgspec import Struct
from msgspec.structs import force_setattr

from servolink.escaping import quote
from servolink.numeric import LEAST_SECONDS, MOST_SECONDS, as_number, check_seconds, is_integer
from servolink.protocol.caption import check_encoding
from servolink.protocol.frame import ByteOrder
from servolink.transports.address import Address

TransmissionMode: TypeAlias = Literal["auto", "keep", 1]
"""When opening a connection sets the transmission mode (3.1.1) to 1, in which a board speaks this protocol.

"auto": if the board does not answer. 1: always. "keep": never.
"""

PATIENCE = 3.0
"""Seconds after which a request is given up, unless told otherwise."""
SLOW_PATIENCE = 30.0
"""Seconds after which deleting everything is given up: a board may erase its memory for long before it answers."""
HUB_MARGIN = 1.0
"""Seconds that a hub gets beyond the patience: its own may begin a little later."""
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
    ignore_extra: bool = False
    """Whether responses may have more content than the document says, which is ignored."""

    def __post_init__(self) -> None:
        """Check all options, as documented for `connect`."""
        if self.byte_order not in ("little", "big"):
            raise ValueError(f"byte_order must be 'little' or 'big', not {quote(self.byte_order)}")
        check_encoding(self.caption_encoding)
        if self.transmission_mode not in ("auto", "keep", 1) or isinstance(self.transmission_mode, bool):
            raise ValueError(f"transmission_mode must be 'auto', 'keep' or 1, not {quote(self.transmission_mode)}")
        for name in ("patience", "depth", "write_depth"):
            force_setattr(self, name, as_number(getattr(self, name)))
        check_seconds("patience", self.patience)
        for name in ("answers_twice", "ignore_extra"):
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
        check_encoding(encoding)
    except ValueError as error:
        raise address.refusal(f"option caption_encoding: {error}") from None
    options = {
        "byte_order": address.choice("byte_order", default.byte_order, ("little", "big")),
        "caption_encoding": encoding,
        "transmission_mode": 1 if mode == "1" else mode,
        "patience": address.number("patience", default.patience, LEAST_SECONDS, MOST_SECONDS),
        "depth": address.integer("depth", default.depth, 1, MOST_DEPTH),
        "write_depth": address.integer("write_depth", default.write_depth, 1, MOST_DEPTH),
        "answers_twice": address.choice("answers_twice", "no", ("no", "yes")) == "yes",
        "ignore_extra": address.choice("ignore_extra", "no", ("no", "yes")) == "yes",
    }
    return {name: options[name] for name in address.connection_options}
