"""SoftStart: servos in an unknown pose, whose next movement must be slow."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterable

from servolink.client.session import Session
from servolink.motion import MotionLimits, Ticket
from servolink.protocol import ALL_SERVOS, SetServoParameterRequest


class SoftStart:
    """Record of first movements of servos.

    A servo is in an unknown pose until its first movement on this connection has had its time, and again after it was
    stopped or released: somebody may have turned it since. Without `soft_start` all poses count as known.
    """

    def __init__(self, session: Session) -> None:
        """Start with all poses unknown."""
        self._session = session
        self._settled_at: dict[int, float] = {}
        """End of the first movement by servo, in seconds of the event loop's clock; no entry before its begin."""
        self._epoch = self._now()

    def first_moves(self, servo_ids: Iterable[int], limits: MotionLimits) -> set[int]:
        """Return the servos whose next movement must be slow under `limits`."""
        self._forget_old()
        now = asyncio.get_running_loop().time()
        return {
            servo_id
            for servo_id in servo_ids
            if limits.soft_speed_of(servo_id) is not None and now < self._settled_at.get(servo_id, math.inf)
        }

    def moved(self, servo_ids: Iterable[int], seconds: float, ticket: Ticket) -> None:
        """Count a movement of `seconds`, just sent, as the first of servos without one.

        A movement whose `ticket` has ended does not count: a stop overtakes a movement that waits for the line.
        """
        self._forget_old()
        if not self._session.connection.stops.holds(ticket):
            return
        end = asyncio.get_running_loop().time() + seconds
        for servo_id in servo_ids:
            self._settled_at.setdefault(servo_id, end)

    def forget(self, request: SetServoParameterRequest) -> None:
        """Forget the pose of the servos stopped or released by `request`."""
        if request.is_start and request.is_hold:
            return
        if request.servo_id == ALL_SERVOS:
            self._settled_at.clear()
        else:
            self._settled_at.pop(request.servo_id, None)

    def _forget_old(self) -> None:
        """Forget everything if all servos were stopped, or if the connection was replaced."""
        if self._epoch != (epoch := self._now()):
            self._epoch = epoch
            self._settled_at.clear()

    def _now(self) -> int:
        return self._session.connection.stops.epoch
