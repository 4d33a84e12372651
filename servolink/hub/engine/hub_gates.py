"""Row of gates of a hub (role, exclusive use, lease, stop and deadline), and the response for a refused packet."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType

from servolink.control import HoldStatus, Role
from servolink.errors import MotionRefused, Reason, RequestRefused, ServolinkError, escape
from servolink.hub.rules.lease import MotionLease
from servolink.motion import StopCounter, Ticket
from servolink.protocol import (
    ALL_SERVOS,
    PACKETS,
    Packet,
    Request,
    Response,
    Result,
    ServoState,
    SetServoParameterRequest,
    SetServoParameterResponse,
)
from servolink.support import time_with_sleep

LONGEST_GAP = 5.0
"""Seconds without a turn of the event loop, beyond which the hub has stood still; a busy computer stays below."""
SETTLING = 0.5
"""Seconds after a standstill in which no motion begins: requests from before it may still have to be read."""
_INTERVAL = 1.0


class LeaseRefused(MotionRefused):
    """Another program holds the lease."""

    _reason = Reason.LEASE
    remedy = "ask for the lease with lease.ask, or take it over with lease.take and force"
    """Remedy that programs read in the error of the control interface."""


class ForecastRefused(MotionRefused):
    """On the twin, the robot falls or hits itself with the motion, or the forecast is uncertain."""

    _reason = Reason.FORECAST
    remedy = "read the message; a person at a page of the studio can let the motion pass once"

    def __init__(self, text: str, basis: Mapping[str, str] = MappingProxyType({})) -> None:
        """Refuse with the origin of the values of the twin (see `TwinVerdict.basis`)."""
        super().__init__(text)
        self.basis = dict(basis)


class MotionOver(MotionRefused):
    """The motion must not begin any more."""

    remedy = "ask for it again, if it is still wanted"


def nothing_moved(error: ServolinkError) -> ServolinkError:
    """Return a refusal of the hub, worded for a program that waits for the result of a motion."""
    if isinstance(error, LeaseRefused | MotionOver):
        return type(error)(f"nothing was moved: {error}", reason=error.reason)
    return error


def refuse_role(packet: Packet, role: Role) -> RequestRefused | None:
    """Refuse a packet that a program with `role` may not send."""
    needed = Role.needed_for(packet)
    if role >= needed:
        return None
    text = f"{type(packet).__name__} needs the role {needed}, and this program has the role {role}"
    return RequestRefused(text, packet, reason=Reason.ROLE)


def refuse_other_use(hold: HoldStatus | None, session: str) -> MotionOver | None:
    """Refuse a motion of `session` while another program has exclusive use."""
    if hold is None or hold.session == session:
        return None
    text = f"nothing was moved: {hold.who} has taken exclusive use of the board"
    return MotionOver(text, reason=Reason.EXCLUSIVE_USE)


class LeaseGate:
    """Gate that refuses motions while another program holds the lease."""

    def __init__(self, lease: MotionLease, name: str, who_of: Callable[[str], str]) -> None:
        """Name the board `name` in reasons, and each program as `who_of` its session says."""
        self._lease = lease
        self._name = name
        self._who_of = who_of

    def refuse(self, packet: Packet, ticket: Ticket, now: float) -> LeaseRefused | None:
        """Refuse a motion of the program in `ticket`, unless the program holds the lease or could take the lease."""
        if not packet.is_motion or not (reason := self.reason(ticket.who, now)):
            return None
        return LeaseRefused(reason)

    def reason(self, session: str, now: float) -> str:
        """Return the reason why `session` may not move the servos, with a remedy; empty if allowed."""
        holder = self._lease.holder
        if holder == session:
            return ""
        if holder is None:
            if not self._lease.is_barred(session):
                return ""
            return (
                f"the right to move the servos of {escape(self._name)} was taken from this program: "
                f"`servolink share --give {escape(self._name)}` gives it back"
            )
        return (
            f"the servos of {escape(self._name)} are moved by {escape(self._who_of(holder))}, which has had the lease "
            f"for {_duration(now - self._lease.since)}: wait until it is free, or take it over with "
            f"`servolink share --take {escape(self._name)}`"
        )


def refused_response(packet: Packet, states: Iterable[ServoState] = ()) -> Response | None:
    """Return the response to an unsent packet; None without one.

    `states` are those of the servos of a SetServoParameterRequest, whose response reports the flags in force.
    """
    if isinstance(packet, SetServoParameterRequest):
        return _flags_in_force(packet, states)
    if isinstance(packet, Request) and issubclass(PACKETS.response_of(packet), Result):
        refused: Result = PACKETS.result_of(packet, done=False)
        return refused
    return None


def stops_all(packet: Packet) -> bool:
    """Return whether `packet` stops all servos, which ends every motion."""
    return packet == SetServoParameterRequest(ALL_SERVOS, 0, 1)


def _flags_in_force(packet: SetServoParameterRequest, states: Iterable[ServoState]) -> SetServoParameterResponse | None:
    flags = {(state.is_start, state.is_hold) for state in states if packet.servo_id in {state.servo_id, ALL_SERVOS}}
    if not flags:
        return None
    # The response about all servos differs from the request if the board did not obey.
    is_start, is_hold = min(flags - {(packet.is_start, packet.is_hold)} or flags)
    return SetServoParameterResponse(packet.servo_id, is_start, is_hold)


def _duration(seconds: float) -> str:
    """Return a time for people, such as `12 s` or `3 min`."""
    whole = max(int(seconds), 0)
    return f"{whole} s" if whole < 120 else f"{whole // 60} min" if whole < 7200 else f"{whole // 3600} h"


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
        if not stops.holds(ticket):
            return MotionOver(stops.reason, reason=Reason.STOP)
        if now > ticket.until:
            return MotionOver("the time by which it was to begin has passed", reason=Reason.DEADLINE)
        return None

    def gate(self, stops: StopCounter) -> Callable[[Packet, Ticket], ServolinkError | None]:
        """Return `refuse` for the `stops` of a program, worded for whoever waits for the motion."""

        def refuse(packet: Packet, ticket: Ticket) -> ServolinkError | None:
            refusal = self.refuse(packet, ticket, stops)
            return refusal and nothing_moved(refusal)

        return refuse

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
