"""MotionGate: whether a packet of a program may be sent, and what the program gets if not."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

from servolink.control.roles import Role, needed_role
from servolink.escaping import escape
from servolink.hub.rules.lease import LeaseChange, MotionLease
from servolink.protocol.codec import response_class
from servolink.protocol.packet import Packet, Request, Response, Result, is_motion
from servolink.protocol.servos import ALL_SERVOS, ServoState, SetServoParameterRequest, SetServoParameterResponse


class Admission(NamedTuple):
    """Whether a packet may be sent, and what that changed."""

    reason: str
    """Why it may not be sent, for people; empty if it may."""
    changes: list[LeaseChange]
    """The changes of the lease: a motion takes a free one."""


class MotionGate:
    """Checks the role of a program and, for motion, the lease. Limits are checked where motion is sent (`Motions`)."""

    def __init__(self, lease: MotionLease, name: str, who_of: Callable[[str], str]) -> None:
        """Name the board `name` in reasons, and each program as `who_of` its session says."""
        self._lease = lease
        self._name = name
        self._who_of = who_of

    def admit(self, session: str, role: Role, packet: Packet, now: float) -> Admission:
        """Return whether a program may send a packet at `now`. A stop may always be sent."""
        needed = needed_role(packet)
        if role < needed:
            return Admission(role_reason(packet, role), [])
        if not is_motion(packet):
            return Admission("", [])
        changes = self._lease.take(session, now, is_beat=False)
        return Admission("" if self._lease.holder == session else self.lease_reason(session, now), changes)

    def lease_reason(self, session: str, now: float) -> str:
        """Return why `session` may not move the servos, and what to do; empty if it may."""
        holder = self._lease.holder
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


def role_reason(packet: Packet, role: Role) -> str:
    """Return why a program with `role` may not send `packet`."""
    return f"{type(packet).__name__} needs the role {needed_role(packet)}, and this program has the role {role}"


def refused_response(packet: Packet, states: Iterable[ServoState] = ()) -> Response | None:
    """Return what a program gets for a packet that was not sent; None if that is nothing.

    `states` are those of the servos of a SetServoParameterRequest, whose response reports the flags in force.
    """
    if isinstance(packet, SetServoParameterRequest):
        return _flags_in_force(packet, states)
    if isinstance(packet, Request) and issubclass(declared := response_class(packet), Result):
        return declared(0)
    return None


def stops_all(packet: Packet) -> bool:
    """Return whether `packet` stops all servos, which ends every motion."""
    return packet == SetServoParameterRequest(ALL_SERVOS, 0, 1)


def _flags_in_force(packet: SetServoParameterRequest, states: Iterable[ServoState]) -> SetServoParameterResponse | None:
    flags = {(state.is_start, state.is_hold) for state in states if packet.servo_id in {state.servo_id, ALL_SERVOS}}
    if not flags:
        return None
    # For all servos, one that differs from the request shows that it was not carried out.
    is_start, is_hold = min(flags - {(packet.is_start, packet.is_hold)} or flags)
    return SetServoParameterResponse(packet.servo_id, is_start, is_hold)


def _duration(seconds: float) -> str:
    """Return a time for people, such as `12 s` or `3 min`."""
    whole = max(int(seconds), 0)
    return f"{whole} s" if whole < 120 else f"{whole // 60} min" if whole < 7200 else f"{whole // 3600} h"
