"""HubTap: all traffic of a hub, as messages of a recording."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from servolink.control import ConnectionNow, HoldNotice, HoldStatus, LeaseNotice, ProblemNotice, ProgramNotice
from servolink.hub.hub import Hub
from servolink.protocol import Packet
from servolink.recorder import Event, Message, ProblemFound, WireTap


class HubTap(WireTap):
    """Tap of a hub: bytes of the line, outcomes of requests, and notices, until closed."""

    def __init__(self, hub: Hub, take: Callable[[float, Message], None], *, wire_only: bool = False) -> None:
        super().__init__(take)
        self._hub = hub
        ends: list[Callable[[], None]] = [hub.board.connection.taps.add(self)]
        if not wire_only:
            ends += [hub.listen(self._hear), hub.follow_requests(self._over)]
        self._ends = ends

    def close(self) -> None:
        """End the tap; may be called again."""
        for end in self._ends:
            end()

    def _over(self, packet: Packet, outcome: object, asked_at: float, who: str, session: str) -> None:
        """Pass on the outcome of a program's request."""
        lease = self._hub.lease
        holder = "" if lease is None else lease.who
        self.done(packet, outcome, self._now() - asked_at, who=who, session=session, lease=holder)

    def _hear(self, notice: Struct, session: str) -> None:
        message = message_of(notice)
        if message is not None:
            self._take(self._now(), message)


def message_of(notice: Struct) -> Message | None:
    """Return a notice of the hub as a message; None if the recording has the fact in another form."""
    match notice:
        case ProgramNotice(event, session, who):
            return Event("program", event, who, session, text=f"{notice.door}, {notice.role}" if notice.door else "")
        case ConnectionNow(state, another):
            return Event("connection", state, text=another)
        case LeaseNotice(event, _, holder):
            return Event("lease", event, holder.who if holder else "", holder.session if holder else "")
        case HoldNotice(None):
            return Event("hold", "released")
        case HoldNotice(HoldStatus(session, who, reason)):
            return Event("hold", "held", who, session, text=reason)
        case ProblemNotice(text):
            return ProblemFound("hub", text)
        case _:  # a refusal is a command
            return None
