"""Ticket of a motion: time and sender of the request, so that a later stop cancels the motion."""

from __future__ import annotations

import math
from itertools import count
from typing import NamedTuple

_FIRST_EPOCHS = count(0, 1 << 40)  # so that epochs of two counters never coincide


class Ticket(NamedTuple):
    """Permission to begin a motion, valid from the moment of the request.

    A ticket belongs to the counter that issued it. Any relay of a motion, such as a hub, exchanges
    the ticket for a ticket of the next counter.
    """

    epoch: int
    """Stops until then, as `StopCounter.epoch` counts them; a later stop ends the motion."""
    until: float = math.inf
    """Time by which the motion must have begun, on the clock of the event loop; infinite for any time."""
    who: str = ""
    """Session that asked, where several programs share a board; else empty."""
    units_sent: int | None = None
    """Angle units sent when the angles were checked (`Connection.units_sent`); None if units do not matter."""

    def begun(self) -> Ticket:
        """Return the ticket for the rest of a motion that has begun: only a stop ends the motion."""
        return self._replace(until=math.inf)

    def checked(self, units_sent: int) -> Ticket:
        """Return the ticket of a motion whose angles were checked when so many angle units had been sent."""
        return self._replace(units_sent=units_sent)


class StopCounter:
    """Counter of stops on a connection, in a hub or of a bridge of a fleet."""

    def __init__(self) -> None:
        """Start with an epoch that no other counter has."""
        self._first = self.epoch = next(_FIRST_EPOCHS)
        self._ticket = Ticket(self.epoch)

    @property
    def count(self) -> int:
        """Number of stops so far."""
        return self.epoch - self._first

    def stop(self) -> None:
        """Count a stop: tickets issued before are no longer valid."""
        self.epoch += 1
        self._ticket = Ticket(self.epoch)

    def ticket(self, *, until: float = math.inf, who: str = "") -> Ticket:
        """Return the ticket of a motion requested now."""
        return self._ticket if until == math.inf and not who else Ticket(self.epoch, until, who)

    def holds(self, ticket: Ticket) -> bool:
        """Return whether no stop came since `ticket` was issued, here and not by another counter."""
        return ticket.epoch == self.epoch

    def issued(self, ticket: Ticket) -> bool:
        """Return whether `ticket` was issued here, and not on an earlier connection."""
        return self._first <= ticket.epoch <= self.epoch
