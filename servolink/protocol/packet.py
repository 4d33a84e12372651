"""What a packet is: the bases of all declarations."""

from __future__ import annotations

from typing import Annotated, ClassVar, Generic, TypeVar

from msgspec import Meta, Struct

from servolink.protocol.fields import U8


class Packet(Struct, frozen=True, gc=False):
    """One of the document's 60 packets; its fields, in their order on the wire, are the class's fields."""

    packet_id: ClassVar[int]
    section: ClassVar[str]
    """Where the document defines it."""


class Response(Packet, frozen=True, gc=False):
    """Sent by the board."""


class Result(Response, frozen=True, gc=False):
    """An answer that says only whether it was done."""

    result: Annotated[U8, Meta(description="0 failed, 1 done")]


R_co = TypeVar("R_co", bound=Response, covariant=True)


class Command(Packet, frozen=True, gc=False):
    """Sent by the host and never answered."""


class Request(Packet, Generic[R_co], frozen=True, gc=False):
    """Sent by the host and answered by `R_co`, whose id is one higher; it may change something on the board."""

    echoed: ClassVar[str] = ""
    """The field that the answer repeats; 0 in its place is the board's way to say no."""

    def accepts(self, response: Response) -> bool:
        """Tell whether `response`, of the right id, can be the answer to this very request."""
        if not self.echoed:
            return True
        return getattr(response, self.echoed) in (getattr(self, self.echoed), 0)


class Query(Request[R_co], frozen=True, gc=False):
    """A request that changes nothing and may be repeated."""
