"""MotionLease: right of a program to move the robot, and the end of the right."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

SECONDS_AFTER = 10.0
"""Seconds from the computed end of the holder's last motion to the end of a lease, by default."""
LEAST_DEAD_MAN, MOST_DEAD_MAN = 0.05, 60.0  # limits of a dead-man time, seconds

LeaseEvent = Literal["taken", "taken over", "asked for", "given back", "left", "over", "beats stopped"]


class LeaseChange(NamedTuple):
    """Change of the lease, for notifications to all programs."""

    event: LeaseEvent
    before: str | None
    """Session that held the lease before; None if the lease was free."""
    holder: str | None
    """Session that holds the lease now; None if the lease is free."""
    by: str | None = None
    """Session that asked for the lease or took the lease; None if time or a loss ended the lease."""
    must_stop: bool = False
    """Whether the board must be stopped immediately: the watching program is gone."""


class MotionLease:
    """Right to move the robot, for a single program at a time. A stop needs no lease and does not change the holder.

    `now` is in seconds of any clock that does not jump. Each method that is passed `now` first does what was due by
    then (see `advance`), and returns what has changed.
    """

    def __init__(self, seconds_after: float = SECONDS_AFTER) -> None:
        """Start free. A lease ends `seconds_after` seconds after the end of the holder's last motion."""
        if not 0 <= seconds_after < math.inf:
            raise ValueError(f"seconds_after must be finite and at least 0, not {seconds_after}")
        self.seconds_after = seconds_after
        self.holder: str | None = None
        """Session that holds the lease; None if the lease is free."""
        self.since = 0.0
        """Time at which the present holder got the lease."""
        self.dead_man: float | None = None
        """Seconds without a beat until the board is stopped; None if no beats are expected."""
        self.is_end_unknown = False
        """Whether a motion has no computed end, so that the servos must be read until they rest (see `rested`)."""
        self._beat = 0.0
        self._motion_ends = 0.0
        self._barred: set[str] = (
            set()
        )  # sessions that lost the lease to another program: a further motion must not take the lease back

    def take(
        self, session: str, now: float, *, dead_man: float | None = None, force: bool = False, is_beat: bool = True
    ) -> list[LeaseChange]:
        """Give the lease to `session` if free or already held by `session`, or with `force` in any case.

        A program from which it was taken over gets a free one only with `force`, until the lease is given back.

        `holder` says whether it was granted. From now on the session must send a beat at least every `dead_man`
        seconds. Taking counts as a motion that ends now, and with `is_beat` as a beat; not if it is done for a motion,
        which may have waited long after its program fell silent. Raise ValueError for a `dead_man` outside 0.05..60.
        """
        if dead_man is not None and not LEAST_DEAD_MAN <= dead_man <= MOST_DEAD_MAN:
            raise ValueError(f"dead_man must be {LEAST_DEAD_MAN:g}..{MOST_DEAD_MAN:g} s, not {dead_man:g}")
        changes = self.advance(now)
        if not is_beat and any(change.must_stop for change in changes):  # a motion of the program that fell silent
            return changes
        before = self.holder
        if not force and (before not in {None, session} or session in self._barred):
            return changes
        self._barred.discard(session)
        if before == session:
            self.dead_man = self.dead_man if dead_man is None else dead_man
        else:
            self.holder, self.since, self.dead_man = session, now, dead_man
            self._motion_ends, self.is_end_unknown = now, False
            is_beat = True
            changes.append(LeaseChange("taken" if before is None else "taken over", before, session, session))
            if before is not None:
                self._barred.add(before)
        if is_beat:
            self._beat = now
        self._motion_ends = max(self._motion_ends, now)
        return changes

    def give(self, session: str, now: float) -> list[LeaseChange]:
        """Free the lease if `session` holds it; sessions that lost the lease to another program may take it again.

        But nobody does the latter for themselves while another session holds it. A motion ends by itself.
        """
        changes = self.advance(now)
        if self.holder in {None, session} or session not in self._barred:
            self._barred.clear()
        if self.holder == session:
            changes.append(self._free("given back"))
        return changes

    def asked(self, session: str, now: float) -> list[LeaseChange]:
        """Return the request of `session` for the lease; None for a free lease or the holder."""
        changes = self.advance(now)
        if self.holder not in {None, session}:
            changes.append(LeaseChange("asked for", self.holder, self.holder, session))
        return changes

    def moved(self, session: str, ends_at: float | None, now: float) -> list[LeaseChange]:
        """Count a motion of the holder that ends at `ends_at`; None for an unknown end.

        Motions of others do not count: they were sent before the lease was taken over.
        """
        changes = self.advance(now)
        if self.holder == session:
            if ends_at is None:
                self.is_end_unknown = True
            self._motion_ends = max(self._motion_ends, now, ends_at or now)
        return changes

    def beat(self, session: str, now: float) -> list[LeaseChange]:
        """Count a sign of life of the holder, unless too late."""
        changes = self.advance(now)
        if self.holder == session:
            self._beat = now
        return changes

    def rested(self, now: float) -> list[LeaseChange]:
        """Count motions of unknown end as over: all servos were read twice and rest."""
        changes = self.advance(now)
        self.is_end_unknown = False
        self._motion_ends = max(self._motion_ends, now)
        return changes

    def stopped(self, now: float) -> list[LeaseChange]:
        """Count all motions as over: the board was stopped."""
        changes = self.advance(now)
        self.is_end_unknown = False
        self._motion_ends = now
        return changes

    def left(self, session: str, now: float) -> list[LeaseChange]:
        """Free the lease of a session that has ended. With a dead-man time the board must be stopped."""
        changes = self.advance(now)
        self._barred.discard(session)
        if self.holder == session:
            changes.append(self._free("left", must_stop=self.dead_man is not None))
        return changes

    def advance(self, now: float) -> list[LeaseChange]:
        """Do due changes at `now`: free the lease of a holder without beats, or with a motion that is long over."""
        due = self.next_due()
        if due is None or now < due:
            return []
        if due == self._beats_end:
            return [self._free("beats stopped", must_stop=True)]
        return [self._free("over")]

    def is_barred(self, session: str) -> bool:
        """Return whether the lease was taken over from `session` and was not given back since."""
        return session in self._barred

    def next_due(self) -> float | None:
        """Return the time of the next change by `advance`; None without one."""
        due = min(self._beats_end, self._lease_ends)
        return None if due == math.inf else due

    @property
    def _beats_end(self) -> float:
        return math.inf if self.holder is None or self.dead_man is None else self._beat + self.dead_man

    @property
    def _lease_ends(self) -> float:
        return math.inf if self.holder is None or self.is_end_unknown else self._motion_ends + self.seconds_after

    def _free(self, event: LeaseEvent, *, must_stop: bool = False) -> LeaseChange:
        before, self.holder, self.dead_man = self.holder, None, None
        return LeaseChange(event, before, None, must_stop=must_stop)
