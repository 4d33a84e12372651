"""Ticket of a motion: time and sender of the request, so that a later stop cancels the motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import count

from msgspec import Struct
from msgspec.structs import replace

from servolink.errors import Reason

_FIRST_EPOCHS = count(0, 1 << 40)  # so that epochs of two counters never coincide

STOPPED = "a stop came first"
"""Reason of a stop, for people."""


class Ticket(Struct, frozen=True):
    """Permission to begin a motion, valid from the moment of the request.

    A ticket belongs to the counter that issued it. Any relay of a motion, such as a hub, exchanges
    the ticket for a ticket of the next counter.
    """

    epoch: int
    """Stops until then, as `StopCounter.epoch` counts them; a later stop ends the motion."""
    until: float = math.inf
    """Time by which the motion must have begun, time asleep included; infinite for any time."""
    who: str = ""
    """Session that asked, where several programs share a board; else empty."""
    units_sent: int | None = None
    """Angle units sent when the angles were checked (`Connection.units_sent`); None if units do not matter."""

    def begun(self) -> Ticket:
        """Return the ticket for the rest of a motion that has begun: only a stop ends the motion."""
        return replace(self, until=math.inf)

    def expired(self) -> Ticket:
        """Return the ticket of a motion that was requested before a stop, and arrives after it."""
        return replace(self, epoch=NO_TICKET.epoch)

    def checked(self, units_sent: int) -> Ticket:
        """Return the ticket of a motion whose angles were checked when so many angle units had been sent."""
        return replace(self, units_sent=units_sent)


NO_TICKET = Ticket(-1)
"""Ticket of a query, which no gate is asked about; no counter has issued it."""


class StopCounter:
    """Counter of stops on a connection, in a hub or of a bridge of a fleet; a sleep of the computer counts as one."""

    def __init__(self, sleeps: Callable[[], int] = lambda: 0) -> None:
        """Start with an epoch that no other counter has; `sleeps` returns how often the computer has slept."""
        self._first = self.epoch = next(_FIRST_EPOCHS)
        self.reason = ""
        """Reason of the latest stop, for people."""
        self.cause = Reason.STOP
        """Reason of the latest stop, for programs: `STOP` or `STALL`."""
        self._ticket = Ticket(self.epoch)
        self._sleeps = sleeps
        self._slept = sleeps()

    @property
    def count(self) -> int:
        """Number of stops so far."""
        return self.epoch - self._first

    def stop(self, reason: str = STOPPED, cause: Reason = Reason.STOP) -> None:
        """Count a stop: tickets issued before are no longer valid."""
        self.reason, self.cause = reason, cause
        self.epoch += 1
        self._ticket = Ticket(self.epoch)

    def ticket(self, *, until: float = math.inf, who: str = "") -> Ticket:
        """Return the ticket of a motion requested now."""
        self._look()
        return self._ticket if until == math.inf and not who else Ticket(self.epoch, until, who)

    def holds(self, ticket: Ticket) -> bool:
        """Return whether no stop came since `ticket` was issued, here and not by another counter."""
        self._look()
        return ticket.epoch == self.epoch

    def issued(self, ticket: Ticket) -> bool:
        """Return whether `ticket` was issued here, and not on an earlier connection."""
        return self._first <= ticket.epoch <= self.epoch

    def _look(self) -> None:
        if (slept := self._sleeps()) != self._slept:
            self._slept = slept
            self.stop("this computer has slept since it was asked for")
