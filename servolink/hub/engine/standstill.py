"""Standstill: the computer slept, or the hub was stopped; whatever was asked for before must not move late."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from servolink.errors import Reason
from servolink.hub.rules.hub_gates import MotionOver, refuse_ticket
from servolink.motion import StopCounter, Ticket
from servolink.protocol import Packet
from servolink.support import time_with_sleep

LONGEST_GAP = 5.0
"""Seconds without a turn of the event loop, beyond which the hub has stood still; a busy computer stays below."""
SETTLING = 0.5
"""Seconds after a standstill in which no motion begins: requests from before it may still have to be read."""
_INTERVAL = 1.0


class Standstill:
    """Clock that shows by a missing beat that the hub stood still. Nobody can say when a request that waits was sent.

    It beats only while programs are there, so that an idle hub wakes nobody.
    """

    def __init__(self, on_standstill: Callable[[str], None]) -> None:
        """Call `on_standstill` with the reason why earlier requests must not move anything any more."""
        self._on_standstill = on_standstill
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._beat = 0.0
        self._settled = 0.0
        self._reason = ""

    def begin(self) -> None:
        """Beat from now on, unless it does already."""
        if self._timer is None:
            self._beat = time_with_sleep()
            self._timer = self._loop.call_later(_INTERVAL, self._again)

    def end(self) -> None:
        """Stop beating: no program is left."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def refuse(self, packet: Packet, ticket: Ticket, stops: StopCounter) -> MotionOver | None:
        """Refuse a motion right after a standstill, after a stop since the issue of `ticket`, and after its time."""
        if not packet.is_motion:
            return None
        now = self._look()
        if now < self._settled:
            return MotionOver(self._reason, reason=Reason.STOP)
        return refuse_ticket(packet, ticket, stops, now)

    def _look(self) -> float:
        """Return the present time, after looking for a missing beat."""
        now, beat = time_with_sleep(), self._beat
        if self._timer is not None and now - beat > LONGEST_GAP:
            self._beat, self._settled = now, now + SETTLING
            self._reason = f"the hub stood still for {now - beat:.0f} s, as this computer slept or the hub was stopped"
            self._on_standstill(self._reason)
        return now

    def _again(self) -> None:
        self._look()
        self._beat = time_with_sleep()
        self._timer = self._loop.call_later(_INTERVAL, self._again)
