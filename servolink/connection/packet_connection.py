"""PacketConnection: what the parts of a board need of a connection, whether its packets become bytes or not."""

from __future__ import annotations

from collections.abc import Callable, Coroutine
from contextlib import AbstractContextManager
from typing import Any, Protocol, TypeVar

from servolink.connection.gates import Gates
from servolink.connection.sharing import BoardSharing
from servolink.connection.stats import Stats
from servolink.errors import ConnectionLost
from servolink.motion.ticket import StopCounter, Ticket
from servolink.protocol.codec import Codec
from servolink.protocol.joystick import ButtonEventResponse
from servolink.protocol.packet import Command, Query, Request, Response
from servolink.protocol.servos import SetServoParameterRequest

R = TypeVar("R", bound=Response)


class ConnectionEvents(Protocol):
    """What a connection tells without being asked."""

    on_event: Callable[[ButtonEventResponse], None]
    """Called with each button event."""
    on_end: Callable[[ConnectionLost], None]
    """Called once with what ended the connection."""


class PacketConnection(Protocol):
    """One conversation with one board (see `Connection`)."""

    codec: Codec
    patience: float
    stats: Stats
    stops: StopCounter
    motions: int
    gates: Gates
    hub: BoardSharing | None
    on_another: Callable[[str], None]

    @property
    def unsupported(self) -> frozenset[str]:
        """Names of queries that the board is known not to answer, such as `QueryMemorySize`."""
        ...

    @property
    def answered(self) -> tuple[Query[Any], ...]:
        """Short queries that the board has answered on opening."""
        ...

    @property
    def answers(self) -> ConnectionEvents:
        """Events that come without being asked for."""
        ...

    @property
    def url(self) -> str:
        """Address of the board, for texts of errors."""
        ...

    @property
    def board_url(self) -> str:
        """The address of the board itself."""
        ...

    @property
    def ended(self) -> ConnectionLost | None:
        """First cause of the end of the connection; None while it is up."""
        ...

    @property
    def is_suspended(self) -> bool:
        """Whether another program has exclusive use of a shared board."""
        ...

    @property
    def units_sent(self) -> int:
        """How many times an angle unit was sent."""
        ...

    @property
    def depth_bound(self) -> int:
        """How many queries may ever be under way."""
        ...

    @property
    def write_depth_bound(self) -> int:
        """How many requests may ever be under way while one of them is a change."""
        ...

    @property
    def pace(self) -> float:
        """Bytes per second that the line is known to carry, 0 if they are unknown."""
        ...

    @property
    def outlasts_silence(self) -> bool:
        """Whether the board may come back: a hub goes on without it."""
        ...

    @property
    def has_waiting(self) -> bool:
        """Whether requests wait for their turn."""
        ...

    @property
    def callers(self) -> int:
        """How many callers keep the line full."""
        ...

    def bulk(self) -> AbstractContextManager[None]:
        """Return a context in which much is transferred."""
        ...

    async def shake_hands(self) -> None:
        """Make sure no response to an earlier program is pending."""

    async def close(self) -> None:
        """Fail all who wait, and end the connection."""

    def request(
        self,
        packet: Request[R],
        *,
        timeout: float | None = None,
        first: bool = False,
        unchecked: bool = False,
        ticket: Ticket | None = None,
        begun_at: float | None = None,
    ) -> Coroutine[Any, Any, R]:
        """Return what sends `packet` and returns its response."""
        ...

    def send(self, packet: Command, *, ticket: Ticket | None = None) -> Coroutine[Any, Any, bool]:
        """Return what sends a packet that is never answered."""
        ...

    def send_stop(self, packet: SetServoParameterRequest) -> Coroutine[Any, Any, bool]:
        """Return what sends `packet` before everything else, and waits for nothing."""
        ...
