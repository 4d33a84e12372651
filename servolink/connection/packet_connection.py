"""PacketConnection: what the parts of a board need of a connection, and of the link to the hub of a shared board."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Coroutine, Mapping
from contextlib import AbstractAsyncContextManager, AbstractContextManager
from typing import Any, Protocol, TypeAlias, TypeVar

from servolink.connection.gates import Gates
from servolink.connection.stats import Stats
from servolink.errors import ConnectionLost, ServolinkError
from servolink.motion import MotionLimits, StopCounter, Ticket
from servolink.protocol import (
    ButtonEventResponse,
    Codec,
    Command,
    Packet,
    Query,
    Request,
    Response,
    SetServoParameterRequest,
)

R = TypeVar("R", bound=Response)
SendPoints: TypeAlias = Callable[[Mapping[int, float], float], Awaitable[Mapping[int, int]]]
"""Sends set-points that must leave by a time of the event loop's clock. Returns the angles sent, by servo."""


class BoardSharing(Protocol):
    """Requests to the hub of a shared board, beside requests to the board."""

    has_lost_board: bool
    """Whether the hub has lost the board, and is reconnecting."""
    on_board: Callable[[bool], None]
    """Called with `has_lost_board` when the hub loses or finds the board."""

    async def catch_up(self) -> None:
        """Return when all is heard that the hub has told by now, such as a stop of another program."""

    def refusal_of(self, packet: Packet) -> ServolinkError | None:
        """Return why the hub has not sent a motion, if it has said so since the latest motion was prepared."""
        ...

    async def stop(self) -> None:
        """Stop all servos; return when the hub has read all of them as stopped."""

    def stream(self, hz: float, gap: float, limits: MotionLimits, *, any_angle: bool) -> SendPoints:
        """Return a function to stream set-points through the hub, which shortens them to `limits` and its own."""
        ...

    def moving(self) -> AbstractAsyncContextManager[None]:
        """Return a context with the lease of the servos; raises MotionRefused on entry if another program has it."""
        ...

    def exclusive(self, reason: str) -> AbstractAsyncContextManager[None]:
        """Return a context with exclusive use of the board."""
        ...

    async def close(self) -> None:
        """Leave the hub, which frees the lease."""


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
