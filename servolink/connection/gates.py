"""Gates: the row of checks that a packet passes right before it is sent."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeAlias

from msgspec import Struct
from msgspec.structs import astuple

from servolink.errors import ConnectionLost, Reason, RequestRefused, ServolinkError
from servolink.motion import StopCounter, Ticket
from servolink.protocol import Effect, Packet, Query

Gate: TypeAlias = Callable[[Packet, Ticket], "ServolinkError | None"]
"""Returns why a packet must not be sent, None if it may. It neither waits nor changes anything."""
Preparation: TypeAlias = Callable[[Packet, Ticket], Awaitable[None]]
"""Does what must come before a packet passes the gates, such as taking the lease; it raises if that fails."""


def open_gate(packet: Packet, ticket: Ticket) -> None:
    """Refuse nothing."""


class Gates(Struct, frozen=True):
    """Gates in the order in which they are asked; the first refusal counts (docs/design/motion.md)."""

    line: Gate = open_gate
    """Refuses everything while several boards answer."""
    identity: Gate = open_gate
    """Refuses another board than that of the profile."""
    role: Gate = open_gate
    """Refuses what the role of the program does not allow. Roles never change."""
    exclusive_use: Gate = open_gate
    """Refuses while another program uses the board exclusively."""
    lease: Gate = open_gate
    """Refuses a motion while another program moves the board."""
    ticket: Gate = open_gate
    """Refuses a motion after a stop, or too late."""
    limits: Gate = open_gate
    """Refuses a motion whose angles were checked in other units than those now set."""

    @staticmethod
    def of_units(units_sent: Callable[[], int]) -> Gate:
        """Return the gate that refuses motions whose angles were checked before the latest unit was sent."""

        def refusal(packet: Packet, ticket: Ticket) -> ServolinkError | None:
            if ticket.units_sent in {None, units_sent()}:
                return None
            return UnitsChanged(
                f"{type(packet).__name__} was not sent: an angle unit was set while it was checked", packet
            )

        return refusal

    def refusal(self, packet: Packet, ticket: Ticket) -> ServolinkError | None:
        """Return the first refusal, None if `packet` may be sent now. Stops and queries pass without being asked."""
        if not passes_gates(packet):
            return None
        gates: tuple[Gate, ...] = astuple(self)
        for gate in gates:
            if (refusal := gate(packet, ticket)) is not None:
                return refusal
        return None


def passes_gates(packet: Packet) -> bool:
    """Return whether gates are asked about `packet`: not about what changes nothing, nor about a stop."""
    return not (isinstance(packet, Query) or packet.effect is Effect.STOPS)


class UnitsChanged(RequestRefused):
    """A motion was not sent, because an angle unit was set after its angles were checked."""

    _reason = Reason.ANGLE_UNIT


def ticket_gate(stops: StopCounter, now: Callable[[], float]) -> Gate:
    """Return the gate that refuses motions whose ticket `stops` does not hold any more, or that are too late.

    A servo is released after a stop all the same.
    """

    def refusal(packet: Packet, ticket: Ticket) -> ServolinkError | None:
        if not packet.is_motion:
            return None
        name = type(packet).__name__
        if packet.effect is not Effect.GOES_LIMP:
            if not stops.issued(ticket):
                return ConnectionLost(f"{name} was not sent: the connection was lost after it was asked for")
            if not stops.holds(ticket):
                return RequestRefused(f"{name} was not sent: {stops.reason}", packet, reason=Reason.STOP)
        if now() > ticket.until:
            text = f"{name} was not sent: the time by which it was to begin has passed"
            return RequestRefused(text, packet, reason=Reason.DEADLINE)
        return None

    return refusal
